"""Checks before a diagnosis: each injected fault is named by its own check and by no other."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import exodrake as exo
from exodrake.diagnosis.checks.compare import check_case, compare
from exodrake.diagnosis.checks.suspicions import CHECKS, suspicions as suspicions_in
from exodrake.engine.inputs import reference_width
from exodrake.machines.robot_file import machine_folders

ROBOT = exo.load_robot()
REPEAT, SECOND, HELD = 1, 2, 3  # logs of the case below
ANGLES = ("angle_MCP", "angle_PIP", "angle_DIP")
TENSIONS = ("tension_AF", "tension_MF", "tension_AE")
STROKES = ("stroke_AF", "stroke_MF", "stroke_AE")


@cache
def case_of(effect="", **parameters):
    """Short sweeps and their repeat, random motion to fit and held out, of the nominal robot with an effect."""
    robot = ROBOT.splice(effect, parameters or None) if effect else ROBOT
    sweeps = exo.Reference(exo.short_sweeps().values[:1200], "sweeps")
    motions = (sweeps, sweeps, *(exo.random_motion(seed=s) for s in (1, 2)))
    items = (("a", "fit", None), ("b", "fit", "a.csv"), ("c", "fit", None), ("d", "holdout", None))
    logs = [
        exo.CaseLog(exo.simulate(robot, motion, seed=10 + k), name, role, repeats, f"{name}.csv")
        for k, (motion, (name, role, repeats)) in enumerate(zip(motions, items, strict=True))
    ]
    return exo.Case("injected", {}, tuple(logs))


def changed(case, change, columns, logs=range(4)):
    """The case with `change(values)` of some columns of some logs."""
    items = list(case.logs)
    for k in logs:
        log = items[k].log
        new = {c: change(log[c].copy()) for c in columns}
        items[k] = replace(items[k], log=log.with_signals(new, {c: log.units[c] for c in columns}))
    return replace(case, logs=tuple(items))


def suspicions(case, robot):
    return suspicions_in(compare(case, robot))


def fired(case, robot=ROBOT):
    """Names of the checks that have something to say."""
    comparison = compare(case, robot)
    return {check.__name__ for check in CHECKS if any(check(comparison))}


def frozen(values):
    values[400:550] = values[400]
    return values


def noisy(values):
    return values.mean() + values.std() * np.random.default_rng(len(values)).standard_normal(len(values))


def with_burst(values):
    values[400:550] += 0.025 * np.random.default_rng(0).standard_normal(150)  # five standard deviations
    return values


def with_gap(values):
    values[300:400] = np.nan
    return values


def smoothed(values):
    return np.convolve(np.pad(values, 4, mode="edge"), np.ones(9) / 9.0, "valid")


def exchanged(case, one, other):
    items = [
        replace(item, log=item.log.with_signals({one: item.log[other], other: item.log[one]})) for item in case.logs
    ]
    return replace(case, logs=tuple(items))


def held_out(case, log):
    return replace(case, logs=(*case.logs[:HELD], replace(case.logs[HELD], log=log)))


EFFECTS = ("", "sensor.gain", "encoder.homing_offset", "tendon.slack", "timing.command_latency", "motor.dead_zone")


@pytest.mark.parametrize("effect", [*EFFECTS, "finger.tremor", "timing.dropped_commands", "tendon.coulomb_friction"])
def test_a_robot_with_an_effect_of_the_library_is_not_suspicious(effect):
    case = case_of(effect)
    check_case(case, ROBOT.machine)
    assert suspicions(case, ROBOT) == ()


@pytest.mark.parametrize(
    ("check", "change", "columns", "logs"),
    [
        ("another_unit", np.degrees, ANGLES, range(4)),
        ("another_unit", lambda tension: 1000.0 * tension, TENSIONS[:1], range(4)),
        ("another_unit", lambda stroke: 0.001 * stroke, STROKES, range(4)),
        ("another_unit", np.negative, ANGLES[1:2], range(4)),
        ("frozen_channels", frozen, ANGLES[:1], [SECOND]),
        ("frozen_channels", frozen, TENSIONS[1:2], [SECOND]),
        ("frozen_channels", lambda stroke: np.full_like(stroke, stroke[0]), STROKES[:1], range(4)),
        ("noise_as_large_as_motion", noisy, (*TENSIONS, *STROKES, *ANGLES), range(4)),
        ("noise_as_large_as_motion", noisy, ANGLES[:1], range(4)),
        ("noise_unlike_robot_file", smoothed, ANGLES, range(4)),
        ("bursts", with_burst, ANGLES[1:2], [SECOND]),
        ("gaps", with_gap, ANGLES[2:], [SECOND]),
        ("changed_between_repeats", lambda tension: 1.2 * tension, TENSIONS[:1], [REPEAT]),
        ("changed_between_repeats", lambda stroke: stroke + 0.5 * stroke.std(), STROKES[:1], [REPEAT]),
    ],
)
def test_a_fault_of_channels_is_named_by_its_check_alone(check, change, columns, logs):
    found = fired(changed(case_of("sensor.gain"), change, columns, logs))
    assert check in found and found <= {check, "unlike_other_logs"}


@pytest.mark.parametrize(("parameter", "kind"), [("sensor.sigma_F", "tension"), ("mocap.sigma_q", "angle")])
@pytest.mark.parametrize("factor", [1.0, 1.4])
def test_sensors_that_are_noisier_than_the_robot_file_says_are_named_with_their_parameter(parameter, kind, factor):
    noisier = ROBOT.with_parameters({parameter: factor * ROBOT[parameter]}, source="test")
    case = case_on(noisier, *(exo.random_motion(seed=s).values for s in (1, 2)))
    found = [sentence for sentence in suspicions(case, ROBOT) if "noise in the logs" in sentence]
    assert len(found) == (factor > 1.0) and suspicions(case, noisier) == ()
    assert all(f" in {kind}_" in s and "noisier" in s and s.endswith(f"Set {parameter}") for s in found)


def dead_from(share):
    """A sensor that dies and stays dead."""

    def dead(values):
        start = int(share * len(values))
        values[start:] = values[start]
        return values

    return dead


def late(values):
    return np.concatenate([np.full(25, values[0]), values[:-25]])


@pytest.mark.parametrize("effect", ["", "tendon.coulomb_friction"])
@pytest.mark.parametrize("share", [0.1, 0.7])
@pytest.mark.parametrize("column", [ANGLES[0], TENSIONS[0], STROKES[1]])
def test_a_channel_that_dies_for_good_is_named_with_its_log(effect, share, column):
    found = suspicions(changed(case_of(effect), dead_from(share), [column], [SECOND]), ROBOT)
    assert any(column in sentence and "c.csv" in sentence for sentence in found)


@pytest.mark.parametrize("effect", ["", "tendon.coulomb_friction"])
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda angle: 2.0 * angle, (2.0, " times what")),
        (lambda angle: angle + 0.5, (0.5, " rad apart")),
        (late, (0.5, " s late")),
    ],
)
@pytest.mark.parametrize("log", [SECOND, HELD])
def test_angles_of_one_log_that_do_not_follow_from_the_others_are_named_with_size(effect, change, says, log):
    case = changed(case_of(effect), change, ANGLES, [log])
    (found,) = [s for s in suspicions(case, ROBOT) if "do not follow" in s]
    assert "angle_" in found and case.logs[log].file in found
    size, unit = says
    assert float(found.split(unit)[0].split()[-1]) == pytest.approx(size, rel=0.1)


def test_a_log_in_another_unit_shows_by_its_references_and_limits():
    """Nominal and measured tensions agree, since both follow the wrong references."""
    columns = [c for c in case_of().logs[SECOND].log.columns if c.startswith("tension")]
    case = changed(case_of(), lambda newton: 1000.0 * newton, columns, [SECOND])
    (found,) = suspicions(case, ROBOT)
    assert "tension_ref_AF, tension_ref_MF, tension_ref_AE of c.csv: another unit than N?" in found
    largest = np.abs(case.logs[SECOND].log["tension_ref_AF"]).max()
    assert f"tension_ref_AF reaches {largest:.4g} N, the limit in the robot file is 12 N" in found


@pytest.mark.parametrize("log", [SECOND, HELD])
@pytest.mark.parametrize(("rate", "word"), [(0.0, ""), (2e-3, "later"), (-2e-3, "earlier")])
def test_a_camera_with_a_clock_of_its_own_is_named_with_its_rate(log, rate, word):
    case = case_of()
    rows = np.arange(len(case.logs[log].log))
    drifting = changed(case, lambda angle: np.interp((1.0 - rate) * rows, rows, angle), ANGLES, [log])
    found = [sentence for sentence in suspicions(drifting, ROBOT) if "clock of its own" in sentence]
    assert len(found) == bool(rate)
    for sentence in found:
        assert f"angle_MCP, angle_PIP, angle_DIP in {case.logs[log].file} come ever {word}" in sentence
        assert float(sentence.split(" ppm")[0].split("(")[-1]) == pytest.approx(1e6 * abs(rate), rel=0.5)


@pytest.mark.parametrize(("columns", "end"), [(TENSIONS, 2.0), (ANGLES, 0.2)])
def test_clipped_signals_of_all_logs_are_named(columns, end):
    case = case_of()
    beyond = np.mean([item.log[columns[0]] > end for item in case.logs[2:]])
    assert 0.05 < beyond < 0.95
    clipped = changed(case, lambda values: np.minimum(values, end), columns)
    assert "clipped_channels" in fired(clipped) and "clipped_channels" not in fired(case)


def servo_case(robot, sigma, effect=""):
    """Two logs of a servo whose reading has another noise than its file states."""
    own = robot.with_parameters({f"reading.sigma.{j}": sigma for j in robot.machine.axes.joints}, source="test")
    time = np.arange(1500.0) / 50.0
    joints = len(robot.machine.axes.joints)
    logs = []
    for k, role in enumerate(("fit", "holdout")):
        course = 0.3 * np.sin(time[:, None] * (1.0 + 0.3 * k) + np.arange(joints))
        start = np.tile(course[:1], (len(time), 1))
        rest = np.zeros((len(time), reference_width(robot.machine) - 2 * joints))
        motion = exo.Reference(np.hstack([course, start, rest]), role)
        logs.append(exo.CaseLog(exo.simulate(own, motion, seed=k), role, role, None, f"{role}.csv"))
    return exo.Case("servo", {}, tuple(logs), robot.machine.frame)


@pytest.mark.parametrize(("factor", "word"), [(3.0, "noisier"), (1.0, ""), (0.3, "quieter")])
def test_the_noise_of_servos_is_compared_with_the_robot_file_both_ways(factor, word):
    """The sentence says what the logs show and what to set."""
    robot = exo.load_robot("dvrk_wrist")
    stated = 0.002  # rad, reading.sigma of the file
    found = [s for s in suspicions(servo_case(robot, factor * stated), robot) if "noise in the logs" in s]
    assert len(found) == bool(word)
    for sentence in found:
        assert f"{word} sensors? {'Set' if word == 'noisier' else 'If quieter, set'} reading.sigma" in sentence
        shown = float(sentence.split("logs is ")[1].split("°")[0])
        assert shown == pytest.approx(np.degrees(factor * stated), rel=0.1)


@pytest.mark.parametrize(("factor", "named"), [(2.0, False), (8.0, True)])
def test_noise_counts_beside_the_stated_repeatability_of_servos_and_in_all_logs(factor, named):
    """A diagnosis takes residuals for noise up to the larger of both; what is fast in one log alone is no noise."""
    robot = exo.load_robot("dvrk_wrist")
    stated = robot.with_parameters({"reading.repeatability": 4.0 * 0.002}, source="test")
    said = suspicions(servo_case(stated, factor * 0.002), stated)
    assert [("Set reading.sigma and reading.repeatability" in s) for s in said] == [True] * named
    columns = [f"angle_{j}" for j in robot.machine.axes.joints]
    case = changed(servo_case(robot, 0.002), lambda v: v + 0.01 * (-1.0) ** np.arange(len(v)), columns, [0])
    assert not [sentence for sentence in suspicions(case, robot) if "noise in the logs" in sentence]


@pytest.mark.parametrize("column", [TENSIONS[0], STROKES[1], ANGLES[2]])
def test_a_log_of_a_robot_with_another_zero_is_named(column):
    case = case_of("sensor.gain")
    case = replace(case, logs=tuple(replace(item, repeats=None) for item in case.logs))
    assert fired(case) == set()
    assert fired(changed(case, lambda v: v + 3.0 * v.std(), [column], [REPEAT])) - {"unlike_other_logs"} == {
        "logs_of_other_robots"
    }
    alone = replace(case, logs=case.logs[:2])  # two logs tell no usual error, but states that are alike
    assert fired(alone) == {"nothing_held_out"}
    assert "logs_of_other_robots" in fired(changed(alone, lambda v: v + 3.0 * v.std(), [column], [1]))


@pytest.mark.parametrize(("one", "other"), [TENSIONS[:2], STROKES[1:], ANGLES[:2]])
def test_exchanged_columns_are_named(one, other):
    case = exchanged(case_of("sensor.gain"), one, other)
    assert fired(case) == {"exchanged_columns"}
    assert f"{one} like {other}, {other} like {one}" in suspicions(case, ROBOT)[0]


@pytest.mark.parametrize("part", [slice(None), slice(100, 900)])
@pytest.mark.parametrize("constant", [0.0, 0.002])
def test_a_held_out_log_with_fitted_samples_is_named(part, constant):
    case = case_of("sensor.gain")
    copied = held_out(case, case.logs[SECOND].log.rows(part))
    assert fired(changed(copied, lambda v: v + constant, STROKES + TENSIONS, [HELD])) - {"unlike_other_logs"} == {
        "copied_logs"
    }


def test_coarse_logs_that_repeat_a_motion_are_no_copies_of_each_other():
    """Few of their windows are unlike; a copy of one, cut, still is one."""
    case, step = case_of("sensor.gain"), 0.1
    columns = [c for c in case.logs[0].log.signals if c != "time"]

    def record(k):
        turns = np.cumsum(np.random.default_rng(k).standard_normal(1200)) / 100.0
        swing = step * np.rint((2.0 + 1.9 * np.sin(0.05 * np.arange(1200) + turns)) / step)
        return case.logs[k].log.rows(slice(0, 1200)).with_signals(dict.fromkeys(columns, swing), {})

    logs = [replace(item, log=record(k), repeats=None) for k, item in enumerate(case.logs)]
    assert "copied_logs" not in fired(replace(case, logs=tuple(logs)))
    logs[HELD] = replace(logs[HELD], log=logs[0].log.rows(slice(100, 900)))
    assert "copied_logs" in fired(replace(case, logs=tuple(logs)))


def test_a_case_without_held_out_log_says_so():
    case = case_of("sensor.gain")
    assert fired(replace(case, logs=case.logs[:HELD])) == {"nothing_held_out"}


def case_on(robot, *references):
    """Logs of a robot on references (frames, tendons) [N], the last held out."""
    logs = [exo.simulate(robot, exo.Reference(one, "hold"), seed=20 + k) for k, one in enumerate(references)]
    names = [f"{k}.csv" for k in range(len(logs))]
    roles = ["fit"] * (len(logs) - 1) + ["holdout"]
    items = (exo.CaseLog(*one) for one in zip(logs, names, roles, [None] * len(logs), names, strict=True))
    return exo.Case("held", {}, tuple(items))


def held(*levels):
    """Constant references (500, tendons) [N]."""
    return [np.full((500, 3), level) for level in levels]


@pytest.mark.parametrize("effect", ["", "sensor.gain", "encoder.homing_offset"])
def test_a_case_in_which_nothing_moves_says_so(effect):
    """Eight seconds at 0.3 N after two in which the loop settles; the reference is recorded with noise or without."""
    case = case_on(ROBOT.splice(effect) if effect else ROBOT, *held(0.3, 0.3))
    settled = replace(case, logs=tuple(replace(one, log=one.log.rows(slice(100, None))) for one in case.logs))
    rng = np.random.default_rng(6)
    recorded = changed(settled, lambda v: v + 1e-3 * rng.standard_normal(len(v)), ["tension_ref_AF"], range(2))
    assert "nothing_moves" in fired(settled) and "nothing_moves" in fired(recorded)
    assert any("hardly any effect can show" in sentence for sentence in suspicions(settled, ROBOT))


@pytest.mark.parametrize(
    ("effect", "references"),
    [
        ("", held(0.3, 2.0, 0.3)),  # another level in the second log to fit
        ("", [np.vstack(held(0.3, 2.0)), *held(0.3)]),  # one step
        ("finger.tremor", held(0.3, 0.3)),  # the finger moves itself
    ],
)
def test_a_case_in_which_something_moves_does_not_say_that_nothing_does(effect, references):
    case = case_on(ROBOT.splice(effect) if effect else ROBOT, *references)
    assert "nothing_moves" not in fired(case)
    if len(references[0]) > 500:  # nor where no channel follows the step of the reference
        columns = [column for column in case.logs[0].log.columns if "_ref_" not in column]
        assert "nothing_moves" not in fired(changed(case, noisy, columns, [0]))


def test_a_repeat_with_another_reference_is_refused_by_file_column_and_row():
    case = case_of()
    items = list(case.logs)
    log = items[REPEAT].log
    other = log["tension_ref_MF"].copy()
    other[700:] += 0.5
    items[REPEAT] = replace(items[REPEAT], log=log.with_signals({"tension_ref_MF": other}))
    with pytest.raises(exo.InputError, match=r"b\.csv: column 'tension_ref_MF', row 702.* a\.csv") as refused:
        check_case(replace(case, logs=tuple(items)), ROBOT.machine)
    assert len(str(refused.value)) <= 300


@pytest.mark.filterwarnings("error")
def test_empty_constant_and_half_empty_columns_break_no_check():
    case = changed(case_of(), lambda v: np.full_like(v, np.nan), ANGLES[:1])
    case = changed(changed(case, np.zeros_like, STROKES), with_gap, TENSIONS[:1])
    assert fired(case) == {"gaps", "frozen_channels"}
    compared = compare(case_of(), ROBOT.with_parameters({"finger.kappa": np.inf}))  # diverges, as a diagnosis may try
    assert {channel.column for channel in compared.channels} == {*compared.columns} - {*ANGLES}
    case = changed(case_of(), lambda angle: angle + 0.3, ANGLES)  # in all logs alike
    assert not [sentence for sentence in suspicions(case, ROBOT) if "do not follow" in sentence]


@pytest.mark.parametrize("name", machine_folders())
def test_every_machine_is_checked(name):
    """Sums of sines on each reference, initial values at rest; the unit of the first compared kind is then wrong."""
    robot = exo.load_robot(name)
    machine, time = robot.machine, np.arange(1000.0)
    rng, columns = np.random.default_rng(3), []
    low, high = robot.reference_limits()
    for reference in machine.references:
        for k in range(machine.column_width(reference.kind)):
            moves = reference is machine.references[0]
            phases = [rng.uniform(50.0, 200.0, 3), rng.uniform(0.0, 6.0, 3)]
            course = np.sin(time[:, None] / phases[0] + phases[1]).sum(axis=1) / 6.0 + 0.5
            columns.append((low[k] + course * min(high[k] - low[k], 1.0)) * moves)
    motion = exo.Reference(np.column_stack(columns), "sines")
    back = exo.Reference(motion.values[::-1], "back")
    logs = [
        exo.CaseLog(exo.simulate(robot, course, seed=k), role, role, None, f"{role}.csv")
        for k, (course, role) in enumerate(((motion, "fit"), (back, "holdout")))
    ]
    case = exo.Case("sines", {}, tuple(logs), machine.frame)
    assert fired(case, robot) == set()
    wrong = [c for c in logs[0].log.columns if c.rsplit("_", 1)[0] == machine.compared[0]]
    assert fired(changed(case, lambda v: 1000.0 * v, wrong, range(2)), robot) == {"another_unit"}
