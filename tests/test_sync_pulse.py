"""The sync pulse: a signal in slot 0 that changes no log, and the clock that its record gives."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.diagrams.signal_log import FINE_LOG
from exodrake.diagrams.sync_pulse import SyncPulse
from exodrake.identification.sync import clock_from_pulses


def test_the_pulse_is_high_in_slot_0_of_every_frame_and_changes_no_signal():
    robot = exo.load_robot()
    reference = exo.grasp("caging", robot, hold=0.5)
    tables = []
    for systems in ([SyncPulse(robot.machine)], []):
        diagram = exo.build_diagram(robot, reference, seed=1, fine_log=True, systems=systems)
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.4)
        tables.append(exo.logged_signals(diagram, simulator.get_context(), FINE_LOG))
    level = tables[0].pop("sync")[:, 0]
    assert (level == ((tables[0]["time"] % 0.02) < 0.002)).all() and level.sum() == 20
    assert tables[0].keys() == tables[1].keys()
    assert all(np.array_equal(rows, tables[1][name], equal_nan=True) for name, rows in tables[0].items())


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
