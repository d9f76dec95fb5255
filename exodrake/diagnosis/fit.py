"""Fit of an explanation, a set of effects, together with the nominal parameters: maximum a posteriori.

The method is Levenberg-Marquardt within bounds (Marquardt 1963). After a step that fails the parameters of effects keep
within a box, a trust region: damping by the curvature does not hold one back that has none yet, such as a limit that is
not reached. The nominal Jacobian is expensive and changes little: it is given with the start and corrected after each
step (Broyden 1965). The few columns of the effects are simulated at each step.

Where joints are separate (`Machine.separate`), each is a fit of its own: a step, and a start, is taken joint by joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from exodrake.core.parallel import side_by_side
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linear import LinearModel, minimise_bounded
from exodrake.diagnosis.linearise import Probe, nominal_jacobian, with_effects
from exodrake.diagnosis.parameter import STEP, Parameter, apply

DAMPING, LARGER, SMALLER = 1e-6, 30.0, 0.2  # at first, and its factors after a bad and a good step
SHORTER = 0.25  # of the longest step of an effect's parameter after a bad step; one scale at the first: assumed
TRIES = 4  # damped steps before a fit ends
STEPS, TOL = 6, 5e-4  # of a fit
ROUGH = 5e-3  # the same of a first fit, which the best set alone goes on from
# prior standard deviations, in scales, of an effect's parameter in a fit: none, but the matrix stays regular
FREE = 1e3
LESS, INITIAL = (1.0, 0.5, 0.2), (1.0, 0.3)  # of the predicted and of the initial amplitude, tried where a fit begins
HALF = 0.5  # of the best gain after two steps, with which a fit goes on
VISIBLE = 0.5  # standard deviations of all samples together by which a tolerance shows: a tenth of a nat. Assumed


@dataclass(eq=False)
class Explanation:
    """A set of effects with its fitted robot."""

    effects: tuple[str, ...]  # ids
    parameters: tuple[Parameter, ...]  # fitted parameters, nominal ones first
    x: np.ndarray  # (parameters,) coordinates
    values: np.ndarray  # (n,) flat vector of the robot with the fixed parameters of its effects, at x = 0
    residual: np.ndarray  # (samples,) whitened [noise_std]
    jacobian: np.ndarray  # (nominal, samples) derivatives by the nominal parameters nearby
    columns: np.ndarray | None = None  # (others, samples) the same by those of its effects, once they were simulated

    @property
    def robot(self) -> np.ndarray:
        """Flat parameter vector (n,) of the fitted robot."""
        return apply(self.values, self.parameters, self.x)

    @property
    def name(self) -> str:
        """Ids joined by +; `retune` without an effect."""
        return " + ".join(self.effects) or "retune"

    @property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return len(self.jacobian)

    def find_visible(self, likelihood: Likelihood) -> np.ndarray:
        """Mask (nominal,) of the nominal parameters whose tolerance shows in the logs, by `VISIBLE`."""
        size = np.linalg.norm(self.jacobian * likelihood.weights, axis=1)
        return size * self.prior_std[: self.nominal] > VISIBLE

    @cached_property
    def prior_std(self) -> np.ndarray:
        """Prior standard deviations (parameters,)."""
        return np.array([min(p.prior_std, FREE * p.scale) for p in self.parameters])

    @property
    def use(self) -> np.ndarray:
        """Coordinates in standard deviations of their priors (parameters,)."""
        return self.x / self.prior_std

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper ends of the coordinates (2, parameters)."""
        return np.array([p.bounds for p in self.parameters]).reshape(-1, 2).T

    def prior(self, x: np.ndarray) -> list[np.ndarray]:
        """Prior mean, precision, low and high of the change from x, (..., parameters) each; of an effect its range."""
        effect = np.array([bool(p.effect) for p in self.parameters], dtype=bool)
        shapes = np.array([bool(p.effect) and not p.amplitude for p in self.parameters], dtype=bool)
        low, high = self.bounds
        std = np.where(effect & (high > low), (high - low) / np.sqrt(12.0), self.prior_std)  # of a uniform law
        precision = np.broadcast_to(1.0 / np.maximum(std, 1e-300) ** 2, x.shape)
        return [np.where(shapes, 0.0, -x), precision, low - x, high - x]

    def cost(self, likelihood: Likelihood) -> float:
        """Half the sum of squares of the weighted residual and of the coordinates in units of their priors."""
        return likelihood.cost(self.residual, self.x, self.prior_std)

    def at(self, likelihood: Likelihood, x: np.ndarray) -> Explanation:
        """The explanation at other coordinates x (parameters,)."""
        return self.at_each(likelihood, [x])[0]

    def at_each(self, likelihood: Likelihood, points: Sequence[np.ndarray]) -> list[Explanation]:
        """The explanation at several coordinates x (parameters,), simulated at once."""
        residuals = likelihood.residual(np.array([apply(self.values, self.parameters, x) for x in points]))
        moved = zip(points, residuals, strict=True)
        return [replace(self, x=x, residual=residual, columns=None) for x, residual in moved]


