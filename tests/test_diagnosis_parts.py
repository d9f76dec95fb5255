"""Pieces of the diagnosis against closed forms, identities and planted truths."""

from dataclasses import replace

import numpy as np
import pytest

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import drops, filters, line, replay
from exodrake.diagnosis.closure import closure
from exodrake.diagnosis.fit import Fitter, bounded_solve
from exodrake.diagnosis.healthy import healthy_case, scattered
from exodrake.diagnosis.hypothesis import NOTHING, hypothesis
from exodrake.diagnosis.noise import noise_std, sensor_noise_std
from exodrake.diagnosis.problem import columns_of, make_problem
from exodrake.diagnosis.regime import explained, since_reversal
from exodrake.diagnosis.retune import retuned
from exodrake.diagnosis.search import Fitted, Search
from exodrake.diagnosis.verdict import decide
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.delayed_samples import cubic
from exodrake.simulation.simulate import simulate


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def short_case(robot, seconds=10.0, repeats=False):
    """Two short logs of a robot: holds to fit (twice where asked), steps held out."""
    frames = round(seconds / robot.machine.frame)
    holds = Reference(protocols.holds(robot, seed=3, dwell=2.5).tension[:frames], "holds")
    steps = Reference(protocols.steps(robot).tension[:frames], "steps")
    logs = [CaseLog(simulate(robot, holds, seed=1), "holds", "fit", None, "holds.csv")]
    if repeats:
        logs.append(CaseLog(simulate(robot, holds, seed=2), "holds", "fit", "holds.csv", "again.csv"))
    logs.append(CaseLog(simulate(robot, steps, seed=4), "steps", "holdout", None, "steps.csv"))
    return Case("short", {}, tuple(logs))


def test_bounded_solve_meets_the_optimality_conditions():
    rng = np.random.default_rng(0)
    for _ in range(20):
        root = rng.standard_normal((12, 6))
        normal, descent = root.T @ root, 10.0 * rng.standard_normal(6)
        low, high = -rng.random(6), rng.random(6)
        move = bounded_solve(normal, descent, low, high)
        slope = normal @ move - descent
        assert np.all((move >= low - 1e-12) & (move <= high + 1e-12))
        inside = (move > low + 1e-9) & (move < high - 1e-9)
        assert np.allclose(slope[inside], 0.0, atol=1e-6)
        assert np.all(slope[move <= low + 1e-9] > -1e-6) and np.all(slope[move >= high - 1e-9] < 1e-6)


def test_shapley_of_an_additive_game_is_the_additive_part():
    worth = {"motor": 5.0, "tendon": 3.0, "finger": 2.0}
    power = {s: 10.0 - sum(worth[x] for x in s) for s in replay.subsets(worth)}
    assert replay.shapley(power) == pytest.approx({"motor": 0.5, "tendon": 0.3, "finger": 0.2})


def test_interpreted_loop_equals_the_compiled_twin(robot):
    problem = make_problem(short_case(robot, 3.0), robot)
    trial = problem.holdout[0]
    whole = problem.predict(problem.silent()[None], trial)[0]
    assert np.array_equal(replay.replayed(problem, problem.silent(), replace(trial, drops=None), frozenset()), whole)


def test_closure_of_known_gaps():
    assert closure(np.array([5.0]), np.array([1.0])) == 1.0
    assert closure(np.array([5.0]), np.array([3.0])) == pytest.approx(0.5)
    assert closure(np.array([5.0]), np.array([5.0])) == 0.0


def test_a_condition_that_makes_the_residual_explains_it_and_another_does_not():
    rng = np.random.default_rng(1)
    condition = rng.standard_normal(4000)
    assert explained(np.sign(condition), condition) > 0.9
    assert explained(rng.standard_normal(4000), condition) < 0.02


def test_time_since_reversal():
    assert since_reversal(np.array([1.0, 1.0, -1.0, -1.0, -1.0]), 0.5) == pytest.approx([0.0, 0.5, 0.0, 0.5, 1.0])


