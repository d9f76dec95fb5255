"""The estimator: sweeps, the Gaussian process against scikit-learn, zeros of strokes, its file and commands."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from estimator_sweeps import JOINTS, as_log, as_sweeps, reference, trained, worn_sweeps
from sklearn.gaussian_process import GaussianProcessRegressor

from exodrake.core.errors import InputError
from exodrake.data.formats import read_log, write_log
from exodrake.estimator.dataset import cut, read_session, sweeps_from_logs
from exodrake.estimator.gp import (
    FALSE,
    JITTER,
    TOLERANCE,
    condition,
    estimator_bytes,
    hotelling,
    leave_one_sweep_out,
    load,
)
from exodrake.estimator.validate import HELD_OUT, RANDOM, estimate, fit_ridge, score, validate
from exodrake.physics.gp_estimator import predict_into, predict_rows, scratch


def test_ramps_up_and_down_are_cut_where_they_were_joined():
    data = worn_sweeps(24, seed=0, rows=100)
    label = cut(data["tension_ref"], 0.02)
    assert label[-1] == 23
    assert np.mean(label != data["sweep"]) < 0.02
    loading = worn_sweeps(12, seed=0, rows=100, up_only=True)  # cut at the drop
    assert np.mean(cut(loading["tension_ref"], 0.02) != loading["sweep"]) < 0.02


def test_a_staircase_and_a_log_without_ramps_are_one_sweep():
    stairs = np.repeat(reference(0, (0.0, 0.0), 100, up_only=True)[::20], 30, axis=0)
    slow = np.concatenate([np.linspace(0.3, 4, 50), np.full(50, 4.0), np.linspace(4, 8, 50)])
    assert cut(stairs, 0.02).max() == 0
    assert cut(np.column_stack([slow, slow * 0, slow * 0]), 0.02).max() == 0


def test_logs_join_with_their_own_labels_and_may_stay_whole():
    first, second = as_log(worn_sweeps(6, seed=0, rows=60)), as_log(worn_sweeps(6, seed=1, rows=60), "other.csv")
    assert sweeps_from_logs([first, second]).count == 12
    joined = sweeps_from_logs([first, second], one_per_log=["other.csv"])
    assert joined.count == 7
    assert joined.logs == ("worn.csv", "other.csv")


def test_bad_logs_are_refused_by_name():
    data = worn_sweeps(6, seed=0, rows=60)
    log = as_log(data)
    blind = log.only([name for name in log.columns if not name.startswith("angle_")])
    broken = log.with_signals({"stroke_MF": np.where(np.arange(len(log)) == 7, np.nan, log["stroke_MF"])})
    with pytest.raises(InputError, match="of none, the estimator needs some"):
        sweeps_from_logs([blind])
    with pytest.raises(InputError, match="stroke_MF', row 8"):
        sweeps_from_logs([broken])
    with pytest.raises(InputError, match="too few sweeps: 2"):
        sweeps_from_logs([log.between(0.0, 2.0)])
    with pytest.raises(InputError, match="no logs"):
        sweeps_from_logs([])
    with pytest.raises(InputError, match="of AF, MF, AE, the estimator needs AF, XF"):
        read_session(log, ("AF", "XF"), ())


def reference_process(prior, sweeps):
    """scikit-learn's process with the learnt covariance, not optimised again."""
    process = GaussianProcessRegressor(prior.kernel, alpha=JITTER, optimizer=None)
    return process.fit(prior.rows(sweeps), prior.targets(sweeps))


def test_prediction_is_that_of_scikit_learn():
    prior, estimator, sweeps = trained()
    fresh = as_sweeps(worn_sweeps(3, seed=50, rows=40))
    mean, std, _ = estimator.predict(fresh.tension, fresh.stroke)
    process = reference_process(prior, sweeps.select_equispaced(500))
    wanted, wanted_std = process.predict(prior.rows(replace(fresh, sweep=fresh.sweep + 1000)), return_std=True)
    scale = estimator.weights.spread
    np.testing.assert_allclose(mean, prior.offset + prior.gain * wanted, atol=1e-8)
    np.testing.assert_allclose(std / scale, wanted_std, atol=1e-8)