def whole_jacobian(likelihood: Likelihood, here: Explanation) -> np.ndarray:
    """Derivatives (parameters, samples) of the residual by all parameters.

    Those by the effects, away from the nearer bound, are simulated once.
    """
    if here.columns is None:
        steps, rows = [], []
        for i, p in enumerate(here.parameters[here.nominal :], start=here.nominal):
            step, moved = STEP * p.scale, here.x.copy()
            steps.append(-step if here.x[i] + step > p.bounds[1] else step)
            moved[i] += steps[-1]
            rows.append(apply(here.values, here.parameters, moved))
        here.columns = likelihood.derivatives(np.array(rows), here.residual, np.array(steps))
    return np.concatenate([here.jacobian, here.columns])


@dataclass(frozen=True, eq=False)
class Predicted:
    """One more effect, or two, as the linearisation predicts them."""

    probe: Probe  # its directions
    factors: np.ndarray  # (directions,) their factors
    gain: float  # by how much the cost falls, in nats
    x: np.ndarray  # (eliminated,) coordinates of the parameters beside it


def linear_model(likelihood: Likelihood, e: Explanation, weight: np.ndarray | float = 1.0) -> LinearModel:
    """The linear model about a fit, blocks of each log in each view; weight: of samples (samples,)."""
    rows = np.concatenate([whole_jacobian(likelihood, e), e.residual[None]]) * np.sqrt(weight)
    return LinearModel.of_rows(rows, likelihood.stretches, e.prior(e.x), likelihood.memory)


@dataclass(frozen=True, eq=False)
class Groups:
    """Samples and parameters that belong together: those of each joint of a machine whose joints are separate."""

    samples: np.ndarray  # (samples,) number of the group of each sample
    parameters: np.ndarray  # (parameters,) the same of each parameter
    count: int  # number of groups

    @classmethod
    def of(cls, likelihood: Likelihood, e: Explanation) -> Groups:
        """One group, or one for each joint where joints are separate and none shares a parameter."""
        one = cls(np.zeros(len(e.residual), dtype=int), np.zeros(len(e.x), dtype=int), 1)
        machine = likelihood.robot.machine
        if not machine.separate:
            return one
        masks, joints = likelihood.samples_of_joints(), list(machine.axes.joints)

        def joint_of(p: Parameter) -> int:
            return next((k for k, j in enumerate(joints) if p.channels == (j,) or p.name.endswith(f".{j}")), -1)

        owner = [joint_of(p) for p in e.parameters]
        if len(masks) != len(joints) or len(joints) < 2 or -1 in owner:
            return one
        return cls(np.argmax(masks, axis=0), np.array(owner, dtype=int), len(joints))

    def costs(self, likelihood: Likelihood, e: Explanation) -> np.ndarray:
        """Cost (groups,) of an explanation."""
        left = np.bincount(self.samples, (e.residual * likelihood.weights) ** 2, self.count)
        return 0.5 * (left + np.bincount(self.parameters, (e.x / e.prior_std) ** 2, self.count))

    def merge(self, likelihood: Likelihood, a: Explanation, b: Explanation, better: np.ndarray) -> Explanation:
        """The first explanation with those groups (groups,) of the second that are better.

        Simulated, as an effect such as crosstalk couples joints that are separate without it.
        """
        if better.all() or not better.any():
            return b if better.all() else a
        return b.at(likelihood, np.where(better[self.parameters], b.x, a.x))

    def best(self, likelihood: Likelihood, found: Sequence[Explanation]) -> Explanation:
        """The explanation whose groups are the best of several at other coordinates."""
        best = found[0]
        for e in found[1:]:
            best = self.merge(likelihood, best, e, self.costs(likelihood, e) < self.costs(likelihood, best))
        return best


def minimise(likelihood: Likelihood, start: Explanation, steps: int = STEPS, tol: float = TOL) -> Explanation:
    """The explanation after at most `steps` steps; it ends when a step lowers the cost by less than the share `tol`."""
    groups, found = Groups.of(likelihood, start), start
    damping = np.full(groups.count, DAMPING)
    reach = np.array([p.scale if p.effect else np.inf for p in start.parameters])
    for _ in range(steps):
        begun, columns, before = found, whole_jacobian(likelihood, found), groups.costs(likelihood, found)
        weighted, precision = np.multiply(columns, likelihood.weights, dtype=float), 1.0 / found.prior_std**2
        slope = weighted @ (found.residual * likelihood.weights) + precision * found.x
        curvature = weighted @ weighted.T + np.diag(precision)  # Gauss-Newton
        here, waiting = found, np.ones(groups.count, dtype=bool)
        for failed in range(TRIES):
            longest = reach * SHORTER ** (failed - 1) if failed else np.full(len(reach), np.inf)
            longest = np.where(waiting[groups.parameters], longest, 0.0)
            damped = curvature + np.diag(damping[groups.parameters] * np.diag(curvature))
            low, high = here.bounds - here.x
            move, _ = minimise_bounded(damped, slope, np.maximum(low, -longest), np.minimum(high, longest))
            trial = here.at(likelihood, np.clip(here.x + move, low + here.x, high + here.x))
            known = np.concatenate([here.jacobian, columns[here.nominal :]])
            jacobian = correct_jacobian(here, trial, here.residual + (trial.x - here.x) @ known)
            better = waiting & (groups.costs(likelihood, trial) < before)
            found, here = groups.merge(likelihood, found, trial, better), replace(here, jacobian=jacobian)
            found = replace(found, jacobian=jacobian)
            waiting &= ~better
            if not waiting.any():
                break
            damping[waiting] = np.maximum(LARGER * damping[waiting], 1e-3)
        damping[~waiting] = np.maximum(SMALLER * damping[~waiting], DAMPING)
        gained = before.sum() - groups.costs(likelihood, found).sum()
        if gained <= tol * before.sum():
            if gained < 0.0:  # where an effect couples joints
                return begun
            if waiting.all():
                return here
            found.columns = columns[found.nominal :]
            break
    return found


