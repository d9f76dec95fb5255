"""Decisions on fitted sets, whose shares and prediction errors are given here instead of measured."""

from types import SimpleNamespace

import numpy as np
import pytest

from exodrake.diagnosis import verdict
from exodrake.diagnosis.result import CAUSE, REFINEMENT, Interval
from exodrake.diagnosis.search import Search


@pytest.fixture
def sets():
    """Fitted sets of two effects and of one, of two logs."""
    model = SimpleNamespace(log=np.array([0, 1]))
    return {
        k: SimpleNamespace(effects=k, model=model) for k in (frozenset({"friction", "drift"}), frozenset({"friction"}))
    }


@pytest.mark.parametrize(
    ("share", "with_it", "without", "kept"),
    [
        (0.02, (1.0, 1.0), (1.5, 1.6), True),
        (0.02, (1.5, 1.5), (1.5, 1.5), True),
        (0.02, (1.5, 1.6), (1.0, 1.0), False),
        (0.02, (1.5, 3.0), (1.6, 1.0), True),  # one log better, one worse: 0.95 +- 1.05
        (-0.02, (1.0, 1.0), (1.5, 1.6), False),
    ],
)
def test_a_refinement_stays_where_whole_logs_and_their_predictions_want_it(
    monkeypatch, sets, share, with_it, without, kept
):
    def divide(found, best):
        shares = {"friction": (CAUSE, 0.9), "drift": (REFINEMENT, share)}
        return tuple(
            verdict.Part(i, shares[i][0], Interval(*3 * [shares[i][1]]), {}) for i in sorted(best.effects)[::-1]
        )

    monkeypatch.setattr(verdict, "divide_gap", divide)
    predicted = {len(k): np.array(error) for k, error in zip(sets, (with_it, without), strict=True)}
    search = SimpleNamespace(sets=sets, predict_error=lambda f: predicted[len(f.effects)], reduce=lambda effects: None)
    best, parts = verdict.drop_refinements(
        SimpleNamespace(search=search, whole=SimpleNamespace(detected=()), best=sets[frozenset({"friction", "drift"})])
    )
    assert best.effects == ({"friction", "drift"} if kept else {"friction"})
    assert {p.effect for p in parts} == best.effects


def test_effects_that_stand_in_for_each_other_go_until_one_is_a_cause(monkeypatch, sets):
    """Either of two leaves little without the other, so that neither is a cause beside it."""

    def divide(found, best):
        role = REFINEMENT if len(best.effects) > 1 else CAUSE
        return tuple(verdict.Part(i, role, Interval(0.05, 0.05, 0.05), {}) for i in sorted(best.effects))

    monkeypatch.setattr(verdict, "divide_gap", divide)
    sets[frozenset({"drift"})] = SimpleNamespace(
        effects=frozenset({"drift"}), model=sets[frozenset({"friction"})].model
    )
    error = {frozenset({"friction"}): np.array([1.5]), frozenset({"drift"}): np.array([2.0])}
    search = SimpleNamespace(
        sets=sets, predict_error=lambda f: error.get(f.effects, np.ones(1)), reduce=lambda effects: None
    )
    both = sets[frozenset({"friction", "drift"})]
    best, parts = verdict.drop_refinements(
        SimpleNamespace(search=search, whole=SimpleNamespace(detected=()), best=both)
    )
    assert best.effects == {"friction"} and [p.role for p in parts] == [CAUSE]


def test_what_a_set_leaves_is_no_more_than_what_a_part_of_it_does():
    """Mass and gain, whose fit ended at a bound, leave no more than mass alone: the offset beside them is no cause."""
    left = {frozenset(): 1.0, frozenset({"mass"}): 0.01, frozenset({"mass", "gain"}): 0.3, frozenset({"gain"}): 0.9}
    search = SimpleNamespace(sets={key: key for key in left}, measure_left=left.__getitem__)
    assert Search.best_within(search, frozenset({"mass", "gain"})) == {"mass"}
    assert Search.best_within(search, frozenset({"gain"})) == {"gain"}