def test_one_sample_rows_and_the_writing_form_agree_to_the_last_bit():
    _, estimator, sweeps = trained()
    weights, work, mean, std = estimator.weights, scratch(estimator.weights), np.empty(3), np.empty(3)
    many, many_std, _ = estimator.predict(sweeps.tension[:5], sweeps.stroke[:5])
    for row in range(5):
        one = [rows[0] for rows in predict_rows(sweeps.tension[[row]], sweeps.stroke[[row]], weights)[:2]]
        predict_into(sweeps.tension[row], sweeps.stroke[row], weights, work, mean, std)
        assert np.array_equal(one[0], many[row]) and np.array_equal(one[1], many_std[row])
        assert np.array_equal(mean, many[row]) and np.array_equal(std, many_std[row])


def test_leaving_a_sweep_out_in_closed_form_is_fitting_without_it():
    prior, _, sweeps = trained()
    few = sweeps.rows(np.flatnonzero(sweeps.sweep < 6)[::15])
    covariance = prior.kernel(prior.rows(few)) + JITTER * np.eye(len(few))
    residual, variance = leave_one_sweep_out(np.linalg.inv(covariance), prior.targets(few), few.sweep)
    for label in np.unique(few.sweep):
        out = few.sweep == label
        process = reference_process(prior, few.rows(~out))
        mean, std = process.predict(prior.rows(few.rows(out)), return_std=True)
        np.testing.assert_allclose(residual[out], prior.targets(few.rows(out)) - mean, atol=1e-8)
        np.testing.assert_allclose(np.sqrt(variance[out]), std[:, 0], atol=1e-8)


def test_fresh_sweeps_of_the_same_wearer_keep_the_promise():
    """Sweeps drawn anew: RMSE within 0.03 rad and no worse than the ridge, 95 % intervals that hold 90 to 98 %."""
    _, estimator, sweeps = trained()
    fresh = as_sweeps(worn_sweeps(96, seed=60, rows=125))
    mean, std, _ = estimator.predict(fresh.tension, fresh.stroke)
    process = score("process", "fresh", fresh.angle, mean, std)
    ridge = score("ridge", "fresh", fresh.angle, *fit_ridge(sweeps)(fresh))
    assert process.mean_rmse < 0.03
    assert process.mean_rmse < 1.05 * ridge.mean_rmse
    assert process.loss < ridge.loss
    assert np.all((process.coverage > 0.90) & (process.coverage < 0.98)), process.coverage


def test_validation_shows_both_splits_and_that_looking_up_fails_on_the_second():
    prior, _, sweeps = trained()
    found = {(s.method, s.split): s for s in validate(prior, sweeps.rows(np.arange(0, len(sweeps), 4)))}
    assert len(found) == 6
    nearest = {split: found["nearest row", split].mean_rmse for split in (RANDOM, HELD_OUT)}
    process = {split: found["Gaussian process", split].mean_rmse for split in (RANDOM, HELD_OUT)}
    assert nearest[HELD_OUT] > 2 * nearest[RANDOM]
    assert process[HELD_OUT] < 0.03 and process[HELD_OUT] > process[RANDOM]
    assert found["Gaussian process", HELD_OUT].coverage == pytest.approx(np.full(len(JOINTS), 0.95), abs=0.04)


SESSIONS, SWEEPS = 25, 3  # of three sweeps each: one per wire
WIRES = np.eye(3)


