"""Pieces of the diagnosis against closed forms, identities and planted truths."""

import numpy as np
import pytest
from exodrake.diagnosis.fit import Fitter, bounded_solve
from exodrake.diagnosis.hypothesis import NOTHING, hypothesis
from exodrake.diagnosis.retune import retuned
from exodrake.diagnosis.search import Fitted, Search

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import filters, line
from exodrake.diagnosis.closure import closure
from exodrake.diagnosis.noise import noise_std, sensor_noise_std
from exodrake.diagnosis.problem import columns_of, make_problem
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


def test_closure_of_known_gaps():
    assert closure(np.array([5.0]), np.array([1.0])) == 1.0
    assert closure(np.array([5.0]), np.array([3.0])) == pytest.approx(0.5)
    assert closure(np.array([5.0]), np.array([5.0])) == 0.0


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
    start = fitter.at(h, 0.5 * h.start, np.zeros(len(fitter.coordinates)))
    responses = np.zeros((len(start.residual), len(fitter.coordinates)))
    found = fitter.fit(start, responses, steps=15)
    value = next(iter(parameters.values()))
    assert [k.value(u) for k, u in zip(h.coordinates, found.u, strict=True)] == pytest.approx(
        [value] * len(h.coordinates), rel=0.06
    )
    assert found.chi2 < 1.3


def test_the_nominal_robot_shows_no_gap(robot):
    problem = make_problem(short_case(robot), robot)
    fitter = Fitter(problem)
    point = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.coordinates)))
    held = problem.residual(problem.silent()[None], problem.holdout)[0]
    fitted = Fitted(point, held)
    assert decide(problem, Search(fitted, fitted)).verdict == "NO_GAP"


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
    origin = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.coordinates)))
    found = retuned(fitter, origin).point
    place = [coordinate.name for coordinate in fitter.coordinates].index(stop)
    assert found.chi2 < 1.05 < origin.chi2
    assert found.x[place] == pytest.approx(-0.07, abs=0.02)


def test_a_line_in_the_spectrum_is_told_from_noise(robot):
    problem = make_problem(short_case(robot), robot)
    rng = np.random.default_rng(2)
    columns, time = len(problem.columns), np.arange(2000) * robot.machine.frame
    consistent = [rng.standard_normal((2000, columns)) for _ in range(3)]
    assert not line.find(problem, consistent).certain
    shaken = [log + 2.0 * np.sin(2 * np.pi * 6.3 * time + k)[:, None] for k, log in enumerate(consistent)]
    found = line.find(problem, shaken)
    assert found.certain and found.frequency == pytest.approx(6.3, abs=0.05)
    assert found.power == pytest.approx(np.full(columns, 2.0), rel=0.2)  # a^2 / 2 of a sine
    assert not line.find(problem, [consistent[0], consistent[1], shaken[2]]).certain  # in one log only: no tremor


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
