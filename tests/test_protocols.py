"""Protocols: those of the reference data to the last printed digit, limits, names and messages."""

from dataclasses import replace

import numpy as np
import pytest

import exodrake as exo
from exodrake.simulation.protocols import PROTOCOLS

ROBOT = exo.load_robot()
FLOOR, CEILING = np.array([0.3, 0.3, 0.3]), np.array([12.0, 8.0, 8.0])


@pytest.mark.parametrize("name", [*PROTOCOLS, *ROBOT.grasps])
def test_within_reference_limits_and_repeatable(name):
    tension = exo.protocol(name, ROBOT).values
    assert tension.shape[1] == 3
    assert (tension >= FLOOR).all() and (tension <= CEILING + 1e-9).all()
    assert np.array_equal(tension, exo.protocol(name).values)
    assert exo.protocol(name).name == name


def test_the_reference_protocols():
    chirp = exo.chirp().values  # values of the reference log of this protocol
    assert chirp[[25, 125, 375, 525], 0] == pytest.approx([1.435138, 7.998686, 9.008873, 2.725367], abs=1e-6)
    assert chirp[[775, 1425]] == pytest.approx(np.array([[1.8, 6.049792, 1.2], [1.8, 1.2, 1.63591]]), abs=1e-6)
    short = exo.short_sweeps().values
    assert len(short) == 3000
    wanted = np.array([[9.6, 16 / 3, 0.3], [4.0, 6.4, 0.3], [0.3, 0.3, 3.2], [12.0, 0.3, 6.4]])
    assert short[[600, 1350, 2050, 2850]] == pytest.approx(wanted)


def test_the_paper_sweeps_are_a_full_cross():
    tension = exo.sweeps().values.reshape(48, 250, 3)
    held = {(w, *np.round(np.delete(t[0], w), 3)) for w in range(3) for t in tension[16 * w : 16 * w + 16]}
    assert len(held) == 48
    for w in range(3):
        assert np.allclose(tension[16 * w : 16 * w + 16, :, w].max(axis=1), CEILING[w])
        assert (np.delete(tension[16 * w : 16 * w + 16], w, axis=2).std(axis=1) < 1e-12).all()


def test_a_grasp_is_smooth_reaches_its_target_and_lets_go():
    tension = exo.grasp("caging", rest=0.5, approach=1.0, hold=2.0, release=1.0).values
    target = [max(ROBOT.grasps["caging"][w], 0.3) for w in ("AF", "MF", "AE")]
    assert np.allclose(tension[75:175], target) and np.allclose(tension[[0, 25, 225, -1]], FLOOR)
    own = exo.grasp("mine", ROBOT, {"AF": 5.0, "MF": 0.0, "AE": 2.0}).values
    assert np.allclose(own.max(axis=0), [5.0, 0.3, 2.0])
    jerk = np.abs(np.diff(tension, 3, axis=0)).max() / 0.02**3
    assert jerk < 60.1 * CEILING.max()  # minimum-jerk: 60 amplitude / duration^3


def test_multisine_combs_do_not_overlap():
    tension = exo.multisine(period=20.0, repeats=2).values[1000:]
    power = np.abs(np.fft.rfft(tension - tension.mean(axis=0), axis=0)) > 1e-6
    assert power.any(axis=0).all() and power.sum(axis=1).max() == 1
    tension = exo.multisine(high=0.29, period=100.0, repeats=1).values  # the 29th harmonic, though 0.29 * 100.0 < 29.0
    power = np.abs(np.fft.rfft(tension - tension.mean(axis=0), axis=0)) > 1e-6
    assert [int(np.flatnonzero(one).max()) for one in power.T] == [28, 29, 27]
    assert not np.array_equal(exo.random_motion(seed=1).values, exo.random_motion(seed=2).values)


@pytest.mark.parametrize(
    "given, word",
    [
        ("cagin", "did you mean caging"), ("chirp:hi=3", "'hi'"), ("chirp:high=nan", "NaN"), ("chirp:high=99", "high"),
        ("holds:seed=-1", "seed"), ("holds:seed=0.5", "seed"), ("sweeps:period=0", "period"), ("chirp:high", "'high'"),
        ("holds:dwell=-1", "dwell"), ("multisine:high=0", "high"), ("multisine:period=0", "period"),
        ("caging:hold=inf", "hold"), ("holds:count=0", "count"), ("steps:top=2", "top"), ("", "there are caging"),
        ("holds:count=2.7", "count"), ("multisine:repeats=1.9", "repeats"),
    ],
)  # fmt: skip
def test_wrong_names_and_numbers(given, word):
    with pytest.raises(exo.InputError, match=word):
        exo.protocol(given)


@pytest.mark.parametrize(
    "targets, word",
    [({"AF": 1, "MF": 1}, "AE"), ({"AF": 1, "MF": 1, "XX": 1}, "'XX'"), ({"AF": -1, "MF": 1, "AE": 1}, "AF is -1")],
)
def test_wrong_targets(targets, word):
    with pytest.raises(exo.InputError, match=word):
        exo.grasp("mine", ROBOT, targets)


def test_a_log_lends_its_references(tmp_path):
    reference = exo.protocol("steps")
    columns = {f"tension_ref_{w}": reference.values[:, i] for i, w in enumerate(("AF", "MF", "AE"))}
    log = exo.Log(0.02 * np.arange(len(reference.values)), columns)
    exo.write_log(log, tmp_path / "steps.csv")
    for one in (tmp_path / "steps.csv", log):
        assert np.array_equal(exo.from_log(one).values, reference.values)
    bad = columns["tension_ref_MF"].copy()
    for value, word in ((np.nan, "row 9, wanted"), (-1.0, "-1 N in row 9")):
        bad[7] = value
        exo.write_log(log.with_signals({"tension_ref_MF": bad}), tmp_path / "bad.csv")
        with pytest.raises(exo.InputError, match=word):
            exo.from_log(tmp_path / "bad.csv")
    exo.write_log(log.with_signals({"tension_ref_XX": bad}), tmp_path / "more.csv")
    with pytest.raises(exo.InputError, match="'XX'"):
        exo.from_log(tmp_path / "more.csv")
    exo.write_log(exo.Log(0.01 * np.arange(len(log)), columns), tmp_path / "fast.csv")
    with pytest.raises(exo.InputError, match=r"0\.02 s apart"):
        exo.from_log(tmp_path / "fast.csv")


@pytest.mark.parametrize("machine", ["emps", "so101", "tendon_sheath"])
@pytest.mark.parametrize("name", ["chirp", "short-sweeps", "steps", "multisine", "random-motion", "holds"])
def test_a_protocol_of_any_machine_stays_within_its_limits_and_starts_where_it_says(machine, name):
    robot = exo.load_robot(machine)
    low, high = robot.reference_limits()
    rows, width = exo.protocol(name, robot).values, len(low)
    assert (rows[:, :width] >= low - 1e-12).all() and (rows[:, :width] <= high + 1e-12).all()
    assert (np.ptp(rows[:, :width], axis=0) > 0.1 * (high - low)).all()
    assert np.array_equal(rows[:, width : 2 * width], np.tile(rows[0, :width], (len(rows), 1)))


def test_a_machine_without_limits_follows_logs_only():
    robot = replace(exo.load_robot("emps"), limits={})
    with pytest.raises(exo.InputError, match="emps has no limits of position_ref"):
        exo.protocol("chirp", robot)
    with pytest.raises(exo.InputError, match="6 channels would cross in 6144 sweeps"):
        exo.protocol("sweeps", exo.load_robot("so101"))
