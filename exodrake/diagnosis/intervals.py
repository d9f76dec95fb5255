"""Intervals of fitted parameters, and the channels that an effect sits on.

Errors of the fit follow from noise and from errors of its laws (`levels`), by the curvature at its minimum:

    dx = -(J'J + P)^-1 (J' (w + a c h) + P^1/2 z)          J Jacobian, P prior precision, z white

Draws of dx give the covariance of the parameters. They hold coloured noise and the model discrepancy that the residual
shows, a typical one at least. A further error that no residual shows is added (`Effect.law_std`): a parameter of
friction, creep or contact belongs to a law, a real robot follows another law, and the fitted value is an effective one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.confidence import CONFIDENCE, NORMAL_90
from exodrake.core.effect import SHAPE_STD, Effect
from exodrake.core.signal import SCALAR, TENDONS
from exodrake.diagnosis.channels import affected_channels
from exodrake.diagnosis.gap import Interval
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.result import NamedEffect

ROUNDING = 0.01  # relative standard deviation between two simulators of one law: integration and rounding; assumed


@dataclass(frozen=True, eq=False)
class Fitted:
    """Fitted parameters of effects.

    Attributes:
        parameters: of the effects.
        x: (parameters,) coordinates.
        covariance: (parameters, parameters) of x.
    """

    parameters: tuple[Parameter, ...]
    x: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of x (parameters,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def of(self, effect: str) -> Fitted:
        """The parameters of one effect."""
        mine = [i for i, p in enumerate(self.parameters) if p.effect == effect]
        return Fitted(tuple(self.parameters[i] for i in mine), self.x[mine], self.covariance[np.ix_(mine, mine)])

    def holds_null(self) -> bool:
        """Whether the 90 % region of the amplitudes holds 0 (Wald); an effect without an amplitude is present."""
        from scipy.stats import chi2

        mine = [i for i, p in enumerate(self.parameters) if p.amplitude]
        x, precision = self.x[mine], np.linalg.pinv(self.covariance[np.ix_(mine, mine)])
        return bool(mine and x @ precision @ x <= chi2.ppf(CONFIDENCE, len(mine)))


def affected(fitted: Fitted) -> list[int]:
    """Positions of the per-channel parameters of an effect whose channels count as affected."""
    lead = next(p.name for p in fitted.parameters)
    mine = [i for i, p in enumerate(fitted.parameters) if p.name == lead and len(p.channels) == 1 and p.channels[0]]
    return [mine[i] for i in affected_channels(fitted.x[mine], fitted.covariance[np.ix_(mine, mine)])] if mine else []


def describe(fitted: Fitted, effect: Effect, probability: float, channels: tuple[str, ...]) -> NamedEffect:
    """An effect with its channels, parameters and intervals.

    Args:
        fitted: its parameters.
        effect: the effect.
        probability: of the explanation that it belongs to.
        channels: those of its axis.
    """
    chosen, parameters, by_channel = affected(fitted), {}, {}
    info, law = {p.name: p for p in effect.parameters}, [law_std(effect, p) for p in fitted.parameters]
    sits = tuple(fitted.parameters[i].channels[0] for i in chosen) or tuple(c for c in channels if c)
    if chosen:
        first = fitted.parameters[chosen[0]]
        name = first.name.removeprefix(f"{effect.id}.")
        unit = info[name].unit
        by_channel[name] = {
            fitted.parameters[i].channels[0]: interval(fitted.parameters[i], fitted.x[i], fitted.std[i], unit, law[i])
            for i in chosen
        }
        mean, std = pooled(fitted.x[chosen], fitted.covariance[np.ix_(chosen, chosen)])
        parameters[name] = interval(first, mean, std, unit, law[chosen[0]])
    for i, p in enumerate(fitted.parameters):
        name = p.name.removeprefix(f"{effect.id}.")
        if name not in parameters and i not in chosen:
            parameters[name] = wrapped(interval(p, fitted.x[i], fitted.std[i], info[name].unit, law[i]), effect, name)
    tendons, joints = (sits, ()) if effect.axis == TENDONS else ((), () if effect.axis == SCALAR else sits)
    return NamedEffect(effect.id, tendons, joints, parameters, by_channel, probability)


def law_std(effect: Effect, parameter: Parameter) -> float:
    """Relative standard deviation of a parameter between two laws of its effect, or between two simulators of one."""
    if effect.same_meaning:
        return ROUNDING
    return effect.law_std if parameter.amplitude else max(effect.law_std, SHAPE_STD)


def pooled(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Common value of several channels and its standard deviation.

    Channels that scatter by more than their own errors differ by a variance of their own, which is estimated by moments
    (DerSimonian & Laird 1986).
    """
    count, own = len(values), float(max(np.mean(covariance), 0.0))
    if count == 1:
        return float(values[0]), float(np.sqrt(own))
    expected = (np.trace(covariance) - count * own) / (count - 1)
    between = max(float(np.var(values, ddof=1) - expected), 0.0)
    return float(np.mean(values)), float(np.sqrt(own + between / count))


def interval(parameter: Parameter, x: float, std: float, unit: str, law: float = ROUNDING) -> Interval:
    """90 % interval of a parameter in its own unit; `law`: relative error that is added.

    An interval ends at the parameter's bounds, beyond which it has no meaning or no fit would go.
    """
    of_value = parameter.transform == "log" and not parameter.amplitude  # an amplitude is 0 where the effect is absent
    half = NORMAL_90 * float(np.hypot(std, law if of_value else law * abs(x)))
    low, high = max(x - half, min(x, parameter.bounds[0])), min(x + half, max(x, parameter.bounds[1]))
    ends = [parameter.value(low), parameter.value(high)]
    return Interval(parameter.value(x), min(ends), max(ends), unit)


def wrapped(found: Interval, effect: Effect, name: str) -> Interval:
    """The interval of a periodic parameter moved by whole periods, so that its value lies in its range."""
    info = next(p for p in effect.parameters if p.name == name)
    turns = info.wrapped(found.value) - found.value
    return Interval(found.value + turns, found.low + turns, found.high + turns, found.unit)
