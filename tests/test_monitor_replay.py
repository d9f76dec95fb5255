"""The model beside a log: the same in pieces as in one, and the same as the simulator."""

import numpy as np
import pytest

import exodrake as exo
from exodrake.monitor.alarm import SKIP, WINDOW, Gap, draw_work, measure_noise, replay_log
from exodrake.simulation.segments import LOOP, OnlineReplay, SegmentReplay, list_channels

NOMINAL = exo.load_robot()
LATE = NOMINAL.splice("timing.mocap_delay", {"delay": 0.033}).splice("tendon.creep")
LISTED = list_channels(NOMINAL.machine)


def measured_in(log, robot=NOMINAL):
    return np.column_stack([log[c.column] for c in list_channels(robot.machine) if c.segment == LOOP])


@pytest.fixture(scope="module")
def log():
    return exo.simulate(NOMINAL, draw_work(NOMINAL, 4, 20.0), seed=4)


@pytest.mark.parametrize("robot", [NOMINAL, LATE], ids=["nominal", "delayed samples"])
def test_closed_loop_stepped_by_frames_is_the_simulator(robot, log):
    reference, rows = log.array("tension_ref"), measured_in(log)
    batch = measured_in(exo.simulate(robot, exo.Reference(reference), seed=None, quantisation=False))
    online, n = OnlineReplay(robot), len(rows)
    residuals = np.concatenate([online.push(reference[i : i + 1], rows[i : i + 1], i == n - 1) for i in range(n)])
    loop = np.array([c.segment == LOOP for c in LISTED])
    np.testing.assert_array_equal(residuals[:, loop], rows - batch)


def test_pieces_give_the_bits_of_the_whole(log):
    reference, rows = log.array("tension_ref"), measured_in(log)
    rows[200:230, 2], rows[400], reference[400] = np.nan, np.nan, np.nan
    whole = OnlineReplay(LATE).push(reference, rows, last=True)
    online, cuts = OnlineReplay(LATE), np.sort(np.random.default_rng(1).integers(0, len(rows), 40))
    cuts = [0, *cuts]  # nothing comes first, as of a robot that has yet to start
    parts = [online.push(r, m) for r, m in zip(np.split(reference, cuts), np.split(rows, cuts))]
    parts.append(online.push(reference[:0], rows[:0], last=True))
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert whole.shape == (len(rows), len(LISTED)) and np.isnan(whole[400]).all()


def test_any_machine_is_replayed_and_its_own_log_has_the_gap_of_its_noise():
    robot = exo.load_robot("emps")
    reference = np.zeros((3000, 3))
    reference[:, 0] = 0.05 * (1.0 - np.cos(np.arange(3000) * robot.machine.frame))
    own = exo.simulate(robot, exo.Reference(reference), seed=1)
    listed = list_channels(robot.machine)
    assert [c.segment for c in listed] == [LOOP, LOOP, "carriage", "drive"]
    gap = np.sqrt(np.nanmean(replay_log(robot, exo.Reference(reference), own) ** 2, axis=0)) / measure_noise(robot)
    assert (gap[[0, 1, 3]] < 1.0).all()


def test_replayed_motor_turns_commands_into_strokes():
    """A constant speed command on unloaded tendons moves them at that speed, wherever they began."""
    n, speed, frame = 200, 0.004, NOMINAL.machine.frame
    segment = next(s for s in NOMINAL.machine.segments if s.name == "motor")
    stroke = exo.simulate(NOMINAL, exo.Reference(np.zeros((1, 3)))).columns.index("stroke_AF") - 3
    inputs = [np.zeros((n, 3))] * 3 + [np.ones((n, 3))]
    feed, held = np.zeros((n, 12)), np.zeros((n, 12))

    def strokes(began):
        measured = np.full((n, 12), np.nan)
        measured[:, [c == "speed_cmd" for c in kinds]] = speed
        measured[:, stroke : stroke + 3] = began
        record = SegmentReplay(NOMINAL, segment).push(inputs, feed, feed, held, measured)
        return record[:, at]

    kinds = [kind for kind in NOMINAL.machine.compared for _ in range(3)]
    signals = [s.name for s in NOMINAL.machine.signals for _ in range(NOMINAL.machine.width(s.axis))]
    at = [name == "stroke_read" for name in signals]
    np.testing.assert_allclose(np.diff(strokes(np.nan)[50:], axis=0) / frame, speed, rtol=0.1)
    began = 0.012 + speed * frame * np.arange(n)[:, None] * np.ones(3)
    np.testing.assert_allclose(strokes(began)[100:], began[100:], atol=1e-5)


def test_healthy_gap_is_one_noise_standard_deviation_and_counts_by_the_second(log):
    residuals = replay_log(NOMINAL, exo.Reference(log.array("tension_ref")), log)
    noise = measure_noise(NOMINAL)
    readings = Gap(noise, 0.02).push(residuals)
    last = readings[-1]
    assert last.second == 20 and len(readings) == 20 - SKIP and last.full
    noisy = np.array([c.segment != "controller" for c in LISTED])
    assert (last.recent[noisy] < 3.0).all() and (last.recent[noisy] > 0.3).all() and (last.recent[~noisy] == 0.0).all()
    rows = residuals[500:1000] / noise
    np.testing.assert_allclose(last.recent, np.sqrt(np.mean(rows**2, axis=0)), rtol=1e-9)


def test_missing_columns_are_not_judged(log):
    rows = measured_in(log)
    rows[:, 9:] = np.nan
    last = Gap(measure_noise(NOMINAL), 0.02).push(
        OnlineReplay(NOMINAL).push(log.array("tension_ref"), rows, last=True)
    )[-1]
    for channel, gap in zip(LISTED, last.recent):
        assert np.isnan(gap) == (channel.kind == "angle" or channel.segment == "tendon")


def test_missing_commands_are_those_of_the_control_law(log):
    """Without speed commands the motor is replayed with the commands that the controller must have given."""
    rows = measured_in(log)
    whole = OnlineReplay(NOMINAL).push(log.array("tension_ref"), rows, last=True)
    rows[:, 6:9] = np.nan
    without = OnlineReplay(NOMINAL).push(log.array("tension_ref"), rows, last=True)
    motor = np.array([c.segment == "motor" for c in LISTED])
    np.testing.assert_allclose(without[:, motor], whole[:, motor], atol=1e-12)


@pytest.mark.parametrize("frame", [0.02, 0.03, 0.3, 1.0, 2.0])
def test_readings_keep_the_time_of_frames_that_do_not_divide_a_second(frame):
    frames = round(300.0 / frame)
    readings = Gap(np.ones(1), frame).push(np.ones((frames, 1)))
    assert readings[-1].second == pytest.approx(300.0, abs=max(1.0, frame))
    assert next(r.second for r in readings if r.full) == pytest.approx(SKIP + WINDOW, abs=max(1.0, frame))
