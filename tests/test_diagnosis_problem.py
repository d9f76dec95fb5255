"""A case as a regression: noise, residuals of delayed, diverging and other robots; prediction-error runs."""

from dataclasses import replace

import numpy as np
import pytest

from exodrake.data.case import Case, CaseLog
from exodrake.data.log import robust_std
from exodrake.diagnosis.checks.compare import find_columns
from exodrake.diagnosis.likelihood import moved_a_little
from exodrake.diagnosis.noise import noise_std, sensor_noise_std
from exodrake.diagnosis.problem import WILD, by_trial, find_turns, make_problem, subtract
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate


@pytest.fixture(scope="module")
def case(robot):
    """Two runs of 10 s of holds to fit, steps held out."""
    holds = Reference(protocols.holds(robot, seed=3, dwell=2.5).values[:500], "holds")
    steps = Reference(protocols.steps(robot).values[:500], "steps")
    logs = (
        CaseLog(simulate(robot, holds, seed=1), "holds", "fit", None, "holds.csv"),
        CaseLog(simulate(robot, holds, seed=2), "holds", "fit", "holds.csv", "again.csv"),
        CaseLog(simulate(robot, steps, seed=4), "steps", "holdout", None, "steps.csv"),
    )
    return Case("short", {}, logs)


def test_noise_from_repeats_and_from_the_robot_file_agree_for_white_signals(robot, case):
    columns = find_columns(case, robot.machine)
    found = dict(zip(columns, noise_std(case, robot, columns), strict=True))
    assert found["angle_MCP"] == pytest.approx(sensor_noise_std(robot)["angle"], rel=0.05)
    assert found["tension_AF"] == pytest.approx(sensor_noise_std(robot)["tension"], rel=0.2)


def alone(robot, seed=5):
    """A case without repeats: random motion of 16 s and steps."""
    motions = (
        protocols.random_motion(load_robot(), seed=seed).values[:800],
        protocols.steps(load_robot()).values[:800],
    )
    references = [Reference(values, "motion") for values in motions]
    items = [
        CaseLog(simulate(robot, reference, seed=k), f"m{k}", "fit", None, f"{k}.csv")
        for k, reference in enumerate(references)
    ]
    return Case("alone", {}, tuple(items))


@pytest.mark.parametrize("parameter", ["mocap.sigma_q", "sensor.sigma_F"])
@pytest.mark.parametrize("factor", [1.5, 10.0])
def test_noise_of_a_sensor_is_what_the_logs_show_where_the_robot_file_says_less(robot, parameter, factor):
    wanted = factor * robot[parameter]
    case = alone(robot.with_parameters({parameter: wanted}))
    problem = make_problem(case, robot)
    assert problem.noisier == {parameter: robot[parameter]} and problem.stated[parameter] == robot[parameter]
    assert problem.robot[parameter] == pytest.approx(wanted, rel=0.1)
    left = problem.residual(problem.silent()[None], problem.fit)[0].reshape(-1, len(problem.columns))
    kind = {"mocap.sigma_q": "angle", "sensor.sigma_F": "tension"}[parameter]
    own = [k == kind for k in problem.kinds]
    assert np.mean(left[:, own] ** 2) == pytest.approx(1.0, abs=0.25)


def test_noise_is_never_lowered_and_repeats_speak_for_themselves(robot, case):
    quiet = robot.with_parameters({"mocap.sigma_q": 0.3 * robot["mocap.sigma_q"]})
    assert make_problem(alone(quiet), robot).noisier == {} == make_problem(case, quiet).noisier


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        ("sensor.pulley_friction", {"mu": 0.07}),  # its loop hunts
        ("finger.tremor", {"torque": 4e-3, "frequency": 11.0}),
        ("tendon.stribeck_friction", {}),
        ("motor.dead_zone", {}),
    ],
)
def test_what_makes_a_robot_shake_is_no_noise_of_its_sensors(robot, effect, parameters):
    assert make_problem(alone(robot.splice(effect, parameters)), robot).noisier == {}


@pytest.mark.parametrize("step", [0.01, 0.5, 1.0])
def test_robust_standard_deviation_of_rounded_values_forgets_rare_ones(step):
    """Rounding adds step^2 / 12 (Sheppard 1898); one value in a hundred is far away."""
    rng = np.random.default_rng(4)
    values = np.round(rng.standard_normal(20_000) / step) * step
    rare = np.where(rng.random(20_000) < 0.01, 50.0, values)
    for found, tolerance in ((values, 0.02), (rare, 0.06)):
        assert robust_std(found) == pytest.approx(np.sqrt(1.0 + step**2 / 12.0), rel=tolerance)


