"""Intervals of the fitted parameters of effects, and the channels that an effect sits on.

The covariance is that of the linear model about the fit, nominal parameters and other effects included, widened where
stretches of the logs contradict it (`LinearModel.robust_covariance`).
An error that no residual shows is added (`Effect.law_std`): a parameter of friction, creep or contact belongs to a law,
a real robot follows another law, and the fitted value is an effective one.

The channels of an effect are the set S of largest evidence. Its fitted amplitudes x are normal numbers about 0,

    var x = C + L^2 + s^2 1_S 1_S' + (c s)^2 1_S      one cause: the channels of S share a value
    var x = C + L^2 + s^2 1_S                         each channel of S has a value of its own

s: largest amplitude; C: covariance of the fit; L: what a wrong law leaks into each channel, a share of s and of the
largest response; c: difference between channels of one cause. The evidence of S is the mean of both densities. A
channel that the motion hardly excites then follows the others. A test of each channel alone would leave it out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.confidence import NORMAL_90
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.result import Interval, NamedEffect
from exodrake.diagnosis.search import Fitted, name_kind
from exodrake.model.effect import SHAPE_STD, Effect
from exodrake.model.machine import Machine
from exodrake.model.part import SCALAR, TENDONS

# relative standard deviation of a parameter that means the same in two simulators, or machines, which differ otherwise:
# RMS error of seven such parameters on development cases of the reference simulator
ROUNDING = 0.016
UNSURE = float("nan")
# of the largest amplitude and of the largest response, into channels without the effect: development cases of the
# reference simulator
LEAK = 0.12
SPREAD = 0.2  # of the largest amplitude, between channels with one cause: as the parameters of two laws differ
ONE_OR_ALL = 0.4  # prior probability of one channel, and of all of them; other sets share what is left: assumed


@dataclass(frozen=True, eq=False)
class Estimates:
    """Fitted parameters of effects."""

    parameters: tuple[Parameter, ...]  # of the effects
    x: np.ndarray  # (parameters,) coordinates
    covariance: np.ndarray  # (parameters, parameters) of x
    shown: np.ndarray  # (parameters,) response to x = 1, in a unit common to all

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of x (parameters,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def of(self, effect: str) -> Estimates:
        """The parameters of one effect."""
        mine = [i for i, p in enumerate(self.parameters) if p.effect == effect]
        own = self.x[mine], self.covariance[np.ix_(mine, mine)], self.shown[mine]
        return Estimates(tuple(self.parameters[i] for i in mine), *own)


def fitted_effects(best: Fitted) -> Estimates:
    """Parameters of the effects of a fit, with the covariance of its linear model."""
    e, model = best.explanation, replace(best.model, memory=best.memory)
    own = slice(e.nominal, None)
    shown = np.sqrt(np.diag(model.weight_products())[:-1])
    return Estimates(e.parameters[own], e.x[own], model.robust_covariance()[own, own], shown[own])


def describe(found: Estimates, effect: Effect, channels: tuple[str, ...]) -> NamedEffect:
    """An effect with its channels, parameters and intervals; channels: those of its axis."""
    info, stated = {p.name: p for p in effect.parameters}, dict[str, Interval]()
    by_channel: dict[str, dict[str, Interval]] = {}
    names = [p.name.removeprefix(f"{effect.id}.") for p in found.parameters]
    lead = found.parameters[0].name
    mine = [i for i, p in enumerate(found.parameters) if p.name == lead and len(p.channels) == 1 and p.channels[0]]
    mine = [i for i in mine if found.shown[i] > 0.0] or mine  # where nothing shows it cannot sit
    one = found.x[mine], found.covariance[np.ix_(mine, mine)], found.shown[mine]
    sits = affected_channels(*one) if mine else ()
    if chosen := [mine[int(i)] for i in sits]:
        first, name = found.parameters[chosen[0]], names[chosen[0]]
        law, unit = law_std(effect, first), info[name].unit
        own = {
            found.parameters[i].channels[0]: interval(found.parameters[i], found.x[i], found.std[i], unit, law)
            for i in chosen
        }
        mean, std = pool_channels(found.x[chosen], found.covariance[np.ix_(chosen, chosen)])
        differ = max(i.low for i in own.values()) > min(i.high for i in own.values())
        by_channel[name] = own
        stated[name] = Interval(UNSURE, UNSURE, UNSURE, unit) if differ else interval(first, mean, std, unit, law)
    for i, (p, name) in enumerate(zip(found.parameters, names, strict=True)):
        if name not in stated:
            one = interval(p, float(found.x[i]), float(found.std[i]), info[name].unit, law_std(effect, p))
            turns = info[name].wrap(one.value) - one.value  # of a periodic parameter, into its range
            stated[name] = replace(one, value=one.value + turns, low=one.low + turns, high=one.high + turns)
    sits = tuple(found.parameters[i].channels[0] for i in chosen) or tuple(c for c in channels if c)
    tendons, joints = (sits, ()) if effect.axis == TENDONS else ((), () if effect.axis == SCALAR else sits)
    return NamedEffect(effect.id, tendons, joints, stated, by_channel, name_kind(effect))


def find_traces(found: Estimates, machine: Machine) -> list[Parameter]:
    """Amplitudes of effects on channels that they do not sit on, with 90 % intervals that hold 0.

    A fit gives every channel an amplitude; such a one comes from noise and the error of the law.
    """
    sits: dict[str, set[str]] = {}
    for effect in (machine.effect(i) for i in {p.effect for p in found.parameters}):
        named = describe(found.of(effect.id), effect, machine.axes.of(effect.axis))
        sits[effect.id] = {"", *named.wires, *named.joints}
    elsewhere = [p.amplitude and not sits[p.effect].issuperset(p.channels) for p in found.parameters]
    small = np.abs(found.x) < NORMAL_90 * found.std
    return [p for p, *both in zip(found.parameters, elsewhere, small, strict=True) if all(both)]


def law_std(effect: Effect, parameter: Parameter) -> float:
    """Relative standard deviation of a parameter between two laws of its effect, or between two simulators of one."""
    if effect.same_meaning:
        return ROUNDING
    return effect.law_std if parameter.amplitude else max(effect.law_std, SHAPE_STD)


def pool_channels(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
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


def affected_channels(x: np.ndarray, covariance: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Positions of the channels that an effect sits on, in their order; those more surely not 0 come in first.

    A channel whose amplitude ended at 0, a bound, has none, however little its motion tells of it.

    x: (channels,) fitted amplitudes. covariance: (channels, channels) of x. shown: (channels,) response to x = 1.
    """
    if not np.any(x):
        return np.array([0])
    size, count = np.max(np.abs(x)), len(x)
    leak = LEAK * np.minimum(size, np.max(np.abs(x) * shown) / np.maximum(shown, 1e-12))
    order = np.argsort(-np.abs(x) / np.sqrt(np.diag(covariance) + leak**2), kind="stable")
    sets = [order[:number] for number in range(1, np.count_nonzero(x) + 1)]

    def evidence(chosen: np.ndarray) -> float:
        """Logarithm of the probability density of x with the effect on the chosen channels, but for a constant."""
        there, densities = np.isin(np.arange(count), chosen).astype(float), []
        others = (1.0 - 2.0 * ONE_OR_ALL) / (count - 2) if count > 2 else ONE_OR_ALL
        prior = ONE_OR_ALL if len(chosen) in (1, count) else others
        outside = covariance + np.diag(leak**2)
        one_cause = size**2 * (np.outer(there, there) + SPREAD**2 * np.diag(there))
        for inside in (one_cause, size**2 * np.diag(there)):
            whole = outside + inside
            densities.append(float(-0.5 * (x @ np.linalg.solve(whole, x) + np.linalg.slogdet(whole)[1])))
        return float(np.log(prior)) + float(np.logaddexp.reduce(densities))

    return np.sort(sets[int(np.argmax([evidence(chosen) for chosen in sets]))])
