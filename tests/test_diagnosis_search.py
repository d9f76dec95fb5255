"""Screening by algebra: predicted costs are those of a joint least-squares fit of all parameters."""

from dataclasses import replace
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest
from formula_case import WIDE, amplitude, explanation, likelihood_of, linearisation, nominal, probe
from scipy.optimize import lsq_linear

from exodrake.diagnosis.search import Excess, Search, screen

NOMINAL, SAMPLES, SCALE = 5, 300, 1.7
PROBES = {"a": (0,), "b": (1, 2), "c": (3, 4, 5), "d": (6,)}
PRIOR = 0.3


class Linear:
    """A residual r0 + J'x with random Jacobian and effect directions."""

    def __init__(self, seed: int, first: tuple[float, float] = WIDE) -> None:
        rng = np.random.default_rng(seed)
        self.jacobian, self.directions = rng.standard_normal((NOMINAL, SAMPLES)), rng.standard_normal((7, SAMPLES))
        self.directions[3] += 4.0 * self.jacobian[0]  # an effect that the nominal parameters imitate in part
        offset = 2.0 * rng.standard_normal(SAMPLES) + 1.5 * self.directions[1] - 0.8 * self.directions[6]
        self.likelihood = likelihood_of(lambda row: offset + row[:NOMINAL] @ self.jacobian, (SAMPLES,), scale=SCALE)
        x = 0.1 * rng.standard_normal(NOMINAL)
        self.parameters = (*nominal(1, PRIOR, first), *nominal(NOMINAL, PRIOR)[1:])
        self.known = explanation(self.likelihood, self.parameters, np.clip(x, *self.bounds), self.jacobian)

    @property
    def bounds(self) -> np.ndarray:
        return np.array([p.bounds for p in self.parameters]).T

    def screened(self, low: float = -1e3, high: float = 1e3, probes=None):
        """The predictions of all effects by their ids, the most promising first."""
        probes = probes or [probe(effect, rows, low, high) for effect, rows in PROBES.items()]
        lin = linearisation(self.known, self.directions, probes)
        found = screen(self.likelihood, self.known, lin, lin.kept)
        return {p.probe.effect: p for p in found}

    def cost(self, predicted) -> float:
        return self.known.cost(self.likelihood) - predicted.gain

    def joint(self, rows, low: float = -inf, high: float = inf):
        """Least squares in the nominal parameters and the factors of some directions, prior rows below."""
        columns = np.concatenate([self.jacobian, self.directions[list(rows)]]) / SCALE
        prior = np.eye(NOMINAL, len(columns)) / PRIOR
        target = np.concatenate([-self.known.residual / SCALE, -self.known.x / PRIOR])
        least, most = self.bounds - self.known.x
        ends = np.concatenate([least, np.full(len(rows), low)]), np.concatenate([most, np.full(len(rows), high)])
        return lsq_linear(np.concatenate([columns.T, prior]), target, ends, tol=1e-12, method="bvls")

    def settled(self):
        """The case at the minimum of the nominal parameters alone, where a search begins."""
        self.known = explanation(self.likelihood, self.parameters, self.known.x + self.joint(()).x, self.jacobian)
        return self


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("effect", ["a", "b", "c", "d"])
def test_predicted_gain_factors_and_parameters_are_those_of_a_joint_fit(seed, effect):
    case = Linear(seed).settled()
    found, wanted = case.screened()[effect], case.joint(PROBES[effect])
    assert case.cost(found) == pytest.approx(wanted.cost, rel=1e-4)
    assert found.factors == pytest.approx(wanted.x[NOMINAL:], abs=2e-3)
    assert found.x == pytest.approx(case.known.x + wanted.x[:NOMINAL], abs=2e-3)
    gains = [p.gain for p in case.screened().values()]
    assert next(iter(case.screened())) == "b" and gains == sorted(gains, reverse=True)  # the true effect comes first


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("effect", ["a", "b", "c", "d"])
def test_a_nominal_parameter_does_not_go_beyond_the_bound_at_which_it_ended(seed, effect):
    """The predicted gain is that of a bounded fit in which it stays there."""
    first = Linear(seed).joint(()).x[0] + Linear(seed).known.x[0]  # where it would go
    case = Linear(seed, (-inf, 0.5 * first) if first > 0.0 else (0.5 * first, inf)).settled()
    found, held = case.screened()[effect], case.bounds.copy()
    held[:, 0] = case.known.x[0] + np.array([-1e-9, 1e-9])
    case.parameters = tuple(replace(p, bounds=tuple(ends)) for p, ends in zip(case.parameters, held.T, strict=True))
    assert case.cost(found) == pytest.approx(case.joint(PROBES[effect]).cost, rel=1e-4)
    assert found.x[0] == pytest.approx(case.known.x[0], abs=1e-9)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("effect", ["b", "c"])
