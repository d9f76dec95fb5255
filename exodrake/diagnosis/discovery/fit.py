"""Fits free laws through the simulation: all of them by one linearisation, the best by Gauss-Newton steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from exodrake.core.threads import side_by_side
from exodrake.diagnosis.discovery.candidate import MODES, CandidateLaw
from exodrake.diagnosis.discovery.effect_text import SIZE
from exodrake.diagnosis.discovery.evidence import TIGHTER, Columns, Eliminated, Weighed, fitted, weights_of
from exodrake.diagnosis.likelihood import SAMPLE, Likelihood
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.parameter import STEP, apply
from exodrake.diagnosis.refine import Explanation

STEPS = (1.0, 0.5, 0.2, 0.05)  # shares of a Gauss-Newton step that are tried
NEAR = 0.01  # of twice the log posterior that a step promises where a fit ends: a tenth of a standard deviation


@dataclass(frozen=True, eq=False)
class Screened:
    """A candidate law as the linearisation predicts it.

    Attributes:
        candidate: the law.
        columns: directions of the law and their products.
        channel: (n,) channel of each direction.
        weighed: fit of the law by the linearisation.
    """

    candidate: CandidateLaw
    columns: Columns
    channel: np.ndarray
    weighed: Weighed

    @property
    def active(self) -> list[int]:
        """Channels that have the law."""
        return [int(c) for c in np.flatnonzero(self.weighed.scales)]


@dataclass(frozen=True, eq=False)
class Fit:
    """A law fitted through the simulation.

    Attributes:
        candidate: the law.
        active: positions of the channels that have it.
        x: (nuisance,) coordinates of the other parameters.
        modes: (channels, 8) coordinates of the law.
        residual: (samples,) whitened [noise_std].
        directions: (n, samples) derivatives by the modes of its active channels there, once simulated.
        columns, model, weighed: its linearisation there and what follows from it.
    """

    candidate: CandidateLaw
    active: tuple[int, ...]
    x: np.ndarray
    modes: np.ndarray
    residual: np.ndarray
    directions: np.ndarray | None = None
    columns: Columns | None = None
    model: Eliminated | None = None
    weighed: Weighed | None = None

    @property
    def block(self) -> str:
        """Block of the robot that the law acts in."""
        return self.candidate.law.block

    def robot(self, base: Explanation, likelihood: Likelihood) -> np.ndarray:
        """Flat parameter vector (n,) of the robot with the law."""
        values = apply(base.values, base.parameters, self.x)
        return self.candidate.put(likelihood.robot.machine, values, self.candidate.weights(self.modes))

    @property
    def channel(self) -> np.ndarray:
        """Position among the active channels of each direction (n,)."""
        return np.repeat(np.arange(len(self.active)), SIZE)


def screened(
    likelihood: Likelihood, base: Explanation, model: Eliminated, found: Sequence[CandidateLaw]
) -> list[Screened]:
    """All candidates by one linearisation at a robot without them, best first.

    Args:
        likelihood: views of the case.
        base: the robot, on a machine with laws.
        model: its linearisation.
        found: candidates.
    """
    robot = base.robot

    def screen(candidate: CandidateLaw) -> Screened:
        modes = candidate.directions(range(len(candidate.channels)), MODES)
        rows = [candidate.put(likelihood.robot.machine, robot, candidate.weights(one)) for one in modes]
        columns = model.columns(likelihood.residual(np.array(rows)) - base.residual)
        channel = np.repeat(np.arange(len(candidate.channels)), MODES)
        return Screened(candidate, columns, channel, fitted(model, columns, channel))

    return sorted(side_by_side([partial(screen, one) for one in found]), key=lambda s: -s.weighed.log_evidence)


def started(likelihood: Likelihood, base: Explanation, model: Eliminated, s: Screened) -> Fit:
    """A screened candidate simulated with as much of its predicted weights as fits best."""
    count = len(s.candidate.channels)
    modes = np.zeros((count, SIZE))
    modes[:, :MODES] = s.weighed.modes.reshape(count, MODES)
    start = Fit(s.candidate, tuple(s.active), base.x, np.zeros((count, SIZE)), base.residual)
    return searched(likelihood, base, start, model.nuisance(s.columns, s.weighed), modes, s.weighed)


def searched(
    likelihood: Likelihood, base: Explanation, at: Fit, x: np.ndarray, modes: np.ndarray, weighed: Weighed
) -> Fit:
    """The best of some shares of a step to x and modes; the start itself if none is better."""
    low, high = base.bounds
    tries = [
        replace(at, x=np.clip(at.x + t * (x - at.x), low, high), modes=at.modes + t * (modes - at.modes)) for t in STEPS
    ]
    rows = np.array([one.robot(base, likelihood) for one in tries])
    tries = [replace(one, residual=r, directions=None) for one, r in zip(tries, likelihood.residual(rows), strict=True)]
    return min((at, *tries), key=lambda one: cost(likelihood, base, one, weighed))


def cost(likelihood: Likelihood, base: Explanation, fit: Fit, weighed: Weighed) -> float:
    """Twice the negative log posterior of a fit, the variance of a sample as weighed."""
    weighted = fit.residual * weights_of(likelihood)
    return float(weighted @ weighted) / weighed.variance + priors_used(base, fit, weighed)


def priors_used(base: Explanation, fit: Fit, weighed: Weighed) -> float:
    """Sum of squares of a fit's parameters and modes in standard deviations of their priors."""
    scale, active = np.zeros(len(fit.candidate.channels)), list(fit.active)
    scale[active] = weighed.scales if len(weighed.scales) == len(active) else weighed.scales[active]
    used = np.divide(fit.modes, scale[:, None], out=np.zeros_like(fit.modes), where=scale[:, None] > 0.0)
    return float(np.sum((fit.x / (TIGHTER * base.prior_std)) ** 2) + np.sum(used**2))


