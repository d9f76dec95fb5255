"""The sync pulse: a signal in slot 0 that changes no log, and the clock that its record gives."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.identification.kinematics.markers import clock_from_pulses
from exodrake.systems.sources import SyncPulse


def test_the_pulse_is_high_in_slot_0_of_every_frame_and_changes_no_signal():
    robot, angles = exo.load_robot(), []
    for pulsed in (True, False):
        builder = DiagramBuilder()
        hand = exo.add_exo_index(builder, robot)
        wanted = builder.AddSystem(ConstantVectorSource([5.0, 3.0, 1.0]))
        builder.Connect(wanted.get_output_port(), hand.controller.GetInputPort("tension_ref"))
        angle = LogVectorOutput(hand.finger.GetOutputPort("angle"), builder, 0.002)
        if pulsed:
            pulse = builder.AddSystem(SyncPulse(robot.machine))
            sync = LogVectorOutput(pulse.GetOutputPort("sync"), builder, 0.002)
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(0.4)
        angles.append(angle.FindLog(simulator.get_context()).data())
        if pulsed:
            log = sync.FindLog(simulator.get_context())
            time, level = log.sample_times(), log.data()[0]
            assert (level == (np.round(time / 0.002) % 10 == 0)).all() and level.sum() > 20
    assert np.array_equal(*angles)


def test_start_and_skew_of_the_clock():
    """Pulses of 2 ms every 20 ms (1 + 80 ppm) from 0.1234 s, recorded at 2 kHz, two of them missed."""
    time = np.arange(0.0, 30.0, 5e-4)
    count, place = np.divmod(time - 0.1234, 0.02 * (1.0 + 80e-6))
    level = 3.3 * ((place < 0.002) & (count >= 0) & (count != 7) & (count != 800))
    level += 0.05 * np.random.default_rng(0).standard_normal(len(time))
    start, skew = clock_from_pulses(time, level, 0.02)
    assert start == pytest.approx(0.1234, abs=5e-4)
    assert skew == pytest.approx(80e-6, abs=2e-6)


@pytest.mark.parametrize("level", [np.zeros(100), np.r_[np.zeros(50), np.ones(50)]])
def test_a_record_without_pulses_is_refused(level):
    with pytest.raises(InputError, match="rising edges"):
        clock_from_pulses(0.001 * np.arange(100), level, 0.02)
    with pytest.raises(InputError, match="time does not increase"):
        clock_from_pulses(np.zeros(100), level, 0.02)