def test_factors_stay_within_their_ranges(seed, effect):
    case = Linear(seed).settled()
    found, wanted = case.screened(0.0, 0.5)[effect], case.joint(PROBES[effect], 0.0, 0.5)
    assert case.cost(found) == pytest.approx(wanted.cost, rel=1e-4)
    assert found.factors == pytest.approx(wanted.x[NOMINAL:], abs=5e-3)


def test_an_effect_that_explains_the_first_samples_alone_is_ranked_beside_those_that_explain_all():
    """A loop that hunts drifts apart later: by all samples its cause looks worse than any other effect."""
    case, rng = Linear(0).settled(), np.random.default_rng(7)
    early = np.arange(SAMPLES) < SAMPLES // 2
    case.directions[0] = np.where(early, case.known.residual, 30.0 * rng.standard_normal(SAMPLES))
    lin = linearisation(case.known, case.directions, [probe(effect, rows) for effect, rows in PROBES.items()])
    assert list(case.screened())[-1] == "a"
    search = Search(case.likelihood, (), np.zeros(0), 1.0, case.likelihood, case.likelihood, None)
    ranked = search.screen_beside(case.known, replace(lin, early=early))
    assert "a" in [p.probe.effect for p in ranked[:2]] and len(ranked) == len(PROBES)


def test_joined_directions_predict_as_those_taken_together():
    case = Linear(1).settled()
    parts = [probe(effect, range(len(rows)), -1e3, 1e3) for effect, rows in PROBES.items()]
    b, c = (linearisation(case.known, case.directions[list(PROBES[i])], [parts[k]]) for k, i in ((1, "b"), (2, "c")))
    lin = b.join(c)
    found = {p.probe.effect: p.gain for p in screen(case.likelihood, case.known, lin, lin.kept)}
    together = case.screened()
    assert found == pytest.approx({i: together[i].gain for i in "bc"}, rel=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_two_effects_are_predicted_as_by_a_joint_fit_of_both(seed):
    case = Linear(seed).settled()
    lin = linearisation(case.known, case.directions, [probe(effect, rows) for effect, rows in PROBES.items()])
    found = screen(case.likelihood, case.known, lin, lin.kept, pairs=True)
    assert len(found) == 6 and found[0].probe.effects == ("b", "d")  # the true ones
    for pair in found:
        wanted = case.joint([row for effect in pair.probe.effects for row in PROBES[effect]])
        assert case.cost(pair) == pytest.approx(wanted.cost, rel=1e-4)
        assert pair.factors == pytest.approx(wanted.x[NOMINAL:], abs=2e-3)


def test_of_two_probes_the_one_that_is_taken_as_it_is_stays_so():
    whole, scaled = replace(probe("a", (0,), 1.0, 1.0), scaled=(), x=np.full(1, 3.0)), probe("b", (1, 2))
    for both in (whole.beside(scaled), scaled.beside(whole)):
        assert both.coordinates(np.array([0.5, 2.0, 1.0])).tolist() == [0.5, 2.0, 3.0]
        assert (both.effects, both.rows.tolist(), both.low[2], both.high[2]) == (("b", "a"), [1, 2, 0], 1.0, 1.0)


def test_a_fit_leaves_its_minimum_for_one_that_it_or_a_set_like_it_has_found():
    """(u - 1)^2 (u + 1)^2 + (u - 1)^2 / 10 + (v - 2)^2 has a minimum near u = -1 and the lowest one at u = 1."""

    def formula(row):
        u, v = np.resize(row, 2)
        return np.array([u**2 - 1.0, (u - 1.0) / 10**0.5, v - 2.0])

    likelihood, u, v = likelihood_of(formula, (3,)), amplitude("first", 0), amplitude("second", 1)
    search = Search(likelihood, (), np.zeros(3), 1.0, likelihood, likelihood, None)

    def add(parameters, x):
        effects = tuple(p.effect for p in parameters)
        e = explanation(likelihood, parameters, np.array(x), np.zeros((0, 3)), effects)
        search.sets[frozenset(effects)] = SimpleNamespace(explanation=e)
        return e

    add((v,), [0.0])
    stuck = add((u, v), [-0.95, 2.0])
    assert search.fit_again(frozenset(stuck.effects)).x == pytest.approx([-0.95, 2.0], abs=0.05)
    anew = explanation(likelihood, (v, u), np.array([1.9, 0.9]), np.zeros((0, 3)), ("second", "first"))
    assert search.fit_again(frozenset(stuck.effects), [anew]).x == pytest.approx([1.0, 2.0], abs=1e-6)
    add((u,), [1.0])
    assert search.fit_again(frozenset(stuck.effects)).x == pytest.approx([1.0, 2.0], abs=1e-6)


def test_a_richer_law_begins_where_a_plainer_one_ended():
    """A factor of 2 within the richer law asks for half of the plainer one's amplitude; 1 lies in another valley."""

    def formula(row):
        plain, rich, factor = np.pad(row, (0, 3 - len(row)))
        return np.array([plain + rich * factor - 2.0, 5.0 * (factor - 1.0) * (factor - 2.0)])

    likelihood, factor = likelihood_of(formula, (2,)), replace(amplitude("rich", 2), name="rich.factor", start=2.0)
    effects = [SimpleNamespace(id=i, block="joint", family="friction") for i in ("plain", "rich")]
    search = Search(likelihood, tuple(effects), np.zeros(2), 1.0, likelihood, likelihood, None)
    plain, rich = (amplitude("plain", 0),), (amplitude("rich", 1), replace(factor, amplitude=False))
    for name, parameters, x in (("plain", plain, [2.0]), ("rich", rich, [-7.0, 2.0])):
        e = explanation(likelihood, parameters, np.array(x), np.zeros((0, 2)), (name,))
        search.sets[frozenset([name])] = SimpleNamespace(explanation=e)
    begun = search.fit_again(frozenset(["rich"]))
    assert begun.x == pytest.approx([1.0, 2.0]) and begun.residual == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("ahead", "barred"), [(50.0, set()), (2.0, {"rich"})])
