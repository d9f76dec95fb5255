"""Selection by algebra: predicted costs are those of a joint least-squares fit of all parameters."""

from dataclasses import replace
from itertools import combinations
from math import inf

import numpy as np
import pytest
from formula_case import WIDE, explanation, likelihood_of, linearisation, nominal, probe
from scipy.optimize import lsq_linear

from exodrake.diagnosis.linearise import Linearisation
from exodrake.diagnosis.select import NormalMatrix

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

    def matrix(self, low: float = -1e3, high: float = 1e3) -> NormalMatrix:
        probes = [probe(effect, rows, low, high) for effect, rows in PROBES.items()]
        return NormalMatrix(self.likelihood, self.known, linearisation(self.known, self.directions, probes))

    def joint(self, rows, low: float = -inf, high: float = inf):
        """Least squares in the nominal parameters and the factors of some directions, prior rows below."""
        columns = np.concatenate([self.jacobian, self.directions[list(rows)]]) / SCALE
        prior = np.eye(NOMINAL, len(columns)) / PRIOR
        target = np.concatenate([-self.known.residual / SCALE, -self.known.x / PRIOR])
        least, most = self.bounds - self.known.x
        ends = np.concatenate([least, np.full(len(rows), low)]), np.concatenate([most, np.full(len(rows), high)])
        return lsq_linear(np.concatenate([columns.T, prior]), target, ends, tol=1e-12, method="bvls")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("effects", [("a",), ("b",), ("c",), ("b", "d"), ("a", "c")])
def test_predicted_cost_factors_and_parameters_are_those_of_a_joint_fit(seed, effects):
    case = Linear(seed)
    matrix = case.matrix()
    found = matrix.predicted([next(p for p in matrix.probes if p.effect == effect) for effect in effects])
    wanted = case.joint([row for effect in effects for row in PROBES[effect]])
    assert found.cost == pytest.approx(wanted.cost, rel=1e-4)
    assert np.concatenate(found.factors) == pytest.approx(wanted.x[NOMINAL:], abs=2e-3)
    assert found.x == pytest.approx(case.known.x + wanted.x[:NOMINAL], abs=2e-3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("effect", ["a", "b", "c", "d"])
def test_a_nominal_parameter_does_not_go_beyond_the_bound_at_which_it_ended(seed, effect):
    """The predicted cost is that of a bounded fit in which it stays there."""
    first = Linear(seed).joint(()).x[0] + Linear(seed).known.x[0]  # where it would go
    case = Linear(seed, (-inf, 0.5 * first) if first > 0.0 else (0.5 * first, inf))
    case.known = explanation(case.likelihood, case.parameters, case.known.x + case.joint(()).x, case.jacobian)
    matrix = case.matrix()
    found = matrix.predicted([next(p for p in matrix.probes if p.effect == effect)])
    held = case.bounds.copy()
    held[:, 0] = case.known.x[0] + np.array([-1e-9, 1e-9])
    case.parameters = tuple(replace(p, bounds=tuple(ends)) for p, ends in zip(case.parameters, held.T, strict=True))
    assert found.cost == pytest.approx(case.joint(PROBES[effect]).cost, rel=1e-4)
    assert found.x[0] == case.known.x[0]


@pytest.mark.parametrize("seed", range(4))
def test_factors_stay_within_their_ranges(seed):
    case = Linear(seed)
    found = case.matrix(low=0.0, high=0.5).predicted(case.matrix(low=0.0, high=0.5).probes[1:3])
    wanted = case.joint([1, 2, 3, 4, 5], 0.0, 0.5)
    assert found.cost == pytest.approx(wanted.cost, rel=1e-4)
    assert np.concatenate(found.factors) == pytest.approx(wanted.x[NOMINAL:], abs=5e-3)


@pytest.mark.parametrize("seed", range(4))
def test_true_effects_come_first_alone_and_in_pairs(seed):
    matrix = Linear(seed).matrix()
    assert matrix.singles()[0].probes[0].effect == "b"
    pairs = [matrix.predicted([a.probes[0], b.probes[0]]) for a, b in combinations(matrix.singles(), 2)]
    assert {p.effect for p in min(pairs, key=lambda p: p.cost).probes} == {"b", "d"}
    costs = [p.cost for p in matrix.singles()]
    assert costs == sorted(costs)


def test_best_probe_of_an_effect_stands_for_it():
    case = Linear(0)
    probes = [probe("a", (0,)), probe("a", (1,)), probe("d", (6,))]
    lin: Linearisation = linearisation(case.known, case.directions, probes)
    singles = NormalMatrix(case.likelihood, case.known, lin).singles()
    assert [p.probes[0].effect for p in singles] == ["a", "d"] and singles[0].probes[0] is probes[1]