def unlikely(likelihood: Likelihood, base: Explanation, fit: Fit, weighed: Weighed) -> float:
    """Twice the negative log posterior of a fit, the variance of a sample as it leaves it."""
    weights = weights_of(likelihood).astype(float)
    weighted = fit.residual * weights
    samples = likelihood.samples / max(SAMPLE / likelihood.robot.machine.frame, 1.0)
    variance = max(float(weighted @ weighted), float(weights @ weights)) / samples
    return samples * float(np.log(variance)) + priors_used(base, fit, weighed)


def differentiated(likelihood: Likelihood, base: Explanation, fit: Fit, jacobian: np.ndarray) -> Fit:
    """The fit with its linearisation: columns of all modes of its active channels."""
    directions = derivatives(likelihood, base, fit) if fit.directions is None else fit.directions
    own = fit.modes[list(fit.active)].ravel()
    offset = fit.residual - fit.x @ jacobian - own @ directions
    model = Eliminated(likelihood, offset, jacobian, base.prior_std)
    columns = model.columns(directions)
    found = fitted(model, columns, fit.channel)
    return replace(fit, directions=directions, model=model, columns=columns, weighed=found)


def derivatives(likelihood: Likelihood, base: Explanation, fit: Fit) -> np.ndarray:
    """Derivatives (n, samples) of the residual by the modes of a fit's active channels."""
    machine, values = likelihood.robot.machine, apply(base.values, base.parameters, fit.x)
    units = fit.candidate.directions(fit.active, SIZE)
    rows = [fit.candidate.put(machine, values, fit.candidate.weights(fit.modes + STEP * unit)) for unit in units]
    return (likelihood.residual(np.array(rows)) - fit.residual) / STEP


def refined(likelihood: Likelihood, base: Explanation, fit: Fit, jacobian: np.ndarray, steps: int) -> Fit:
    """The fit after some Gauss-Newton steps, differentiated at its end; the other parameters' Jacobian is kept."""
    fit = differentiated(likelihood, base, fit, jacobian)
    for _ in range(steps):
        assert fit.model is not None and fit.columns is not None and fit.weighed is not None
        if cost(likelihood, base, fit, fit.weighed) - fit.weighed.left < NEAR:
            return fit
        modes = np.zeros_like(fit.modes)
        modes[list(fit.active)] = fit.weighed.modes.reshape(len(fit.active), SIZE)
        x = fit.model.nuisance(fit.columns, fit.weighed)
        found = searched(likelihood, base, fit, x, modes, fit.weighed)
        if found is fit:
            return fit
        fit = differentiated(likelihood, base, found, jacobian)
    return fit


def nuisance_jacobian(likelihood: Likelihood, base: Explanation, fit: Fit) -> np.ndarray:
    """Derivatives (parameters, samples) by the parameters of the base, beside the law."""
    machine, weights = likelihood.robot.machine, fit.candidate.weights(fit.modes)
    values = fit.candidate.put(machine, base.values, weights)
    return nominal_jacobian(likelihood, values, base.parameters, fit.x, fit.residual)