def test_a_plainer_law_of_its_kind_bars_a_richer_one_or_is_no_rival_of_it(monkeypatch, ahead, barred):
    """Of laws that leave as much but for their error, evidence [nats] decides; no set without both was fitted.

    A search that takes over sets of another one knows so before it fits its best set on.
    """
    kinds = {"plain": "friction", "rich": "friction", "memory": "hysteresis", "third": "gain"}
    effects = tuple(SimpleNamespace(id=i, block="joint", family=family) for i, family in kinds.items())
    robot = SimpleNamespace(machine=SimpleNamespace(effects=range(50)))
    likelihood = SimpleNamespace(robot=robot, for_stage=lambda stage: likelihood)
    search = Search(likelihood, effects, np.zeros(0), 1.0, likelihood, likelihood, None)

    def add(names, count, left, evidence=0.0):
        parameters = tuple(amplitude(name, k) for k, name in enumerate((*names, *names)[:count]))
        bounds = np.array([p.bounds for p in parameters]).reshape(-1, 2).T
        e = SimpleNamespace(parameters=parameters, x=np.ones(count), bounds=bounds, jacobian=None)
        key = frozenset(names)
        search.sets[key] = SimpleNamespace(effects=key, explanation=e, left=left, value=evidence, memory=1.0)
        return search.sets[key]

    for name, value in (("measure_left", "left"), ("left_by_joint", "left"), ("evidence", "value")):
        monkeypatch.setattr(Search, name, lambda self, fitted, *_, value=value: getattr(fitted, value))
    add((), 0, 1.0)
    add(("plain", "third"), 2, 0.012)
    add(("memory", "third"), 2, 0.012)
    best = add(("rich", "third"), 3, 0.010, ahead)
    search.take_over(SimpleNamespace(sets={}, expanded=set()))
    assert search.barred == barred and search.list_rivals(best, "rich", 0.99).keys() == {"memory"}


def test_a_set_is_fitted_on_as_long_as_its_gap_is_visible(monkeypatch):
    """Not one that leaves too much, and no longer than evidence grows."""
    case, calls = Linear(0).settled(), []

    def fit_on(sequence, visible, most=inf, excess=1.0):
        search, key = Search(case.likelihood, (), np.zeros(0), 1.0, case.likelihood, case.likelihood, None), "a"
        states = iter(sequence)
        calls.clear()

        def take(found):
            search.sets[key] = SimpleNamespace(
                explanation=SimpleNamespace(robot=None), excess=excess, value=next(states)
            )

        take(())
        monkeypatch.setattr(Search, "add", lambda self, found: (calls.append(1), take(found)))
        monkeypatch.setattr(Search, "evidence", lambda self, fitted: fitted.value)
        monkeypatch.setattr(Search, "fit_again", lambda self, key: key)
        search.excess = lambda robot: Excess(1.0, visible - len(calls) - 0.5, 1.0, 0.0)
        search.converge(key, most)
        return len(calls)

    assert fit_on([0.0, 50.0, 90.0, 120.0], visible=9) == 3  # times at most
    assert fit_on([0.0, 50.0, 51.0, 120.0], visible=9) == 2  # the second gains one nat
    assert fit_on([0.0, 50.0, 90.0, 120.0], visible=1) == 1
    assert fit_on([0.0, 50.0], visible=9, most=0.5) == 0
