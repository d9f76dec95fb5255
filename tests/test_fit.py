"""Fits against planted parameters, closed forms and error rates; refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from scipy import optimize, signal, stats

import exodrake as exo
from exodrake.data.case import gather_logs
from exodrake.diagnosis.problem import make_problem
from exodrake.identification import fit as module
from exodrake.identification.fit import arx_percents, check_residual, hold_start, jackknife
from exodrake.model.robot import drawn_robot

PLANTED = {"finger.kappa.MCP": 0.09, "finger.kappa.PIP": 0.052, "controller.kp": 0.0066}


def test_planted_parameters_come_back_from_logs_without_noise(robot):
    truth = robot.with_parameters(PLANTED | {"tendon.k": 3000.0})
    log = exo.simulate(truth, "chirp:span=5", seed=None, quantisation=False)
    found = exo.fit(robot, log, [*PLANTED, "tendon.k.AF tendon.k.MF tendon.k.AE"])  # the last three move together
    *own, together = found.parameters
    assert together.value == pytest.approx(3000.0, rel=1e-5)
    assert found.robot["tendon.k.AE"] == pytest.approx(3000.0, rel=1e-5)
    for p in own:
        assert p.value == pytest.approx(PLANTED[p.name], rel=1e-5) and not p.at_bound
    assert all(s.fitted > 99.99 for s in found.signals)
    assert found.robot.sources["finger.kappa.MCP"] == "fitted to chirp"


def test_values_and_white_deviations_are_those_of_scipys_curve_fit(robot):
    """On runs of the public simulator, weighted by the same noise."""
    log = exo.simulate(robot.with_parameters(PLANTED), "chirp:span=5", seed=3)
    found = exo.fit(robot, log, list(PLANTED))
    problem = make_problem(gather_logs(log, (), robot.machine.frame), robot)
    scale, reference = problem.noise_std, exo.from_log(log, robot)

    def predict(_, *values):
        changed = robot.with_parameters(dict(zip(PLANTED, values, strict=True)))
        run = exo.simulate(changed, reference, seed=None, quantisation=False)
        return (np.column_stack([run[c] for c in problem.columns]) / scale).ravel()

    measured = (np.column_stack([log[c] for c in problem.columns]) / scale).ravel()
    start = [robot[name] for name in PLANTED]
    values, covariance = optimize.curve_fit(predict, np.arange(len(measured)), measured, start, epsfcn=1e-6)
    for p, value, std in zip(found.parameters, values, np.sqrt(np.diag(covariance)), strict=True):
        assert p.value == pytest.approx(value, abs=0.02 * std) and p.std_white == pytest.approx(std, rel=0.02)


def test_parameters_of_an_effect_and_prediction_errors(robot):
    start = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3})
    name = "tendon.capstan_friction.mu_phi"
    truth = start.with_parameters({name: 0.2})
    log, held = (exo.simulate(truth, motion, seed) for seed, motion in enumerate(("chirp:span=5", "caging")))
    found = exo.fit(start, log, [name], held_out=[held], prediction=True)
    assert [p.name[-2:] for p in found.parameters] == ["AF", "MF", "AE"]
    for p in found.parameters:
        assert p.low < 0.2 < p.high and p.value == pytest.approx(0.2, abs=0.01)
    assert min(s.held_fitted for s in found.signals if s.column.startswith("angle")) > 90.0
    assert all(s.fitted > s.start for s in found.signals if s.column.startswith("angle"))
    drawn = found.draw(400, seed=1)
    values = np.array([one[f"{name}.AF"] for one in drawn])
    assert np.std(values) == pytest.approx(found.parameters[0].std, rel=0.15)
    answer = json.loads(json.dumps(found.to_dict()))
    assert len(answer["correlation"]) == 3 and len(repr(found).splitlines()) == 2


def test_intervals_hold_robots_within_the_tolerances_where_white_ones_do_not(robot, monkeypatch):
    monkeypatch.setattr(module, "compare_signals", lambda *_: ())
    free, hits, white = ["finger.kappa", "controller.kp"], [], []
    for seed in range(4):
        drawn = drawn_robot(robot, np.random.default_rng(seed)).values
        for name in free:  # what is fitted is nominal
            drawn[robot.indices(name)] = robot.values[robot.indices(name)]
        log = exo.simulate(replace(robot, values=drawn), "chirp:span=5", seed)
        for p in exo.fit(robot, log, free).parameters:
            hits.append(p.low <= robot[p.name] <= p.high)
            white.append(abs(p.value - robot[p.name]) <= stats.norm.ppf(0.95) * p.std_white)
    assert np.mean(hits) > stats.binom.ppf(0.005, len(hits), 0.9) / len(hits)
    assert np.mean(white) < 0.3


def test_jackknife_covers_planted_slopes_under_coloured_noise():
    rng, hits, white = np.random.default_rng(0), [], []
    for _ in range(300):
        slopes = signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal((3200, 2)), axis=0)
        left = signal.lfilter([1.0], [1.0, -0.95], rng.standard_normal(3200))
        found = np.linalg.lstsq(slopes, left, rcond=None)[0]  # the planted slopes are 0
        rest = left - slopes @ found
        std = np.sqrt(np.diag(jackknife(rest, slopes, np.arange(3200) // 160)))
        plain = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * (rest @ rest) / 3198)
        hits += list(np.abs(found) < stats.t.ppf(0.95, 19) * std)
        white += list(np.abs(found) < stats.norm.ppf(0.95) * plain)
    assert np.mean(hits) == pytest.approx(0.9, abs=0.03)
    assert np.mean(white) < 0.55


def test_arx_witness_finds_a_planted_linear_system_and_not_a_random_walk():
    rng = np.random.default_rng(0)
    u = [rng.standard_normal((500, 2)) for _ in range(2)]
    b, a = signal.butter(3, 0.3)
    y = [2.0 + signal.lfilter(b, a, x[:, 0]) - signal.lfilter([0.0, 0.5], [1.0], x[:, 1]) for x in u]
    assert min(arx_percents([u[:1], u[1:]], [y[:1], y[1:]])) > 99.0
    other = [rng.standard_normal(500) for _ in range(2)]
    assert max(arx_percents([u[:1], u[1:]], [other[:1], other[1:]])) < 5.0


def test_tests_of_residuals_keep_their_level_and_find_what_is_planted():
    rng, levels = np.random.default_rng(0), []
    for _ in range(300):
        e, u = rng.standard_normal(600), rng.standard_normal((600, 1))
        coloured = signal.lfilter([1.0], [1.0, -0.9], e)
        levels.append([check_residual([e], [u])[0] < 0.05, check_residual([coloured], [u])[1] < 0.05])
        assert check_residual([coloured], [u])[0] < 1e-6
    white, independent = np.mean(levels, axis=0)
    assert white == pytest.approx(0.05, abs=0.04) and independent < 0.08
    late = np.concatenate([np.zeros(4), 0.3 * u[:-4, 0]])
    assert check_residual([e + late], [u])[1] < 1e-6


@pytest.mark.parametrize(
    ("free", "more", "reason"),
    [
        (["finger.kapa"], {}, "unknown parameter 'finger.kapa'; did you mean"),
        ([], {}, "no parameter is free"),
        (["finger.kappa", "finger.kappa.MCP"], {}, "finger.kappa.MCP is free twice"),
        (["tendon.capstan_friction.mu_phi.AF"], {}, "tendon.capstan_friction is not in the robot"),
        (["finger.kappa.MCP"], {"bounds": {"finger.kappa": (0.2, 0.3)}}, "= 0.08 does not lie between its bounds 0.2"),
        (["sensor.sigma_F"], {}, "sensor.sigma_F moves none of tension_AF"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(robot, free, more, reason):
    log = exo.simulate(robot, "chirp:span=5", seed=1)
    with pytest.raises(exo.InputError, match=reason):
        exo.fit(robot, log, free, **more)


@pytest.mark.parametrize(
    ("start", "low", "high", "ends"),
    [
        (0.5, 0.1, 2.0, (0.1, 2.0)),
        (4.0, 0.1, 2.0, (0.1, 8.0)),
        (0.05, 0.1, np.inf, (0.025, np.inf)),
        (-0.5, -0.3, 0.3, (-0.7, 0.3)),
        (0.0, 0.1, 2.0, (0.0, 2.0)),
    ],
)
def test_a_start_beyond_a_plausible_range_is_no_bound(start, low, high, ends):
    assert hold_start(start, low, high) == pytest.approx(ends)


def test_a_bound_is_kept_and_noted(robot):
    log = exo.simulate(robot.with_parameters({"finger.kappa.MCP": 0.09}), "chirp:span=5", seed=1)
    found = exo.fit(robot, log, ["finger.kappa.MCP"], bounds={"finger.kappa": ("70 mN m/rad", "85 mN m/rad")})
    (p,) = found.parameters
    assert p.at_bound and p.value == pytest.approx(0.085) and "finger.kappa.MCP ended at a bound" in found.notes


def test_a_time_constant_is_found_from_one_that_is_too_short_to_have_a_slope():
    sheath = exo.load_robot("tendon_sheath")
    time = np.arange(400.0)[:, None] * sheath.machine.frame
    rows = np.hstack([0.3 * np.sin(2.0 * time), np.zeros_like(time), np.zeros_like(time)])
    slow, fast = (sheath.splice("sheath.lag", {"time_constant": size}) for size in (0.1, 1e-6))
    log = exo.simulate(slow, exo.Reference(rows, "sine"), seed=1)
    (found,) = exo.fit(fast, log, free=["sheath.lag.time_constant"]).parameters
    assert found.start == 1e-6 and found.low < 0.1 < found.high and found.high < 0.2


def test_starts_on_a_limit_that_is_not_reached_are_said_not_to_move(monkeypatch):
    """A joint that is told to turn at 0.35 rad/s at most: no limit of its speed above that has a slope."""
    monkeypatch.setattr(module, "SPREAD", 8)
    monkeypatch.setattr(module, "FARTHER", 8)
    name = "servo.speed_limit.speed.Rotation"
    start = exo.load_robot("so101").splice("servo.speed_limit", {"speed": 0.25}, ["Rotation"])
    log = exo.simulate(start.with_parameters({name: 0.15}), "random-motion:duration=10", seed=1)
    fastest = np.abs(np.diff(log["angle_ref_Rotation"])).max() / log.dt
    found = exo.fit(start, log, [name], bounds={name: (0.05, 20.0)})
    assert found.parameters[0].value == pytest.approx(0.15, rel=0.01)
    (note,) = (note for note in found.notes if "starts" in note)
    starts = 0.05 * (20.0 / 0.05) ** stats.qmc.Sobol(1, rng=0).random(8)[:, 0]  # by ratio
    assert note.startswith(f"{(starts > fastest).sum()} of 9 starts did not move, as at a bound or a limit")


def test_command_writes_the_fitted_robot(robot, tmp_path):
    exo.write_log(
        exo.simulate(robot.with_parameters({"finger.kappa.MCP": 0.09}), "chirp:span=5", seed=1), tmp_path / "log.csv"
    )
    words = ("--free", "finger.kappa.MCP", "--bounds", "finger.kappa.MCP=0.05..0.2", "--out", tmp_path / "out")
    found = run("fit", tmp_path / "log.csv", *words)
    assert found.exit_code == 0, found.output
    again = exo.load_robot(tmp_path / "out" / "robot.yaml")
    assert again["finger.kappa.MCP"] == pytest.approx(0.09, rel=0.02)
    assert again.sources["finger.kappa.MCP"].startswith("fitted to log.csv")
    assert (tmp_path / "out" / "fit.png").read_bytes().startswith(b"\x89PNG")
    refused = run("fit", tmp_path / "log.csv", "--free", "finger.kappa", "--bounds", "finger.kappa=1")
    assert refused.exit_code == 2 and "NAME=LOW..HIGH" in refused.stderr