def test_repeats_count_for_the_noise_only(robot, case):
    problem = make_problem(case, robot)
    assert [trial.name for trial in problem.fit] == ["holds.csv"]
    assert [trial.name for trial in problem.judged] == ["steps.csv"]


def test_residual_of_the_robot_that_wrote_the_log_is_noise(robot, case):
    problem = make_problem(case, robot)
    (residual,) = problem.residual(problem.silent()[None], problem.fit)
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.3)
    problem.fit[0].measured[100:110, 2] = np.nan  # nothing was measured
    (log,) = by_trial(problem.residual(problem.silent()[None], problem.fit)[0], problem.fit)
    assert log.shape == problem.fit[0].measured.shape and not log[100:110, 2].any() and log[100:110, 1].all()


def test_residual_goes_on_in_a_straight_line_where_nothing_was_measured():
    line = np.linspace(-3.0, 5.0, 9)[:, None] * [[1.0, 2.0]]
    measured, found = line.copy(), np.zeros((1, 9, 2))
    measured[3:6, 0] = np.nan
    measured[7:, 1] = np.nan
    subtract(found, measured, np.array([1.0, 2.0]), np.array([1e4, 1e4]))
    np.testing.assert_allclose(found[0, :, 0], line[:, 0])
    np.testing.assert_allclose(found[0, :, 1], np.minimum(line[:, 1] / 2.0, line[6, 1] / 2.0))


def test_rows_that_a_log_lacks_are_bridged_and_nothing_counts_until_the_robot_has_settled(robot, case):
    logs = []
    for item in case.logs:
        signals = {name: values.copy() for name, values in item.log.signals.items()}
        for values in signals.values():
            values[50:52] = values[100:120] = np.nan  # 40 ms, 0.4 s
        logs.append(replace(item, log=replace(item.log, signals=signals)))
    (trial,) = make_problem(replace(case, logs=tuple(logs)), robot).fit
    (whole,) = make_problem(case, robot).fit
    missing = np.isnan(trial.measured).all(axis=1)
    assert missing[50:52].all() and missing[106:220].all() and missing.sum() < 2 + 122
    for rows in (slice(49, 53), slice(99, 121)):
        np.testing.assert_allclose(np.diff(trial.reference[rows], n=2, axis=0), 0.0, atol=1e-12)
    np.testing.assert_array_equal(trial.reference[121:], whole.reference[121:])


def test_a_joint_turns_round_beside_its_rest_and_half_of_a_fast_motion_counts():
    """Of sin(2 pi t / period) it rests within least period / (2 pi) of a turn."""
    time = 0.001 * np.arange(4000)
    for period, counted in ((2.0, 1.0 - 4.0 * 0.05 / 2.0), (0.1, 0.5)):
        share = 1.0 - np.mean(find_turns(np.sin(2 * np.pi * (time + 0.0003) / period), 0.02, 50))
        rest = 2.0 * np.arcsin(0.02) / np.pi
        assert share == pytest.approx(counted - rest * (0.5 if counted == 0.5 else 1.0), abs=0.01)
    assert find_turns(np.full(100, np.nan), 0.02, 50).sum() == 0


def test_a_wiggle_of_a_sticking_joint_does_not_count_and_the_motions_beside_it_do():
    speed = np.concatenate([np.ones(1000), np.zeros(100), np.ones(60), np.zeros(100), -np.ones(1000)])
    counted = np.flatnonzero(~find_turns(speed, 0.02, 50))
    assert np.array_equal(counted, [*range(50, 950), *range(1310, 2210)])


def test_run_that_divides_by_zero_is_bad_not_fatal(robot, case):
    problem = make_problem(case, robot)
    broken = problem.silent()
    broken[robot.machine.index["motor.r_set"]] = 0.0  # speed references are divided by it
    residual = problem.residual(np.array([problem.silent(), broken]), problem.fit)
    assert np.isfinite(residual).all()
    assert np.mean(residual[0] ** 2) < 2.0
    assert np.mean(np.abs(residual[1]) == WILD) > 0.1


def test_late_motion_capture_shows_in_a_simulated_log(robot):
    reference = Reference(protocols.steps(robot).values[:400], "steps")
    plain = simulate(robot, reference, seed=None, quantisation=False)
    late = simulate(robot.splice("timing.mocap_delay", {"delay": 0.04}), reference, seed=None, quantisation=False)
    assert np.allclose(late["angle_MCP"][2:], plain["angle_MCP"][:-2], atol=1e-12)
    assert np.array_equal(late["stroke_AF"], plain["stroke_AF"])


