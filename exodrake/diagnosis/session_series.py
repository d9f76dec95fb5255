"""Series over the sessions of a case: parameters of an explanation and the residual's power, and their changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from exodrake.core.confidence import ALPHA, NORMAL_90
from exodrake.diagnosis.change_point import Change, ChangePoint
from exodrake.diagnosis.levels import Tests
from exodrake.diagnosis.p_values import ViewNull
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.result import AMBIGUOUS, NAMED
from exodrake.diagnosis.sessions import Session, estimates, rows_of

RESIDUAL = "residual"  # name of the series of the residual's power


@dataclass(frozen=True)
class Series:
    """A quantity session by session.

    Attributes:
        name: parameter, or `residual`.
        channel: tendon or joint; empty for one of the whole robot.
        unit: of its values; the residual's power is in noise variances.
        values, low, high: one for each session, with the ends of its 90 % interval [unit].
        p: p-value of no change, corrected for the number of series.
        change: in the series' unit; None where p is above the level.
    """

    name: str
    channel: str
    unit: str
    values: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    p: float
    change: Change | None = None


@dataclass(frozen=True, eq=False)
class Followed:
    """A series in the coordinate of its parameter, which is nearly normal.

    Attributes:
        name: parameter, or `residual`.
        channel: tendon or joint; empty for one of the whole robot.
        unit: unit of its values.
        x: (sessions,) coordinates.
        covariance: (sessions, sessions) of the coordinates.
        parameter: parameter whose coordinate it is; None for the logarithm of the residual's power.
        base: value of the parameter at x = 0, its own if None.
    """

    name: str
    channel: str
    unit: str
    x: np.ndarray
    covariance: np.ndarray
    parameter: Parameter | None = None
    base: float | None = field(default=None)

    def value(self, x: float) -> float:
        """Value at a coordinate [unit]."""
        return float(np.exp(x)) if self.parameter is None else self.parameter.value(float(x), self.base)


@dataclass(frozen=True, eq=False)
class SessionFit:
    """An explanation with parameters of each session.

    Attributes:
        followed: series of the parameters, and of the residual's power where the verdict names no effect.
        chi2: reduced chi-square of what is left; NaN without a parameter of a session.
        p: p-value of it.
    """

    followed: tuple[Followed, ...]
    chi2: float
    p: float


def series_of(
    tests: Tests, e: Explanation, sessions: Sequence[Session], own: Sequence[int], verdict: str
) -> SessionFit:
    """Series of an explanation, those of the parameters at positions `own`, and what they leave.

    The residual's power is followed, too, where the verdict names no effect.
    """
    likelihood = tests.likelihood.scaled_to(e.residual)
    machine, found, chi2, p_left = likelihood.robot.machine, [], float("nan"), float("nan")
    if own:
        law, _ = tests.laws(Projection(likelihood, e, tests.lin))
        made = estimates(likelihood, e, sessions, own, law)
        chi2 = float(np.mean(np.concatenate(made.residuals) ** 2))
        p_left = level_of(tests, law, sessions, made.residuals)
        for k, i in enumerate(own):
            p = e.parameters[i]
            info, base = machine.parameters[p.index[0]], None if p.effect else float(e.values[p.index[0]])
            channel = p.channels[0] if len(p.channels) == 1 else ""
            found.append(Followed(p.name, channel, info.unit, made.x[:, k], made.covariance[k], p, base))
    named = verdict in (NAMED, AMBIGUOUS) and e.effects
    return SessionFit(tuple(found if named else [*found, power_of(tests, e, sessions)]), chi2, p_left)


def level_of(tests: Tests, law: np.ndarray, sessions: Sequence[Session], residuals: Sequence[np.ndarray]) -> float:
    """Smallest p-value (views) of residuals of each session under noise and errors of the laws (draws, samples)."""
    whole = np.zeros(tests.likelihood.samples)
    for session, residual in zip(sessions, residuals, strict=True):
        whole[rows_of(tests.likelihood, session)] = residual
    return min(ViewNull.of(tests.likelihood, tests.noise.retuned, law).p_values(whole))


def power_of(tests: Tests, e: Explanation, sessions: Sequence[Session]) -> Followed:
    """Logarithm of the residual's mean square session by session; its covariance from draws of noise."""
    rows = [rows_of(tests.likelihood, session) for session in sessions]
    logs = np.log([float(np.mean(e.residual[r] ** 2)) for r in rows])
    draws = np.log([np.mean(tests.noise.retuned[:, r] ** 2, axis=1, dtype=float) for r in rows])
    return Followed(RESIDUAL, "", "noise variances", logs, np.diag(draws.var(axis=1, ddof=1)))


def tested(followed: Sequence[Followed], sessions: Sequence[Session]) -> tuple[Series, ...]:
    """Series with their changes, the clearest first."""
    times, rng = np.array([s.time for s in sessions]), np.random.default_rng(len(sessions))
    found = []
    for one in followed:
        scan = ChangePoint(times, one.covariance)
        p = min(1.0, float(scan.p_values(one.x[:, None])[0]) * len(followed))
        change = scan(one.x, rng) if p < ALPHA else None
        half = NORMAL_90 * np.sqrt(np.diag(one.covariance))
        ends = np.sort([[one.value(v) for v in one.x - half], [one.value(v) for v in one.x + half]], axis=0)
        values, low, high = tuple(one.value(v) for v in one.x), tuple(ends[0].tolist()), tuple(ends[1].tolist())
        stated = None if change is None else in_unit(one, change)
        order = (p, 0.0 if change is None else -change.size)
        found.append((order, Series(one.name, one.channel, one.unit, values, low, high, p, stated)))
    return tuple(series for _, series in sorted(found, key=lambda item: item[0]))


def in_unit(one: Followed, change: Change) -> Change:
    """A change of a coordinate in the unit of its values; the rate is that of the value at the last point."""
    before, after = (tuple(sorted_about([one.value(v) for v in ends])) for ends in (change.before, change.after))
    slope = (one.value(change.after[0] + 1e-4) - one.value(change.after[0] - 1e-4)) / 2e-4
    rate = tuple(sorted_about([slope * v for v in change.rate]))
    return replace(change, before=before, after=after, rate=rate)


def sorted_about(ends: Sequence[float]) -> list[float]:
    """Value, low, high with the ends in order."""
    value, *rest = ends
    return [value, *sorted(rest)]
