"""When the gap of a watched robot rose: a tendon that loosens on the way, and one that was loose from the begin."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binomtest

import exodrake as exo
from exodrake.data.formats import write_log
from exodrake.data.log import Log
from exodrake.monitor.alarm import rise
from exodrake.monitor.gap import work
from exodrake.monitor.watcher import Monitor, follow

NOMINAL = exo.load_robot()
LOOSENED = 30.0  # s


def test_a_rise_is_dated_and_steady_power_is_not():
    """Power of 50 samples a second, nine degrees of freedom each: a rise by 3 at a known second, and none."""
    rng, steady, dated = np.random.default_rng(0), 0, 0
    for _ in range(60):
        powers = rng.chisquare(9, 60) / 9
        steady += rise(powers, 100) is None
        powers[46:] *= 3.0  # from 86 s on
        found = rise(powers, 100)
        dated += found is not None and found[0] <= 86.0 <= found[1]
    assert binomtest(steady, 60, 0.98, alternative="less").pvalue > 0.01
    assert binomtest(dated, 60, 0.9, alternative="less").pvalue > 0.01


@pytest.mark.parametrize("correlation", [0.5, 0.8])
def test_power_that_follows_the_motion_is_no_rise(correlation):
    """Log powers of a first-order autoregression: a rise is dated at the level of a steady power, 2 %."""
    rng, dated = np.random.default_rng(1), 0
    for _ in range(60):
        logs = lfilter([1.0], [1.0, -correlation], rng.standard_normal(160))[100:]
        dated += rise(np.exp(logs), 100) is not None
    assert binomtest(dated, 60, 0.02, alternative="greater").pvalue > 0.01


def test_a_rise_of_power_that_follows_the_motion_is_dated():
    """A rise by five standard deviations of the steps from second to second."""
    rng, dated = np.random.default_rng(2), 0
    for _ in range(40):
        logs = lfilter([1.0], [1.0, -0.5], rng.standard_normal(160))[100:]
        logs[40:] += 5.0  # from 80 s on
        found = rise(np.exp(logs), 100)
        dated += found is not None and found[0] <= 80.0 <= found[1]
    assert binomtest(dated, 40, 0.9, alternative="less").pvalue > 0.01


def test_a_rise_of_longer_frames_is_dated_in_seconds():
    """Readings of 2 s each, up to 200 s; the power rises 14 readings before."""
    powers = np.random.default_rng(0).chisquare(9, 60) / 9
    powers[46:] *= 20.0
    low, high = rise(powers, 200, 2.0)
    assert low <= 172.0 <= high and high - low <= 4.0


def test_missing_and_few_seconds_have_no_date():
    assert rise(np.full(60, np.nan), 60) is None and rise(np.ones(3), 3) is None and rise(np.ones(60), 60) is None


@pytest.fixture(scope="module")
def loosening():
    """One motion, from 30 s on of a robot with a slack tendon."""
    motion = work(NOMINAL, 5, 60.0)
    before, after = exo.simulate(NOMINAL, motion, seed=5), exo.simulate(NOMINAL.splice("tendon.slack"), motion, seed=5)
    later = before.time >= LOOSENED
    return Log(before.time, {n: np.where(later, after[n], before[n]) for n in before.columns}, before.units)


def test_a_tendon_that_loosens_on_the_way_raises_a_dated_alarm(tmp_path, loosening):
    write_log(loosening, tmp_path / "log.csv")
    monitor = Monitor(NOMINAL)
    assert [r for r in follow(monitor, tmp_path / "log.csv", 0.0) if r]
    alarm = monitor.alarms[0]
    assert alarm.second > LOOSENED and alarm.rose is not None
    assert alarm.rose[1] >= LOOSENED - 2.0 and alarm.rose[0] <= alarm.second  # slack shows where the tendon lets go
    assert alarm.rose[0] >= LOOSENED - 5.0
