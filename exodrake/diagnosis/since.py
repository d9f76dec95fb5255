"""Since when: change points over the sessions of a case, of the named effect's parameters and of the residual.

A series is a quantity session by session: the amplitudes of the effects of the explanation behind the verdict; for
RETUNE the nominal parameters that moved; where no effect is named, the residual's power, too. Each is tested for a
change (`change_point`), with Bonferroni's correction for their number. A robot that changed has no constant
explanation, so its case may be UNKNOWN: then the single effect is followed that leaves least with amplitudes of its
own in each session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import LEAST, Change, ChangePoint
from exodrake.diagnosis.intervals import Z90
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.levels import Tests
from exodrake.diagnosis.likelihood import likelihood_of
from exodrake.diagnosis.linearise import Linearisation, nominal_jacobian
from exodrake.diagnosis.moved import moved
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN
from exodrake.diagnosis.sessions import Session, dated_sessions, estimates, rows_of, windows
from exodrake.diagnosis.verdict import Decision

RESIDUAL = "residual"  # name of the series of the residual's power
MOST, TRIED = 4, 5  # nominal parameters that are followed, and single effects that are tried
FEW = "{} sessions: a change needs {} or more"


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


@dataclass(frozen=True)
class Since:
    """When a case changed.

    Attributes:
        sessions: names, dates or windows.
        times: of the sessions [unit].
        unit: `d` since the first session, or `s` since the log's begin.
        series: of all quantities, the clearest change first.
        effect: id of the followed effect where the verdict names none; empty otherwise.
        chi2: reduced chi-square that is left with parameters of its own in each session; NaN if none is followed.
        note: why nothing could be said; empty otherwise.
    """

    sessions: tuple[str, ...]
    times: tuple[float, ...]
    unit: str
    series: tuple[Series, ...] = ()
    effect: str = ""
    chi2: float = float("nan")
    note: str = ""

    @property
    def clearest(self) -> Series | None:
        """The series whose change is clearest; None if none changed."""
        return next((s for s in self.series if s.change is not None), None)

    def moment(self, time: float) -> str:
        """A time of `times` [unit] as a date, to the minute where sessions lie closer than days; of one log in s."""
        if self.unit == "s":
            return f"{time:.0f} s"
        date = datetime.fromisoformat(self.sessions[0]) + timedelta(days=time)
        steps = np.diff(self.times)
        whole = "T" not in "".join(self.sessions) and (len(steps) == 0 or steps.min() >= 1.0)
        return date.date().isoformat() if whole else date.isoformat(timespec="minutes")

    @property
    def began(self) -> dict[str, str] | None:
        """Date of the clearest change and the ends of its 90 % set; None without a change."""
        if self.clearest is None or self.clearest.change is None:
            return None
        return dict(zip(("value", "low", "high"), map(self.moment, self.clearest.change.began), strict=True))

    def to_json(self) -> dict[str, object]:
        """Fields, and whether there is a change."""
        names = ("sessions", "times", "unit", "series", "effect", "chi2", "note")
        return {"changed": self.clearest is not None, "began": self.began} | {
            name: getattr(self, name) for name in names
        }


def since_of(problem: Problem, found: Isolation, decision: Decision) -> Since | None:
    """What the sessions of a case say; None of a case without dates whose logs are several or short."""
    sessions = dated_sessions(problem.case, [trial.name for trial in problem.fit])
    unit = "d"
    if not sessions:
        unit, frames = "s", sum(len(t.reference) for t in problem.fit)
        sessions = windows(frames, problem.robot.machine.frame) if len(problem.fit) == 1 else ()
    if len(sessions) < (LEAST if unit == "s" else 2):
        return None
    since = Since(tuple(s.name for s in sessions), tuple(s.time for s in sessions), unit)
    if len(sessions) < LEAST:
        return replace(since, note=FEW.format(len(sessions), LEAST))
    e, effect, tests = decision.best.explanation, "", None
    if decision.verdict == UNKNOWN and found.tested:
        tests = whole(problem, found, found.retuned.explanation) if unit == "s" else found.tests
        e = changing(found, tests, sessions)
        effect = e.name
    tests = tests if tests and unit == "s" else whole(problem, found, e)
    followed, chi2 = series_of(tests, on_whole(tests, e), sessions, own(found, e), decision.verdict)
    return replace(since, series=tested(followed, sessions), effect=effect, chi2=chi2)


def changing(found: Isolation, tests: Tests, sessions: Sequence[Session]) -> Explanation:
    """The single effect that leaves least with amplitudes of its own in each session, on the frames of the tests."""

    def left(e: Explanation) -> float:
        e = e if tests is found.tests else on_whole(tests, e)
        none = np.zeros((2, len(e.residual)))
        fitted = estimates(tests.likelihood.scaled_to(e.residual), e, sessions, own(found, e), none)
        return sum(float(r @ r) for r in fitted.residuals)

    return min((t.explanation for t in found.tested[0][:TRIED]), key=left)


def whole(problem: Problem, found: Isolation, e: Explanation) -> Tests:
    """Tests of one explanation on all frames of the logs."""
    likelihood = likelihood_of(problem, e.robot)
    likelihood.simulated, likelihood.stage = found.likelihood.simulated, "since"
    samples = likelihood.samples
    lin = Linearisation((), np.zeros(0), np.zeros(samples), np.zeros((0, samples)), np.zeros((0, samples)), ())
    return Tests(likelihood, lin, np.zeros(samples))


def on_whole(tests: Tests, e: Explanation) -> Explanation:
    """An explanation with residual and nominal Jacobian on all frames of the logs."""
    residual, n = tests.likelihood.residual(e.robot[None])[0], e.nominal
    columns = nominal_jacobian(tests.likelihood, e.at_nominal, e.parameters[:n], e.x[:n], residual)
    return replace(e, residual=residual, jacobian=columns)


def own(found: Isolation, e: Explanation) -> list[int]:
    """Positions of the parameters that are followed: amplitudes of effects, or nominal parameters that moved."""
    leads = {next(p.name for p in e.parameters if p.effect == effect) for effect in e.effects}
    if e.effects:
        return [i for i, p in enumerate(e.parameters) if p.name in leads]
    names = [m.name for m in moved(found)][:MOST]
    return [i for i, p in enumerate(e.parameters) if p.name in names and e.x[i] != 0.0]


@dataclass(frozen=True, eq=False)
class Followed:
    """A series in the coordinate that is nearly normal: values (sessions,), covariance (sessions, sessions).

    parameter: whose coordinate it is; None for the logarithm of the residual's power.
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