def test_cubic_interpolation_is_exact_for_a_parabola():
    x = np.arange(20.0)
    at = np.linspace(2.0, 16.0, 37)
    assert np.allclose(cubic((x**2)[:, None], at)[:, 0], at**2)


def test_floor_from_repeats_and_from_numbers_agree_for_white_signals(robot):
    case = short_case(robot, repeats=True)
    columns = columns_of(case, robot.machine)
    floor = dict(zip(columns, noise_std(case, robot, columns), strict=True))
    assert floor["angle_MCP"] == pytest.approx(sensor_noise_std(robot)["angle"], rel=0.15)
    assert floor["tension_AF"] == pytest.approx(sensor_noise_std(robot)["tension"], rel=0.35)


def test_lost_commands_are_decoded(robot):
    reference = Reference(protocols.steps(robot, dwell=0.6).tension, "steps")
    shares = []
    for seed in range(3):
        log = simulate(robot.splice("timing.dropped_commands", {"probability": 0.3}), reference, seed=seed)
        arrays = [log.array(kind) for kind in ("speed_cmd", "stroke", "tension")]
        shares.append(drops.decode(robot.machine, robot.values, *arrays))
    _, low, high = drops.probability(shares)
    assert low < 0.3 < high and sum(d.events for d in shares) > 20
    clean = simulate(robot, reference, seed=9)
    whole = drops.decode(robot.machine, robot.values, *(clean.array(k) for k in ("speed_cmd", "stroke", "tension")))
    assert whole.lost <= 0.05 * max(whole.events, 1) + 1
    assert drops.lossy(shares) and not drops.lossy([whole])


def test_commands_lost_in_bursts_are_decoded(robot):
    """A held command repeats in the log what the drive was last told: losses of two and three frames in a row."""
    reference = np.concatenate([protocols.random_motion(robot, seed=seed).tension for seed in range(3)])
    rng, packet_arrival = np.random.default_rng(5), np.ones((len(reference), 3))
    for frame in rng.choice(len(reference) - 3, len(reference) // 12, replace=False):
        packet_arrival[frame : frame + rng.integers(2, 4)] = 0.0
    deaf = robot.splice("timing.dropped_commands", {"probability": 0.5})
    problem = make_problem(short_case(robot), robot)
    trial = replace(problem.fit[0], reference=reference, drops=drops.Drops(packet_arrival, 0, 0, 0))
    log = problem.predict(problem.silent(deaf)[None], trial)[0]
    kinds = problem.kinds
    arrays = (log[:, [k == kind for k in kinds]] for kind in ("speed_cmd", "stroke", "tension"))
    found = drops.decode(robot.machine, problem.silent(), *arrays)
    lost = found.packet_arrival == 0.0
    assert found.certain >= 5 and np.mean(packet_arrival[lost] == 0.0) > 0.9


def test_a_slow_drive_loses_no_command(robot):
    """It follows badly, but no stroke is the held command's."""
    reference = Reference(protocols.steps(robot, dwell=0.6).tension, "steps")
    log = simulate(robot.splice("motor.slow_velocity_loop", {"factor": 0.3}), reference, seed=3)
    found = drops.decode(robot.machine, robot.values, *(log.array(k) for k in ("speed_cmd", "stroke", "tension")))
    assert not drops.lossy([found])


@pytest.mark.parametrize(
    "identity, parameters, channels",
    [
        ("sensor.gain", {"gain": 0.08}, ("AF",)),
        ("tendon.compliance", {"stiffness": 3000.0}, ()),
        ("finger.stiffness", {"factor": 1.4}, ("PIP",)),
        ("encoder.homing_offset", {"offset": 1e-3}, ("MF",)),
        ("timing.command_latency", {"frames": 2.0}, ()),
    ],
)
def test_a_planted_effect_is_recovered(robot, identity, parameters, channels):
    effect = robot.machine.effect(identity)
    problem = make_problem(short_case(robot.splice(identity, parameters, channels)), robot)
    fitter, h = Fitter(problem), hypothesis(robot.machine, effect, channels)
    start = fitter.at(h, 0.5 * h.start, np.zeros(len(fitter.knobs)))
    responses = np.zeros((len(start.residual), len(fitter.knobs)))
    found = fitter.fit(start, responses, steps=15)
    value = next(iter(parameters.values()))
    assert [k.value(u) for k, u in zip(h.knobs, found.u, strict=True)] == pytest.approx(
        [value] * len(h.knobs), rel=0.06
    )
    assert found.chi2 < 1.3


def test_the_nominal_robot_shows_no_gap(robot):
    problem = make_problem(short_case(robot), robot)
    fitter = Fitter(problem)
    point = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.knobs)))
    held = problem.residual(problem.silent()[None], problem.holdout)[0]
    fitted = Fitted(point, held)
    assert decide(problem, Search(fitted, fitted)).verdict == "NO_GAP"