def correct_jacobian(here: Explanation, trial: Explanation, expected: np.ndarray) -> np.ndarray:
    """The nominal Jacobian corrected by what a step showed."""
    count = here.nominal
    move = (trial.x - here.x)[:count]
    weight = move / here.prior_std[:count] ** 2
    size = float(weight @ move)
    if size < 1e-6:
        return here.jacobian
    return here.jacobian + np.outer(weight / size, trial.residual - expected).astype(np.float32)


def begin_beside(likelihood: Likelihood, known: Explanation, predicted: Predicted) -> Explanation:
    """One more effect, or two, beside those of an explanation, two steps from the best of several starts by joint.

    They are as the linearisation predicts it, less of it, and at the initial amplitudes of the effect.
    """
    machine, probe = likelihood.robot.machine, predicted.probe
    values = with_effects(known.values, machine, [machine.effect(i) for i in probe.effects])
    parameters, own = known.parameters + probe.parameters, probe.coordinates(predicted.factors)
    amplitude = np.array([p.amplitude for p in probe.parameters])
    low, high = np.array([p.bounds for p in parameters]).T
    initial = np.array([p.start for p in probe.parameters])
    points = [np.concatenate([predicted.x, np.where(amplitude, less * own, own)]) for less in LESS]
    points += [np.concatenate([known.x, np.where(amplitude, share * initial, initial)]) for share in INITIAL]
    joined = Explanation(
        (*known.effects, *probe.effects), parameters, points[0], values, known.residual, known.jacobian
    )
    begun = joined.at_each(likelihood, list(np.clip(points, low, high)))
    groups = Groups.of(likelihood, begun[0])
    best = groups.best(likelihood, begun)
    return groups.best(likelihood, [minimise(likelihood, e, 2) for e in {id(e): e for e in (begun[0], best)}.values()])


def fit_beside(likelihood: Likelihood, known: Explanation, predicted: Sequence[Predicted]) -> list[Explanation]:
    """Fits with one more effect, or two, beside those of an explanation, one for each prediction that is given.

    Only those are fitted to the end that have gained half as much as the best one after two steps.
    """
    begun = side_by_side([partial(begin_beside, likelihood, known, p) for p in predicted])
    gains = known.cost(likelihood) - np.array([e.cost(likelihood) for e in begun])

    def finish(e: Explanation, gain: float) -> Explanation:
        hopeful = gain >= HALF * gains.max()
        return minimise(likelihood.scaled_to(e.residual), e, tol=ROUGH) if hopeful else e

    return side_by_side([partial(finish, e, gain) for e, gain in zip(begun, gains, strict=True)])


def renew(likelihood: Likelihood, e: Explanation, seen: np.ndarray | None = None) -> Explanation:
    """The explanation with new derivatives by nominal parameters: `seen` (nominal,), or visible ones."""
    likelihood, jacobian = likelihood.scaled_to(e.residual), e.jacobian.copy()
    seen = e.find_visible(likelihood) if seen is None else seen
    jacobian[seen] = nominal_jacobian(likelihood, e, seen)
    return replace(e, jacobian=jacobian)


def settle(likelihood: Likelihood, e: Explanation, seen: np.ndarray | None = None) -> Explanation:
    """The explanation fitted on with new derivatives, as `renew` takes them."""
    return minimise(likelihood.scaled_to(e.residual), renew(likelihood, e, seen))


def without(likelihood: Likelihood, e: Explanation, effect: str) -> Explanation:
    """An explanation with one effect as the nominal robot has it, not yet fitted again."""
    machine, values = likelihood.robot.machine, e.values.copy()
    at = list(machine.effect_indices(effect, machine.effect(effect).parameters[0].name).values())
    values[at] = likelihood.robot.values[at]
    kept = [i for i, p in enumerate(e.parameters) if p.effect != effect]
    effects, parameters = tuple(i for i in e.effects if i != effect), tuple(e.parameters[i] for i in kept)
    return replace(e, effects=effects, parameters=parameters, values=values).at(likelihood, e.x[kept])
