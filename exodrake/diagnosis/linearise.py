"""Linearisation at a robot: derivatives of the residual by the nominal parameters, and its differences by every effect.

The response to an effect such as a dead zone or a contact is not proportional to its parameters. A direction of an
effect is therefore a secant: the residual with the effect at a probe, less the residual without it. Each channel has a
direction of its own, which a combination may scale. A probe of all channels at once is taken as it is. Later steps use
algebra on the Gram matrix of the directions.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.parallel import side_by_side
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import RANGE_FACTOR, STEP, Parameter, apply, effect_parameters
from exodrake.diagnosis.problem import Problem
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine

if TYPE_CHECKING:
    from exodrake.diagnosis.fit import Explanation

PROBE, STRONG = 0.6, 2.5  # of an effect's initial amplitude: modest, and where small amplitudes hide; assumed
LARGER = 2.0  # times the gap from which a response is too large to stand for one as large as the gap: assumed
GRID = 5  # amplitudes at which a limit, or an effect of the whole robot, is tried
ELSEWHERE = 0.7  # of the way through its range at which a further parameter is tried


@dataclass(frozen=True, eq=False)
class Probe:
    """A set of directions of an effect, or of two at once, that a combination scales together."""

    effects: tuple[str, ...]  # their ids
    parameters: tuple[Parameter, ...]  # fitted parameters of these
    x: np.ndarray  # (parameters,) coordinates of all of them at the probe
    scaled: tuple[int, ...]  # positions in x of the amplitudes that are scaled
    # positions of the directions: one for each scaled amplitude, then one for each effect that is taken as it is
    rows: np.ndarray
    low: np.ndarray  # (directions,) range of the factors
    high: np.ndarray

    @property
    def effect(self) -> str:
        """Id of its effect, or of its first one."""
        return self.effects[0]

    def coordinates(self, factors: np.ndarray) -> np.ndarray:
        """Coordinates of the effect's parameters for factors of its directions."""
        x = self.x.copy()
        x[list(self.scaled)] *= factors[: len(self.scaled)]
        return x

    def beside(self, other: Probe) -> Probe:
        """Both at once."""
        a, b = sorted((self, other), key=lambda probe: not probe.scaled)
        return Probe(
            a.effects + b.effects, a.parameters + b.parameters, np.concatenate([a.x, b.x]),
            (*a.scaled, *(len(a.x) + i for i in b.scaled)), np.concatenate([a.rows, b.rows]),
            np.concatenate([a.low, b.low]), np.concatenate([a.high, b.high]),
        )  # fmt: skip

    def robots(self, nominal: np.ndarray) -> np.ndarray:
        """Robots (directions, parameters) whose responses are the directions, from one without the effect."""
        rows = self.x if not self.scaled else [self.coordinates(row) for row in np.eye(len(self.scaled))]
        return np.array([apply(nominal, self.parameters, row) for row in np.atleast_2d(rows)])

    def shrink(self, size: np.ndarray) -> Probe:
        """The same at smaller amplitudes; size: (directions,) of the present ones."""
        return replace(self, x=self.coordinates(size), low=self.low / size, high=self.high / size)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Effect directions at a robot."""

    directions: np.ndarray  # (directions, samples) differences of the whitened residual by the effects, float32
    probes: tuple[Probe, ...]  # sets of directions of all effects
    kept: np.ndarray  # (samples,) mask of the samples where they were simulated; elsewhere they are zero
    early: np.ndarray  # (samples,) mask of the first half of these, log by log

    def join(self, other: Linearisation) -> Linearisation:
        """The directions of both, at one robot."""
        at = len(self.directions)
        moved = tuple(replace(probe, rows=at + probe.rows) for probe in other.probes)
        return replace(self, directions=np.concatenate([self.directions, other.directions]), probes=self.probes + moved)


def with_effects(values: np.ndarray, machine: Machine, effects: Iterable[Effect]) -> np.ndarray:
    """Flat parameter vector with the parameters of some effects set that a fit leaves alone; not of present ones."""
    out = values.copy()
    for effect in (e for e in effects if not machine.has_effect(values, e)):
        for info in (p for p in effect.parameters if not p.fitted):
            out[[*machine.effect_indices(effect.id, info.name).values()]] = info.initial
    return out


def linearise(
    likelihood: Likelihood, robot: np.ndarray, effects: Sequence[Effect], residual: np.ndarray, share: float = 1.0,
    gap: np.ndarray | None = None,
) -> Linearisation:  # fmt: skip
    """Directions of effects at a robot (parameters,) with a residual (samples,), whitened [noise_std].

    share: part of each log, from its beginning, on which they are simulated.
    gap: (samples,) residual that they are to explain, if any. A direction whose response is much larger is taken at an
    amplitude with a response as large: beyond it, an effect such as play may show another shape.
    """
    problem, found = likelihood.views[0].problem, list[Probe]()
    for effect in effects:
        found += probes(problem, effect, sum(len(probe.rows) for probe in found))
    nominal = {e.id: with_effects(robot, problem.robot.machine, [e]) for e in effects}
    short = likelihood.on(problem.shorten(share)) if share < 1.0 else likelihood
    whole, part = ([t.measured.size for v in each.views for t in v.problem.fit] for each in (likelihood, short))
    kept, early = (np.concatenate([np.arange(n) < m // k for n, m in zip(whole, part, strict=True)]) for k in (1, 2))
    directions = np.zeros((sum(len(probe.rows) for probe in found), len(residual)), dtype=np.float32)

    # of a response: that of the gap, and noise at least
    largest = np.inf if gap is None else np.sqrt(max(gap[kept] @ gap[kept], np.count_nonzero(kept)))

    def simulate(probe: Probe) -> Probe:
        change = short.residual(probe.robots(nominal[probe.effect])) - residual[kept]
        size = largest / np.maximum(np.linalg.norm(change, axis=1), 1e-12)
        if probe.scaled and size.min() * LARGER < 1.0 and probe.effect not in problem.counted:
            probe = probe.shrink(np.minimum(size, 1.0))
            change = short.residual(probe.robots(nominal[probe.effect])) - residual[kept]
        directions[np.ix_(probe.rows, kept)] = change
        return probe

    return Linearisation(directions, tuple(side_by_side([partial(simulate, probe) for probe in found])), kept, early)


def nominal_jacobian(likelihood: Likelihood, e: Explanation, wanted: np.ndarray | None = None) -> np.ndarray:
    """Derivatives (wanted, samples), float32, of the residual by the nominal parameters of an explanation, at it.

    wanted: (nominal,) mask of the parameters; all if None.
    """
    steps = STEP * np.array([p.scale for p in e.parameters[: e.nominal]])
    wanted = np.ones(e.nominal, dtype=bool) if wanted is None else wanted
    moves = (steps[:, None] * np.eye(e.nominal, len(e.x)))[wanted]
    rows = np.array([apply(e.values, e.parameters, x) for x in e.x + moves])
    return likelihood.derivatives(rows, e.residual, steps[wanted])


def probes(problem: Problem, effect: Effect, at: int) -> list[Probe]:
    """Probes of an effect; `at`: first free direction."""
    parameters = effect_parameters(problem.robot, effect)
    if effect.id in problem.counted:
        known = parameters[0].coordinate(problem.counted[effect.id])
        parameters = tuple(replace(p, start=known, bounds=(known, known)) if p.amplitude else p for p in parameters)
    amplitudes = tuple(i for i, p in enumerate(parameters) if p.amplitude)
    start, found = np.array([p.start for p in parameters]), []
    for x in scaled_points(parameters, start, amplitudes):
        ends = np.array([sorted(np.array(parameters[k].bounds) / x[k]) for k in amplitudes])
        rows = np.arange(at, at := at + len(amplitudes))
        found.append(Probe((effect.id,), parameters, x, amplitudes, rows, ends[:, 0], ends[:, 1]))
    for x in fixed_points(parameters, start, amplitudes):
        found.append(Probe((effect.id,), parameters, x, (), np.array([at]), np.ones(1), np.ones(1)))
        at += 1
    return found


def scaled_points(parameters: Sequence[Parameter], start: np.ndarray, amplitudes: Sequence[int]) -> list[np.ndarray]:
    """Coordinates at which directions are taken channel by channel.

    A modest amplitude, further parameters at their initial values and elsewhere in their ranges.
    """
    if not amplitudes:
        return []
    first = start.copy()
    for i in amplitudes:
        first[i] = PROBE * (start[i] if start[i] != 0.0 else parameters[i].scale)
    found = [first]
    channels = {channel for i in amplitudes for channel in parameters[i].channels}
    for i, p in enumerate(parameters):
        if not p.amplitude and (p.channels == ("",) or set(p.channels) == channels):
            low, high = p.bounds if first[i] > 0.5 * sum(p.bounds) else p.bounds[::-1]
            found.append(first.copy())
            found[-1][i] = ELSEWHERE * low + (1.0 - ELSEWHERE) * high
    return found


def fixed_points(parameters: Sequence[Parameter], start: np.ndarray, amplitudes: Sequence[int]) -> list[np.ndarray]:
    """Coordinates that are taken as they are: all channels at once, or a grid for an effect of the whole robot.

    A limit that the motion does not reach shows nothing: it is taken down through its range.
    """
    if amplitudes and (lead := parameters[amplitudes[0]]).channels != ("",):
        found = np.tile(start, (GRID if lead.transform == "reciprocal" else 1, 1))
        found[:, list(amplitudes)] *= STRONG
        if lead.transform == "reciprocal":
            found[:, list(amplitudes)] = np.geomspace(lead.start, lead.bounds[1] / RANGE_FACTOR, GRID)[:, None]
        return [*np.clip(found, *np.array([p.bounds for p in parameters]).T)]
    whole = parameters[0]
    low, high = (b / 2.0 for b in whole.bounds) if whole.amplitude else whole.bounds
    return [np.concatenate([[value], start[1:]]) for value in np.linspace(low, high, GRID) if value != 0.0]