def test_healthy_robots_scatter_every_number_and_no_effect(robot):
    assert [item.role for item in healthy_case(robot, 5).logs] == ["fit", "fit", "fit", "holdout"]
    drawn = scattered(robot, np.random.default_rng(5)).values
    present = np.array([entry.null is not None for entry in robot.machine.parameters])
    assert np.array_equal(drawn[present], robot.values[present])
    stiffness = robot.machine.index["finger.kappa.PIP"]
    assert 0.0 < abs(drawn[stiffness] / robot.values[stiffness] - 1.0) < 0.08


def test_an_end_stop_on_the_other_side_is_found(robot):
    """A fit that starts before a stop which no motion meets learns nothing of it: it has to leap."""
    stop = "finger.q_f.MCP"
    truth = robot.with_parameters({stop: 0.93 * robot[stop]}, source="planted")
    logs = [
        CaseLog(simulate(truth, Reference(ask.tension[:1000], name), seed=k), name, role, None, f"{name}.csv")
        for k, (name, role, ask) in enumerate(
            (("sweeps", "fit", protocols.short_sweeps(robot)), ("holds", "holdout", protocols.holds(robot, seed=2)))
        )
    ]
    problem = make_problem(Case("stop", {}, tuple(logs)), robot)
    fitter = Fitter(problem)
    origin = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.knobs)))
    found = retuned(fitter, origin).point
    place = [knob.name for knob in fitter.knobs].index(stop)
    assert found.chi2 < 1.05 < origin.chi2
    assert found.x[place] == pytest.approx(-0.07, abs=0.02)


def test_a_line_in_the_spectrum_is_told_from_noise(robot):
    problem = make_problem(short_case(robot), robot)
    rng = np.random.default_rng(2)
    columns, time = len(problem.columns), np.arange(2000) * robot.machine.frame
    quiet = [rng.standard_normal((2000, columns)) for _ in range(3)]
    assert not line.find(problem, quiet).certain
    shaken = [log + 2.0 * np.sin(2 * np.pi * 6.3 * time + k)[:, None] for k, log in enumerate(quiet)]
    found = line.find(problem, shaken)
    assert found.certain and found.frequency == pytest.approx(6.3, abs=0.05)
    assert found.power == pytest.approx(np.full(columns, 2.0), rel=0.2)  # a^2 / 2 of a sine
    assert not line.find(problem, [quiet[0], quiet[1], shaken[2]]).certain  # in one log only: no tremor


def test_the_band_of_a_slow_line_can_be_filtered(robot):
    """A line at the slow end has no band below zero, which no filter takes."""
    slow = line.Line(1.0, np.zeros(1), 10.0, 1.0)
    left = filters.without(slow.bands(25.0), np.ones((500, 1)), robot.machine.frame)
    assert np.isfinite(left).all()


def test_late_motion_capture_shows_in_a_simulated_log(robot):
    reference = Reference(protocols.steps(robot).tension[:400], "steps")
    plain = simulate(robot, reference, seed=None, quantisation=False)
    late = simulate(robot.splice("timing.mocap_delay", {"delay": 0.04}), reference, seed=None, quantisation=False)
    assert np.allclose(late["angle_MCP"][2:], plain["angle_MCP"][:-2], atol=1e-12)
    assert np.array_equal(late["stroke_AF"], plain["stroke_AF"])
