"""Screening: every effect's response at a point, combined linearly with those of the nominal numbers, tells which
effects to fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.diagnosis.fit import Fitter, Point, bounded_solve
from exodrake.diagnosis.hypothesis import Coordinate, Hypothesis, hypothesis
from exodrake.diagnosis.line import TREMOR

PROBE = 0.6  # amplitude at which an effect is tried, in units of its typical value
FAR = 0.7  # of the way through its range at which a further number is tried
STRONG = 2.5  # times the usual amount
TURNS = 5  # values at which an effect of the whole robot is tried


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of a hypothesis may start: u (effect coordinates) and x (nominal coordinates), and the cost that
    the linear model promises.
    """

    hypothesis: Hypothesis
    u: np.ndarray
    x: np.ndarray
    cost: float


def library(fitter: Fitter, point: Point) -> list[Effect]:
    """Effects to try beside those of a point's hypothesis; a tremor is detected (`line.py`), not fitted."""
    known = {TREMOR, *point.hypothesis.effects}
    return [e for e in fitter.problem.robot.machine.effects if e.id in fitter.problem.tried and e.id not in known]


def chosen(machine: Machine, only: Sequence[str] = (), without: Sequence[str] = ()) -> frozenset[str]:
    """Ids of the effects that a diagnosis shall try.

    Args:
        machine: whose effects.
        only: ids to try, also of effects that are `not_tried` by default; empty: the default ones.
        without: ids to leave out.
    Raises:
        InputError: for an unknown id, or where nothing is left.
    """
    named = {identity: machine.effect(identity) for identity in (*only, *without)}
    default = [effect.id for effect in machine.effects if not effect.not_tried]
    tried = frozenset(only or default) - set(without)
    if not tried - {TREMOR}:
        raise InputError(f"no effect is left to try without {', '.join(named)}")
    return tried


def screened(fitter: Fitter, point: Point, responses: np.ndarray, gram: np.ndarray) -> list[Start]:
    """A start for each effect beside those of the point, best first. responses (samples, nominal coordinates), gram
    their products.
    """
    found = []
    for effect in library(fitter, point):
        extra = hypothesis(fitter.problem.robot.machine, effect)
        tried = [linearised(fitter, point, extra, probe, responses, gram) for probe in probes(extra)]
        tried += [linearised(fitter, point, extra, whole, responses, gram, channels=()) for whole in turns(extra)]
        found.append(min(tried, key=lambda start: start.cost))
    return sorted(found, key=lambda start: start.cost)


def linearised(
    fitter: Fitter,
    point: Point,
    extra: Hypothesis,
    probe: np.ndarray,
    responses: np.ndarray,
    gram: np.ndarray,
    channels: Sequence[int] | None = None,
) -> Start:
    """The best combination of the effect's responses channel by channel and of the nominal coordinates, within bounds.

    channels: coordinates whose amplitudes may be scaled, all first ones by default; with none the probe is taken as
    it is.
    """
    both = point.hypothesis.joined(extra)
    channels = (
        [i for i, coordinate in enumerate(extra.coordinates) if coordinate.first]
        if channels is None
        else list(channels)
    )
    rows = [
        fitter.values(both, np.concatenate([point.u, alone(probe, channels, channel)]), point.x)
        for channel in channels or [0]
    ]
    directions = (fitter.problem.residual(np.array(rows), fitter.problem.fit) - point.residual).T
    count, prior = directions.shape[1], 1.0 / fitter.spread**2
    cross = directions.T @ responses
    normal = np.block([[directions.T @ directions, cross], [cross.T, gram + np.diag(prior)]])
    normal[np.diag_indices(count)] += 1e-9 * np.trace(normal[:count, :count]) + 1e-9
    descent = -np.concatenate([directions.T @ point.residual, responses.T @ point.residual + prior * point.x])
    low, high = amplitude_bounds(extra, probe, channels)
    limit = fitter.limit
    move = bounded_solve(
        normal, descent, np.concatenate([low, -limit - point.x]), np.concatenate([high, limit - point.x])
    )
    u = probe.copy()
    u[channels] = probe[channels] * move[:count]
    cost = point.cost - float(descent @ move) + 0.5 * float(move @ normal @ move)
    return Start(both, np.concatenate([point.u, u]), point.x + move[count:], cost)


def alone(probe: np.ndarray, channels: list[int], channel: int) -> np.ndarray:
    """The probe with all other channels at neutral; as it is for an effect that is on or off."""
    u = probe.copy()
    u[[i for i in channels if i != channel]] = 0.0
    return u


def amplitude_bounds(extra: Hypothesis, probe: np.ndarray, channels: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """How far each direction may be scaled; an effect that is on or off is taken as it is."""
    if not channels:
        return np.array([1.0]), np.array([1.0 + 1e-9])
    ends = extra.bounds[channels] / probe[channels][:, None]
    return ends.min(axis=1), ends.max(axis=1)


def probes(extra: Hypothesis) -> list[np.ndarray]:
    """Values of u at which an effect's response is measured: a modest amplitude, its further numbers as usual and
    elsewhere.
    """
    if not any(coordinate.first for coordinate in extra.coordinates):
        return []
    first = extra.start
    for i, coordinate in enumerate(extra.coordinates):
        if coordinate.first:
            first[i] = PROBE * (coordinate.start if coordinate.start != 0.0 else coordinate.scale)
    found = [first]
    for i, coordinate in enumerate(extra.coordinates):
        if not coordinate.first and (len(coordinate.channels) > 1 or coordinate.channels == ("",)):
            found += [elsewhere(first, i, value) for value in other_values(coordinate, first[i])]
    return found


def elsewhere(u: np.ndarray, i: int, value: float) -> np.ndarray:
    """u with its entry i at `value`."""
    moved = u.copy()
    moved[i] = value
    return moved


def other_values(coordinate: Coordinate, default: float) -> list[float]:
    """Where a further number is tried besides its usual value: well inside its range, on the wider side."""
    low, high = coordinate.plausible
    return [FAR * high + (1.0 - FAR) * low if default < 0.5 * (low + high) else FAR * low + (1.0 - FAR) * high]


def turns(extra: Hypothesis) -> list[np.ndarray]:
    """Values of u to be taken as they are: a contact, a clipped current or a direction of gravity respond in no
    proportion to them. The plausible range of a number of the whole robot; the usual amount on all channels at once,
    and a strong one, since what is small may hide below a threshold.
    """
    lead = extra.coordinates[0]
    if lead.first and lead.channels != ("",):
        strong = np.where([coordinate.first for coordinate in extra.coordinates], STRONG, 1.0) * extra.start
        return [extra.start, np.clip(strong, *extra.bounds.T)]
    low, high = sorted((lead.at(lead.number.low), lead.at(lead.number.high))) if lead.first else lead.plausible
    return [np.concatenate([[value], extra.start[1:]]) for value in np.linspace(low, high, TURNS)]
