"""Zeros of the strokes of a session: found against injected shifts, tested at stated error rates, and corrected."""

from dataclasses import replace

import numpy as np
import pytest
from estimator_sweeps import as_log, as_sweeps, trained, worn_sweeps

from exodrake.core.errors import InputError
from exodrake.estimator.gp import FALSE, TOLERANCE, condition, hotelling
from exodrake.estimator.validate import estimate, score

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
