"""Noise inputs, a stream for each signal; replay between measured signals, against the simulator and in pieces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.stats import kstest

import exodrake as exo
from exodrake.engine.inputs import NoiseInputs, RunOptions, input_rows, reading_places, reference_width
from exodrake.engine.run import Replay
from exodrake.model.part import JOINTS, NORMAL, Signal
from exodrake.simulation import protocols

ROBOT = exo.load_robot()
MACHINE = ROBOT.machine


def test_a_further_sensor_leaves_the_noise_of_the_others():
    more = Signal("noise_imu", "-", JOINTS, NORMAL)
    larger = replace(MACHINE, signals=(more, *MACHINE.signals), inputs=("noise_imu", *MACHINE.inputs))
    before, after = NoiseInputs.draw(500, 7, MACHINE), NoiseInputs.draw(500, 7, larger)
    assert set(after) == {*before, "noise_imu"}
    for name, rows in before.items():
        np.testing.assert_array_equal(after[name], rows)


def test_streams_of_two_signals_on_one_axis_are_independent():
    more = Signal("noise_imu", "-", JOINTS, NORMAL)
    larger = replace(MACHINE, signals=(*MACHINE.signals, more), inputs=(*MACHINE.inputs, "noise_imu"))
    noise = NoiseInputs.draw(4000, 7, larger)
    mixed = np.corrcoef(np.hstack([noise[name] for name in ("noise_tension", "noise_angle", "noise_imu")]).T)
    assert np.abs(mixed - np.eye(9)).max() < 4.5 / np.sqrt(4000)  # 36 coefficients, 4.5 sigma each


@pytest.mark.parametrize(
    "name, law", [("noise_tension", "norm"), ("noise_angle", "norm"), ("packet_arrival", "uniform")]
)
def test_a_stream_has_the_distribution_of_its_signal(name, law):
    assert kstest(NoiseInputs.draw(4000, 11, MACHINE)[name].ravel(), law).pvalue > 1e-3


def test_a_longer_run_begins_like_a_shorter_one_and_seeds_differ():
    short, long, other = (NoiseInputs.draw(n, s, MACHINE) for n, s in ((50, 3), (90, 3), (50, 4)))
    for name in short:
        np.testing.assert_array_equal(long[name][:50], short[name])
        assert not np.array_equal(other[name], short[name])


def test_without_a_seed_nothing_is_noisy_and_every_packet_arrives():
    ideal = NoiseInputs.draw(5, None, MACHINE)
    assert not ideal["noise_tension"].any() and not ideal["noise_angle"].any() and (ideal["packet_arrival"] == 1).all()


FRAMES = 60


@pytest.fixture(scope="module")
def log():
    """A log of another robot, 1.2 s of steps."""
    other = ROBOT.splice("tendon.capstan_friction").splice("motor.slow_velocity_loop")
    return exo.simulate(other, exo.Reference(protocols.steps(ROBOT, dwell=0.4).values[:FRAMES]), seed=3)


@pytest.fixture(scope="module")
def inputs(log):
    return input_rows(MACHINE, log.array("tension_ref"), NoiseInputs.draw(FRAMES, None, MACHINE))


@pytest.fixture(scope="module")
def feed(log):
    """Outputs of all segments, smoothed over seven frames, and their rates."""
    rows = savgol_filter(np.concatenate([log.array(s.output) for s in MACHINE.segments], axis=1), 7, 2, axis=0)
    return rows, np.gradient(rows, MACHINE.frame, axis=0)


@pytest.mark.parametrize("name", ["exo_index", "so101", "emps", "tendon_sheath"])
def test_replay_without_fixed_segments_is_the_simulator(name):
    robot = exo.load_robot(name)
    rng = np.random.default_rng(1)
    reference = np.cumsum(0.01 * rng.standard_normal((200, reference_width(robot.machine))), axis=0)
    given = input_rows(robot.machine, reference, NoiseInputs.draw(200, 5, robot.machine))
    rows = Replay(robot.machine, robot.values).step(given.values())
    run = exo.record(robot, exo.Reference(reference), seed=5)
    late = {c.signal for c in robot.machine.columns if c.delay}
    for signal, at in robot.machine.offsets.items():
        if signal not in late:
            np.testing.assert_array_equal(rows[:, at], run.signals[signal])


def test_fixed_segment_of_any_machine_carries_what_was_measured():
    """The drive of EMPS is fed measured positions: its force is the law's, whatever the carriage does."""
    robot = exo.load_robot("emps")
    reference = np.zeros((100, reference_width(robot.machine)))
    position = 0.01 * np.sin(np.arange(100) * 0.05)[:, None]
    feed = np.concatenate([np.zeros_like(position), position], axis=1)
    given = input_rows(robot.machine, reference, NoiseInputs.draw(100, None, robot.machine))
    options = RunOptions(feed=feed, rate=np.zeros_like(feed))
    rows = Replay(robot.machine, robot.values, ["carriage"]).step(given.values(), options)
    force = rows[:, robot.machine.offsets["force"]][:, 0]
    rate = (position[2:, 0] - position[:-2, 0]) / (2 * robot["drive.period"])
    law = robot["drive.gain"] * robot["drive.kv"] * (-robot["drive.kp"] * position[2:, 0] - rate)
    np.testing.assert_allclose(force[2:], law, rtol=1e-9)


def test_replay_in_pieces_gives_the_bits_of_the_whole(inputs, feed):
    whole = Replay(MACHINE, ROBOT.values, ["tendon"]).step(inputs.values(), RunOptions(feed=feed[0], rate=feed[1]))
    replay = Replay(MACHINE, ROBOT.values, ["tendon"])
    cuts = np.split(np.arange(FRAMES), [1, 2, 17, 40])
    parts = [replay.step([v[i] for v in inputs.values()], RunOptions(feed=feed[0][i], rate=feed[1][i])) for i in cuts]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_readings_are_imposed_and_missing_ones_are_simulated(inputs):
    places, at = reading_places(MACHINE), MACHINE.offsets
    readings = np.full((FRAMES, 12), np.nan)
    readings[::2, places["tension"]] = 1.25
    rows = Replay(MACHINE, ROBOT.values).step(inputs.values(), RunOptions(readings=readings))
    assert (rows[::2, at["tension_read"]] == 1.25).all() and (rows[1::2, at["tension_read"]] != 1.25).all()
