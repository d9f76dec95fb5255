"""The model beside a log: in pieces as in one, and as the batch twin and the interpreted replay have it."""

import numpy as np
import pytest

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.replay import replayed, smoothed
from exodrake.monitor.companion import Companion, channels, signals
from exodrake.monitor.feed import LAG
from exodrake.monitor.gap import SKIP, Gap, floors
from exodrake.monitor.motion import session
from exodrake.monitor.segments import FingerReplay, MotorReplay, TendonReplay
from exodrake.monitor.simulator import KINDS, ClosedLoop, silent
from exodrake.simulation.simulate import simulate

NOMINAL = exo.load_robot()
LATE = NOMINAL.splice("timing.mocap_delay", {"delay": 0.033}).splice("tendon.creep")


def measured(log):
    return np.concatenate([log.array(kind) for kind in KINDS], axis=1)


@pytest.fixture(scope="module")
def log():
    return simulate(NOMINAL, session(NOMINAL, 4, 20.0), seed=4)


@pytest.mark.parametrize("robot", [NOMINAL, LATE], ids=["nominal", "late pictures"])
def test_stepped_twin_is_the_batch_twin(robot, log):
    reference = log.array("tension_ref")
    batch = exo.simulate(robot, exo.Reference(reference), seed=None, quantisation=False)
    simulator = ClosedLoop(robot, LAG)
    rows = [simulator.push(reference[i : i + 1], last=i == len(reference) - 1) for i in range(len(reference))]
    np.testing.assert_array_equal(np.concatenate(rows), measured(batch))


def test_pieces_give_the_bits_of_the_whole(log):
    reference, rows = log.array("tension_ref"), measured(log)
    rows[200:230, 2], rows[400], reference[400] = np.nan, np.nan, np.nan
    whole = Companion(LATE).push(reference, rows, last=True)
    companion, cuts = Companion(LATE), np.sort(np.random.default_rng(1).integers(0, len(rows), 40))
    parts = [companion.push(r, m) for r, m in zip(np.split(reference, cuts), np.split(rows, cuts))]
    parts.append(companion.push(reference[:0], rows[:0], last=True))
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert whole.shape == (len(rows), len(channels(LATE))) and np.isnan(whole[400]).all()


def test_replays_are_those_of_the_interpreted_loop(log):
    n, reference = 250, log.array("tension_ref")
    rows = measured(log)[:n]
    columns = tuple(f"{kind}_{channel}" for kind, channel in signals(NOMINAL))
    trial = Trial("log", "fit", reference[:n], rows)
    case = Case("one log", {}, (CaseLog(log, "log", "fit", None, "log.csv"),))
    problem = Problem(NOMINAL, columns, np.ones(12), (trial,), (trial,), case)
    tension, stroke, angle = (smoothed(rows[:, at]) for at in (slice(0, 3), slice(3, 6), slice(9, 12)))
    rates = [np.gradient(x, NOMINAL.machine.frame, axis=0) for x in (tension, stroke, angle)]
    held = replayed(problem, silent(NOMINAL), trial, frozenset({"motor", "finger"}))[:, :3]
    tendon = TendonReplay(NOMINAL).push(stroke, rates[1], angle, rates[2])  # the loop's path lengths are Python's
    np.testing.assert_allclose(tendon, held, rtol=0, atol=1e-12)
    free = replayed(problem, silent(NOMINAL), trial, frozenset({"motor", "tendon"}))[:, 9:]
    np.testing.assert_array_equal(FingerReplay(NOMINAL, 0).push(tension, rates[0], last=True), free)


def test_replayed_motor_turns_commands_into_strokes():
    """A constant speed command on an unloaded wire moves it at that speed, wherever it began."""
    n, speed, frame = 200, 0.004, NOMINAL.machine.frame
    command, still = np.full((n, 3), speed), np.zeros((n, 3))
    strokes = MotorReplay(NOMINAL).push(command, still, still, np.full((n, 3), np.nan))
    np.testing.assert_allclose(np.diff(strokes[50:], axis=0) / frame, speed, rtol=1e-6)
    began = 0.012 + speed * frame * np.arange(n)[:, None] * np.ones(3)
    np.testing.assert_allclose(MotorReplay(NOMINAL).push(command, still, still, began)[100:], began[100:], atol=1e-5)


def test_healthy_gap_is_one_floor_and_counts_by_the_second(log):
    residuals = Companion(NOMINAL).push(log.array("tension_ref"), measured(log), last=True)
    floor = floors(NOMINAL)
    readings = Gap(floor, 0.02).push(residuals)
    last, listed = readings[-1], channels(NOMINAL)
    assert last.second == 20 and len(readings) == 20 - SKIP and last.full
    noisy = np.array([c.segment != "controller" for c in listed])
    assert (last.recent[noisy] < 3.0).all() and (last.recent[noisy] > 0.3).all() and (last.recent[~noisy] == 0.0).all()
    rows = residuals[500:1000] / floor
    np.testing.assert_allclose(last.recent, np.sqrt(np.mean(rows**2, axis=0)), rtol=1e-9)


def test_missing_columns_are_not_judged(log):
    rows = measured(log)
    rows[:, 9:] = np.nan
    last = Gap(floors(NOMINAL), 0.02).push(Companion(NOMINAL).push(log.array("tension_ref"), rows, last=True))[-1]
    for channel, gap in zip(channels(NOMINAL), last.recent):
        assert np.isnan(gap) == (channel.kind == "angle" or channel.segment == "tendon")