def series_of(
    tests: Tests, e: Explanation, sessions: Sequence[Session], own: Sequence[int], verdict: str
) -> tuple[list[Followed], float]:
    """Series of an explanation, and the reduced chi-square that is left with its own parameters in each session.

    The residual's power is followed, too, where the verdict names no effect.
    """
    likelihood = tests.likelihood.scaled_to(e.residual)
    machine, found, chi2 = likelihood.robot.machine, [], float("nan")
    if own:
        law, _ = tests.laws(Projection(likelihood, e, tests.lin))
        fitted = estimates(likelihood, e, sessions, own, law)
        chi2 = float(np.mean(np.concatenate(fitted.residuals) ** 2))
        for k, i in enumerate(own):
            p = e.parameters[i]
            info, base = machine.parameters[p.index[0]], None if p.effect else float(e.values[p.index[0]])
            channel = p.channels[0] if len(p.channels) == 1 else ""
            found.append(Followed(p.name, channel, info.unit, fitted.x[:, k], fitted.covariance[k], p, base))
    named = verdict in (NAMED, AMBIGUOUS) and e.effects
    return (found if named else [*found, power_of(tests, e, sessions)]), chi2


def power_of(tests: Tests, e: Explanation, sessions: Sequence[Session]) -> Followed:
    """Logarithm of the residual's mean square session by session; its covariance from draws of noise."""
    rows = [rows_of(tests.likelihood, session) for session in sessions]
    logs = np.log([float(np.mean(e.residual[r] ** 2)) for r in rows])
    draws = np.log([np.mean(tests.noise[:, r] ** 2, axis=1, dtype=float) for r in rows])
    return Followed(RESIDUAL, "", "noise variances", logs, np.diag(draws.var(axis=1, ddof=1)))


def tested(followed: Sequence[Followed], sessions: Sequence[Session]) -> tuple[Series, ...]:
    """Series with their changes, the clearest first."""
    times, rng = np.array([s.time for s in sessions]), np.random.default_rng(len(sessions))
    found = []
    for one in followed:
        scan = ChangePoint(times, one.covariance)
        p = min(1.0, float(scan.p_values(one.x[:, None])[0]) * len(followed))
        change = scan(one.x, rng) if p < ALPHA else None
        half = Z90 * np.sqrt(np.diag(one.covariance))
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