def test_robots_of_the_runs_with_noise_rest_at_all_phases_of_an_encoders_count(robot, case):
    """Phases of one robot have a mean vector of length 1; n uniform ones have 0.5 or more with exp(-0.25 n)."""
    problem = make_problem(case, robot)
    count = np.sqrt(12.0) * sensor_noise_std(robot)["stroke"]
    strokes = [i for i, column in enumerate(problem.columns) if column.startswith("stroke")]
    rests = problem.predict(moved_a_little(problem, problem.silent()), problem.fit[0])[:, -1, strokes]
    length = np.abs(np.mean(np.exp(2j * np.pi * rests / count)))
    assert rests.size == 24
    assert np.ptp(rests, axis=0).max() < 100 * count  # and are still one robot
    assert length < 0.5


FRAMES = 750  # 15 s a log


@pytest.fixture(scope="module")
def nominal():
    return load_robot()


def case_of(robot, seed, quantisation=True):
    """Holds to fit, steps held out."""
    plan = (("holds", "fit", protocols.holds(robot, seed=3)), ("steps", "holdout", protocols.steps(robot)))
    logs = []
    for k, (name, role, whole) in enumerate(plan):
        reference = Reference(whole.values[:FRAMES], name)
        log = simulate(robot, reference, None if seed is None else seed + k, quantisation)
        logs.append(CaseLog(log, name, role, None, name))
    return Case("fed", {}, tuple(logs))


def chi2(problem, robot):
    """Mean square residual on the fitted logs [noise variances] of a robot."""
    return float(np.mean(problem.residual(problem.silent(robot)[None], problem.fit) ** 2))


def test_a_run_fed_with_its_own_log_is_that_log(nominal):
    problem = make_problem(case_of(nominal, None, quantisation=False), nominal)
    prediction_error = problem.prediction_error()
    kept = [problem.columns.index(c) for c in prediction_error.columns]
    closed = problem.predict(problem.silent()[None], problem.fit[0])[0]
    assert np.array_equal(
        prediction_error.predict(prediction_error.silent()[None], prediction_error.fit[0])[0], closed[:, kept]
    )


def test_the_imposed_column_is_not_judged(nominal):
    problem = make_problem(case_of(nominal, 1), nominal)
    assert set(problem.columns) - set(problem.prediction_error().columns) == {
        f"speed_cmd_{w}" for w in ("AF", "MF", "AE")
    }


def test_a_log_without_commands_cannot_steer(nominal):
    case = case_of(nominal, 1)

    def mute(log):
        return replace(log, signals={k: v for k, v in log.signals.items() if not k.startswith("speed_cmd")})

    logs = tuple(replace(item, log=mute(item.log)) for item in case.logs)
    assert make_problem(replace(case, logs=logs), nominal).prediction_error() is None


@pytest.mark.parametrize(
    ("identity", "parameters"),
    [("sensor.pulley_friction", {"mu": 0.05}), ("motor.dead_zone", {"width": 2.5e-3, "release": 1.0})],
)
def test_noise_in_a_hunting_loop_is_repeated_in_prediction_error(nominal, identity, parameters):
    robot = nominal.splice(identity, parameters)
    problem = make_problem(case_of(robot, 5), nominal)
    left, closed = chi2(problem.prediction_error(), robot) - 1.0, chi2(problem, robot) - 1.0
    assert closed > 1.0  # beside the noise of the sensors, 1, the true robot leaves more than that in closed loop
    assert left < 0.5 * closed  # and prediction errors repeat most of it


def test_an_effect_of_one_part_stays_in_its_part_in_prediction_error(nominal):
    """A slow drive errs in the strokes; the finger, which follows the strokes as measured, hardly feels it."""
    robot = nominal.splice("motor.slow_velocity_loop", {"factor": 0.3})
    closed = make_problem(case_of(robot, 5), nominal)
    prediction_error = closed.prediction_error()

    def excess(problem, kind):
        rows = problem.residual(problem.silent()[None], problem.fit)[0].reshape(-1, len(problem.columns))
        return np.mean(rows[:, [c.startswith(kind) for c in problem.columns]] ** 2) - 1.0

    assert excess(prediction_error, "stroke") > 1.0  # more than the noise
    assert excess(prediction_error, "angle") < 0.5 * excess(closed, "angle")  # most of the angles' error is not theirs