@pytest.fixture(scope="module")
def healthy():
    """Sessions of the same wearer, each of three sweeps drawn anew."""
    joined = as_sweeps(worn_sweeps(SESSIONS * SWEEPS, seed=200, rows=60))
    return [joined.rows(joined.sweep // SWEEPS == number) for number in range(SESSIONS)]


def shifted(session, zero):
    return replace(session, inputs=session.inputs + np.r_[0, 0, 0, zero])


def test_one_millimetre_on_any_wire_is_found_and_nothing_where_nothing_moved(healthy):
    """Wanted: at least 95 % of 1 mm on any one wire, at most 2 % false."""
    estimator = trained()[1]
    assert not any(estimator.zeros(session).moved for session in healthy)
    assert not estimator.zeros(shifted(healthy[0], np.full(3, TOLERANCE / 2))).moved
    for wire in WIRES:
        found = [estimator.zeros(shifted(session, 1e-3 * wire)) for session in healthy]
        assert np.mean([zeros.moved for zeros in found]) >= 0.95, wire
        assert not any(zeros.unlike for zeros in found)


def test_zeros_are_those_injected_within_their_intervals(healthy):
    estimator, injected = trained()[1], np.array([4e-4, -9e-4, 6e-4])
    found = [estimator.zeros(shifted(session, injected)) for session in healthy]
    errors = np.array([zeros.shift - injected for zeros in found])
    inside = np.mean(np.abs(errors) <= [zeros.half_widths for zeros in found])
    assert 0.88 < inside <= 1.0
    assert np.all(np.abs(errors.mean(axis=0)) < 1e-4)


def test_zero_of_mf_off_by_half_a_millimetre_is_corrected():
    """From 0.07 rad and less than half inside, to about the error of a session that was not re-donned."""
    estimator = trained()[1]
    session = as_sweeps(worn_sweeps(12, seed=300, rows=60, zero=np.array([0, 5e-4, 0])))
    zeros = estimator.zeros(session)
    before, after = (
        score("", "", session.angle, *one.predict(session.tension, session.stroke)[:2])
        for one in (estimator, estimator.correct_zeros(zeros, session))
    )
    assert zeros.moved and zeros.shift == pytest.approx([0, 5e-4, 0], abs=2.5e-4)
    assert before.mean_rmse > 0.06 and np.mean(before.coverage) < 0.6
    assert after.mean_rmse < 0.03 and np.all(after.coverage > 0.88)


def test_contact_is_no_shift_of_zeros():
    """Strokes stop half way while tensions rise, as where an object holds the finger."""
    estimator, session = trained()[1], as_sweeps(worn_sweeps(6, seed=5, rows=60))
    stopped = np.minimum(session.stroke, np.quantile(session.stroke, 0.5, axis=0))
    found = estimator.zeros(replace(session, inputs=np.hstack([session.tension, stopped])))
    assert found.unlike and not found.moved


@pytest.mark.parametrize("sweeps", [6, 12])
def test_hotelling_quantile_is_that_of_drawn_shifts(sweeps):
    """Shifts of three wires over their covariance about 0 in other sweeps, all of one normal law."""
    rng = np.random.default_rng(sweeps)
    shift, others = rng.standard_normal((200_000, 3)), rng.standard_normal((200_000, sweeps, 3))
    covariance = np.einsum("kni,knj->kij", others, others) / sweeps
    distance = np.einsum("ki,ki->k", shift, np.linalg.solve(covariance, shift[:, :, None])[:, :, 0])
    assert np.mean(distance > hotelling(3, sweeps)) == pytest.approx(FALSE, rel=0.1)


def test_estimate_of_a_log_corrects_unless_switched_off():
    estimator = trained()[1]
    log = as_log(worn_sweeps(3, seed=11, rows=60, zero=np.array([0, 1e-3, 0])))
    corrected, kept = estimate(estimator, log), estimate(estimator, log, correct=False)
    assert corrected.zeros.moved and corrected.score.mean_rmse < kept.score.mean_rmse / 3
    prior, _, sweeps = trained()
    with pytest.raises(InputError, match="train it again"):
        condition(prior, sweeps, 60).zeros(sweeps)
    without = estimate(replace(estimator, strokes=None), log)
    assert without.zeros is None and without.score.mean_rmse == kept.score.mean_rmse


def test_a_saved_estimator_predicts_the_same_bits(tmp_path):
    _, estimator, sweeps = trained()
    (tmp_path / "e.npz").write_bytes(estimator_bytes(estimator, {"held-out": [0.02]}))
    back = load(tmp_path / "e.npz")
    for one, other in zip(
        estimator.predict(sweeps.tension[:9], sweeps.stroke[:9]), back.predict(sweeps.tension[:9], sweeps.stroke[:9])
    ):
        assert np.array_equal(one, other)
    assert (back.wires, back.joints, back.logs, back.sweeps) == (estimator.wires, estimator.joints, ("worn",), 48)
    assert np.array_equal(back.zeros(sweeps).shift, estimator.zeros(sweeps).shift)
    with np.load(tmp_path / "e.npz", allow_pickle=False) as archive:
        record = json.loads(str(archive["record"]))
    assert record["units"]["stroke"] == "m" and record["notes"] == {"held-out": [0.02]}


def test_what_is_no_estimator_is_refused(tmp_path):
    _, estimator, _ = trained()
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "pickled.npz", record=np.array([{}], dtype=object))
    for name in ("text.npz", "other.npz", "pickled.npz"):
        with pytest.raises(InputError, match=f"{name}: not a"):
            load(tmp_path / name)
    (tmp_path / "e.npz").write_bytes(estimator_bytes(estimator))
    with pytest.raises(InputError, match="another robot"):
        load(tmp_path / "e.npz", robot="0" * 64)
    data = dict(np.load(tmp_path / "e.npz"))
    np.savez(tmp_path / "short.npz", **{**data, "factor": data["factor"][:-1]})
    with pytest.raises(InputError, match="damaged"):
        load(tmp_path / "short.npz")
    np.savez(tmp_path / "odd.npz", **{**data, "strokes_time": data["strokes_time"][:-1]})
    with pytest.raises(InputError, match="damaged"):
        load(tmp_path / "odd.npz")
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "absent.npz")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two training logs, a fresh one, and the estimator trained on the first two with 120 points."""
    folder = tmp_path_factory.mktemp("estimator")
    for name, seed in (("a", 0), ("b", 1), ("fresh", 2)):
        write_log(as_log(worn_sweeps(12, seed, rows=60)), folder / f"{name}.csv.gz")
    logs, options = (folder / "a.csv.gz", folder / "b.csv.gz"), ("--points", 120, "--robot", "exo_index")
    result = run("train", *logs, "--out", folder / "e.npz", *options)
    assert result.exit_code == 0, result.output
    (folder / "table.txt").write_text(result.output)
    return folder


def test_training_prints_both_splits_side_by_side(folder):
    text = (folder / "table.txt").read_text()
    heading = next(line for line in text.splitlines() if "random rows" in line)
    assert "held-out sweeps" in heading
    assert "Gaussian process" in text and "quadratic ridge" in text and "24 sweeps" in text


def test_estimating_adds_columns_and_scores(folder):
    options = ("--estimator", folder / "e.npz", "--out", folder / "out.csv", "--robot", "exo_index")
    result = run("estimate", folder / "fresh.csv.gz", *options)
    assert result.exit_code == 0, result.output
    assert "unlike the training sweeps" in result.output and "DIP: RMSE" in result.output
    log = read_log(folder / "out.csv")
    assert log.array("angle_est").shape == log.array("angle_std").shape == (720, 3)
    assert np.all(log.array("angle_std") > 0)
    assert (folder / "out.png").read_bytes().startswith(b"\x89PNG") and "out.png" in result.output


def test_re_donning_is_reported_and_corrected(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    worn = log.with_array("stroke", ("MF",), log.array("stroke", ("MF",)) + 1e-3)
    write_log(worn, tmp_path / "worn.csv")
    assert "not moved" in run("estimate", "--estimator", folder / "e.npz", folder / "fresh.csv.gz").output
    corrected = run("estimate", "--estimator", folder / "e.npz", tmp_path / "worn.csv").output
    kept = run("estimate", "--estimator", folder / "e.npz", tmp_path / "worn.csv", "--as-trained").output
    assert "moved, corrected. Re-donned?" in corrected and "not corrected, by --as-trained" in kept
    errors = [float(text.split("MCP: RMSE ")[1].split()[0]) for text in (corrected, kept)]
    assert errors[0] < errors[1] / 3


def test_a_log_without_angles_is_estimated_but_not_trained_on(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    write_log(log.only([name for name in log.columns if not name.startswith("angle_")]), tmp_path / "blind.csv")
    assert "error unknown" in run("estimate", "--estimator", folder / "e.npz", tmp_path / "blind.csv").output
    result = run("train", tmp_path / "blind.csv", "--out", tmp_path / "e.npz")
    assert result.exit_code == 2 and "angle_... of none" in result.output
    assert not (tmp_path / "e.npz").exists()


def test_other_wires_missing_samples_and_other_robots_are_refused(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    write_log(log.with_signals({"tension_AF": np.full(len(log), np.nan)}), tmp_path / "nan.csv")
    names = {name: log[name] for name in log.columns if not name.endswith("_AE")}
    write_log(type(log)(log.time, names), tmp_path / "two.csv")
    (tmp_path / "robot.yaml").write_text("base: exo_index\nparameters: {finger.kappa.MCP: 0.09}\n")
    for arguments, message in (
        ([tmp_path / "nan.csv"], "tension_AF"),
        ([tmp_path / "two.csv"], "of AF, MF"),
        ([folder / "fresh.csv.gz", "--robot", tmp_path / "robot.yaml"], "another robot"),
    ):
        result = run("estimate", "--estimator", folder / "e.npz", *arguments, "--out", tmp_path / "out.csv")
        assert result.exit_code == 2 and message in result.output, result.output
        assert not (tmp_path / "out.csv").exists()
