"""Decisions on fitted sets, whose shares are given here instead of measured."""

from types import SimpleNamespace

import pytest

from exodrake.diagnosis import verdict
from exodrake.diagnosis.result import CAUSE, REFINEMENT, Interval
from exodrake.diagnosis.search import Search

BOTH, FRICTION, DRIFT = (frozenset(some) for some in (("friction", "drift"), ("friction",), ("drift",)))


def decide(monkeypatch, divide, usable=lambda fitted: True):
    """Effects and roles that are left of two."""
    monkeypatch.setattr(verdict, "divide_gap", divide)
    sets = {key: SimpleNamespace(effects=key) for key in (BOTH, FRICTION, DRIFT)}
    search = SimpleNamespace(sets=sets, usable=usable, reduce=lambda effects: None)
    found = SimpleNamespace(search=search, whole=SimpleNamespace(detected=()), best=sets[BOTH])
    best, parts = verdict.drop_refinements(found)
    assert {p.effect for p in parts} == best.effects
    return best.effects, [p.role for p in parts]


@pytest.mark.parametrize(("share", "usable", "kept"), [(0.02, True, True), (-0.02, True, False), (-0.02, False, True)])
def test_a_refinement_goes_if_whole_logs_are_worse_with_it_and_the_rest_is_within_its_ranges(
    monkeypatch, share, usable, kept
):
    def divide(found, best):
        shares = {"friction": (CAUSE, 0.9), "drift": (REFINEMENT, share)}
        return tuple(
            verdict.Part(i, shares[i][0], Interval(*3 * [shares[i][1]]), {}) for i in sorted(best.effects)[::-1]
        )

    effects, _ = decide(monkeypatch, divide, lambda fitted: usable)
    assert effects == (BOTH if kept else FRICTION)


def test_effects_that_stand_in_for_each_other_go_until_one_is_a_cause(monkeypatch):
    """Either of two leaves little without the other, so that neither is a cause beside it: the smaller one goes."""

    def divide(found, best):
        role, share = (REFINEMENT, {"friction": 0.06, "drift": 0.05}) if len(best.effects) > 1 else (CAUSE, {})
        found = ((i, share.get(i, 0.9)) for i in sorted(best.effects))
        return tuple(verdict.Part(i, role, Interval(s, s, s), {}) for i, s in found)

    assert decide(monkeypatch, divide) == (FRICTION, [CAUSE])


def test_what_a_set_leaves_is_no_more_than_what_a_part_of_it_does():
    """Mass and gain, whose fit ended at a bound, leave no more than mass alone: the offset beside them is no cause."""
    left = {frozenset(): 1.0, frozenset({"mass"}): 0.01, frozenset({"mass", "gain"}): 0.3, frozenset({"gain"}): 0.9}
    search = SimpleNamespace(sets={key: key for key in left}, measure_left=left.__getitem__)
    assert Search.best_within(search, frozenset({"mass", "gain"})) == {"mass"}
    assert Search.best_within(search, frozenset({"gain"})) == {"gain"}
