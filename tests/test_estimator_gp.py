"""The Gaussian process against scikit-learn, its closed forms against refits, and its promises on sweeps not seen."""

from dataclasses import replace

import numpy as np
import pytest
from estimator_sweeps import JOINTS, as_sweeps, trained, worn_sweeps
from sklearn.gaussian_process import GaussianProcessRegressor

from exodrake.estimator.gp import JITTER, leave_one_sweep_out
from exodrake.estimator.validate import HELD_OUT, RANDOM, fit_ridge, score, validate
from exodrake.physics.gp_estimator import predict_into, predict_rows, scratch


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
