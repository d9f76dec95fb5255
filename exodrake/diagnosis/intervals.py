"""Intervals of fitted parameters, and the channels that an effect really sits on.

Residuals are coloured, so J'J alone is too sure: so many frames count as one (`Fitter`), against the errors that the
nominal numbers usually have; covariance = (J'J / frames + prior)^-1. To that comes what no residual shows: a parameter
of friction, creep or contact belongs to a law, reality follows another one, and the fitted value is an effective one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.signal import SCALAR, TENDONS
from exodrake.diagnosis.fit import Fitter, Point
from exodrake.diagnosis.hypothesis import Coordinate
from exodrake.diagnosis.result import Interval, NamedEffect

Z90 = 1.645  # half width of a 90 % interval in standard deviations
# relative standard deviation between the parameters of two laws of one effect: development cases of the blind package
LAW = 0.2
SAME_LAW = 0.01  # of a parameter that means the same in every law: integration and rounding; assumed
PRESENT = 4.0  # standard deviations from neutral at which a channel counts as affected
MINOR = 0.12  # of the strongest channel: weaker channels count as leakage from it


@dataclass(frozen=True, eq=False)
class Spread:
    """A fitted point with the covariance of its effect parameters u (coordinates, coordinates)."""

    point: Point
    covariance: np.ndarray

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations of u (coordinates,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def spread(fitter: Fitter, point: Point, responses: np.ndarray) -> Spread:
    """A fitted point with the covariance of its effect parameters; `fitter`: the one that it was minimised with."""
    count = len(point.u)
    return Spread(point, covariance(fitter, point, responses)[:count, :count])


def covariance(fitter: Fitter, point: Point, responses: np.ndarray) -> np.ndarray:
    """Covariance of effect parameters and nominal coordinates at a fitted point, (u + x, u + x)."""
    scales = point.hypothesis.scales
    jacobian = np.concatenate([fitter.slopes(point, central=True) * scales, responses], axis=1)
    count = len(scales)
    prior = np.concatenate([np.full(count, 1e-9), 1.0 / fitter.spread**2])
    normal = jacobian.T @ jacobian + np.diag(prior)
    found = np.linalg.inv(normal + 1e-10 * np.diag(np.diag(normal))) * fitter.frames * max(1.0, point.chi2)
    units = np.concatenate([scales, np.ones(len(fitter.coordinates))])
    return found * np.outer(units, units)


def affected(estimate: Spread, effect: str) -> list[int]:
    """Knobs of an effect's first number whose channels count as affected; at least the strongest."""
    coordinates = estimate.point.hypothesis.coordinates
    mine = [
        i
        for i, k in enumerate(coordinates)
        if k.effect == effect and len(k.channels) == 1 and (k.first or k.number.name == lead(coordinates, effect))
    ]
    strength = np.abs(estimate.point.u[mine])
    sure = strength > PRESENT * np.maximum(estimate.deviations[mine], 1e-12)
    chosen = [i for i, s, ok in zip(mine, strength, sure, strict=True) if ok and s > MINOR * strength.max()]
    return chosen or [mine[int(np.argmax(strength))]]


def lead(coordinates: tuple[Coordinate, ...], effect: str) -> str:
    """Name of the first fitted number of an effect."""
    return next(k.number.name for k in coordinates if k.effect == effect)


def describe(estimate: Spread, named: Effect, probability: float, channels: tuple[str, ...]) -> NamedEffect:
    """An effect with its channels, parameters and intervals; channels: all those of its axis."""
    effect, axis, law = named.id, named.axis, SAME_LAW if named.same_meaning else LAW
    point, coordinates = estimate.point, estimate.point.hypothesis.coordinates
    chosen = (
        affected(estimate, effect)
        if any(len(k.channels) == 1 and k.channels[0] for k in coordinates if k.effect == effect)
        else []
    )
    sits = tuple(coordinates[i].channels[0] for i in chosen) or tuple(x for x in channels if x)
    parameters, by_channel = {}, {}
    if chosen:
        number = coordinates[chosen[0]].number
        by_channel[number.name] = {
            coordinates[i].channels[0]: interval(coordinates[i], point.u[i], estimate.deviations[i], law)
            for i in chosen
        }
        mean, deviation = pooled(point.u[chosen], estimate.covariance[np.ix_(chosen, chosen)])
        parameters[number.name] = interval(coordinates[chosen[0]], mean, deviation, law)
    for i, coordinate in enumerate(coordinates):
        if coordinate.effect == effect and coordinate.number.name not in parameters and i not in chosen:
            parameters[coordinate.number.name] = interval(coordinate, point.u[i], estimate.deviations[i], law)
    wires = sits if axis == TENDONS else ()
    return NamedEffect(
        effect, wires, sits if axis not in (TENDONS, SCALAR) else (), parameters, by_channel, probability
    )


def pooled(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Common value of several channels and its standard deviation, channels that disagree widening it."""
    if len(values) == 1:
        return float(values[0]), float(np.sqrt(covariance[0, 0]))
    mean = float(np.mean(values))
    own = float(np.sqrt(np.mean(covariance)))
    return mean, float(np.hypot(own, np.std(values, ddof=1) / np.sqrt(len(values))))


def interval(coordinate: Coordinate, u: float, deviation: float, law: float = LAW) -> Interval:
    """90 % interval of a parameter in its own unit, the error of its law included; one of unknown magnitude ends at the
    number's plausible range.
    """
    whole = float(np.hypot(deviation, law if coordinate.number.transform == "log" else law * abs(u)))
    low, high = u - Z90 * whole, u + Z90 * whole
    if coordinate.number.transform == "log":
        low, high = max(low, min(u, coordinate.bounds[0])), min(high, max(u, coordinate.bounds[1]))
    ends = [coordinate.value(low), coordinate.value(high)]
    value = coordinate.value(u)
    turns = coordinate.number.wrapped(value) - value
    return Interval(value + turns, min(ends) + turns, max(ends) + turns, coordinate.number.unit)
