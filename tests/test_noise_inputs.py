"""Noise inputs: a stream for each signal, seeded by its name."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from exodrake.engine.inputs import NoiseInputs
from exodrake.machines.robot_file import load_robot
from exodrake.model.part import JOINTS, NORMAL, Signal

MACHINE = load_robot().machine


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
