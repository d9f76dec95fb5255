"""Changes over the sessions of a case: an explanation's parameters session by session, and their change points.

A session is the logs of one date, or a stretch of one long log. All sessions share the nominal parameters; each has the
amplitudes of the effects for itself, as further columns of the `LinearModel` about the fit, whose blocks are the
sessions. Logs by date are simulated again with what their session has found, and the step is repeated. Each series is
tested for a change (`change_point`), with Bonferroni's correction for their number. What is followed are the amplitudes
of the effects behind the verdict; of RETUNE the nominal parameters that moved; without an effect the residual, too.

A robot that changed has no constant explanation: its case may be UNKNOWN, or several effects imitate the change. So
single effects with amplitudes of their own in each session are compared with that explanation by their evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
from scipy.special import expit

from exodrake.core.confidence import ALPHA, NORMAL_90
from exodrake.data.case import Case, written_date
from exodrake.diagnosis.change_point import DAY, LEAST, Change, ChangePoint
from exodrake.diagnosis.fit import Explanation, fit_beside, whole_jacobian
from exodrake.diagnosis.gap import Interval
from exodrake.diagnosis.isolation import Isolation, affordable
from exodrake.diagnosis.likelihood import Likelihood, View, with_prediction
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.linearise import Probe, nominal_jacobian
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, CAUSE, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN
from exodrake.diagnosis.search import NATS, Predicted
from exodrake.diagnosis.verdict import EXPLAINED, MOST, Decision, Part

RESIDUAL = "residual"  # name of the series of the residual's power
SAMPLES = 500_000  # in which changes are sought: 4 GB with the 60 parameters of an Exo-Index
WINDOW, WINDOWS = 10.0, 24  # s of a long log that count as a session at least, longer than loops remember; most of them
ROUNDS, CONVERGED = 5, 0.1  # steps of logs by date at most, and the step that ends them [standard deviations]
MOVED, FOLLOWED = 1.0, 4  # tolerances from which a nominal parameter counts as moved, and how many are followed
SCREENED = 2  # effects that are tried beside those fitted with constant parameters
FEW = "{} sessions: a change needs {} or more"


@dataclass(frozen=True, eq=False)
class Session:
    """A session.

    Attributes:
        name: its date, or the window of the log.
        time: days since the first session's date; of a window its middle [s].
        logs: positions of its logs among those that are fitted.
        frames: window (first, end) of the log in frames; None for whole logs.
    """

    name: str
    time: float
    logs: tuple[int, ...]
    frames: tuple[int, int] | None = None


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
    """Changes over the sessions of a case.

    Attributes:
        sessions: names, dates or windows.
        times: of the sessions [unit].
        unit: `d` since the first session, or `s` since the log's begin.
        series: of all quantities, the clearest change first.
        effect: id of the followed effect where constant parameters name another one or none; empty otherwise.
        chi2: reduced chi-square that is left with parameters of its own in each session; NaN if none is followed.
        p: probability by evidence that the followed parameters are constant; NaN if none is followed.
        lead: share of what the next best effect leaves so that the followed one takes up; NaN without `effect`.
        note: why nothing could be said; empty otherwise.
    """

    sessions: tuple[str, ...]
    times: tuple[float, ...]
    unit: str
    series: tuple[Series, ...] = ()
    effect: str = ""
    chi2: float = float("nan")
    p: float = float("nan")
    lead: float = float("nan")
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
        names = ("sessions", "times", "unit", "series", "effect", "chi2", "p", "lead", "note")
        return {"changed": self.clearest is not None, "began": self.began} | {
            name: getattr(self, name) for name in names
        }


def dated_sessions(case: Case, names: Sequence[str]) -> tuple[Session, ...]:
    """Sessions of fitted logs (files `names`) by date, in order; none if a log has no date."""
    dates = {item.file: item.date for item in case.logs}
    found = [dates[name] for name in names]
    known = sorted({date for date in found if date is not None})
    if any(date is None for date in found) or not known:
        return ()
    days = [(date - known[0]).total_seconds() / DAY for date in known]
    logs = [tuple(k for k, one in enumerate(found) if one == date) for date in known]
    return tuple(Session(written_date(d), t, own) for d, t, own in zip(known, days, logs, strict=True))


def windows(frames: int, frame: float) -> tuple[Session, ...]:
    """Windows of one log of so many frames of `frame` [s], of equal length; none if it is too short for a change."""
    count = min(int(frames * frame / WINDOW), WINDOWS)
    if count < LEAST:
        return ()
    ends = np.linspace(0, frames, count + 1).round().astype(int)
    return tuple(
        Session(f"{a * frame:.0f} to {b * frame:.0f} s", 0.5 * (a + b) * frame, (0,), (int(a), int(b)))
        for a, b in pairwise(ends)
    )


def sessions_of(problem: Problem) -> tuple[tuple[Session, ...], str]:
    """Sessions of the fitted logs by date, or windows of a single one, and the unit of their times."""
    dated = dated_sessions(problem.case, [trial.name for trial in problem.fit])
    if dated or len(problem.fit) != 1:
        return dated, "d"
    return windows(len(problem.fit[0].reference), problem.robot.machine.frame), "s"


@dataclass(frozen=True, eq=False)
class Logs:
    """The logs of a case, session by session.

    Attributes:
        likelihood: of all of them.
        sessions: in order.
        rows: mask (samples,) of each session.
    """

    likelihood: Likelihood
    sessions: tuple[Session, ...]
    rows: tuple[np.ndarray, ...] = field(default=())

    @classmethod
    def of(cls, likelihood: Likelihood, sessions: tuple[Session, ...]) -> Logs:
        """The logs of a likelihood."""
        return cls(likelihood, sessions, tuple(likelihood.samples_of(s.logs, s.frames) for s in sessions))

    def part(self, session: Session) -> Likelihood:
        """The likelihood of a session's logs alone."""

        def of(view: View) -> View:
            fit = tuple(view.problem.fit[k] for k in session.logs)
            return replace(view, problem=replace(view.problem, fit=fit), noise=())

        return replace(self.likelihood, views=tuple(map(of, self.likelihood.views)))

    def model(self, rows: np.ndarray, prior: Sequence[np.ndarray]) -> LinearModel:
        """Linear model, a block for each session in each view, of rows (p + 1, samples), the residual last."""
        view = np.repeat(np.arange(len(self.likelihood.views)), [v.samples for v in self.likelihood.views])
        places = [(v, s, mask & (view == v)) for v in range(view[-1] + 1) for s, mask in enumerate(self.rows)]
        ends = np.cumsum([0, *(mask.sum() for *_, mask in places)])
        blocks = [(v, s, slice(*map(int, at))) for (v, s, _), at in zip(places, pairwise(ends), strict=True)]
        order = np.concatenate([np.flatnonzero(mask) for *_, mask in places])
        return LinearModel.of_rows(rows[:, order], blocks, prior, self.likelihood.memory)

    def fitted(self, e: Explanation, own: Sequence[int]) -> SessionFit:
        """The explanation, on these logs, with parameters of its own (positions) in each session."""
        count = len(self.sessions)
        split = self.sessions[0].frames is None and bool(own)
        x, rows = np.tile(e.x, (count, 1)), np.concatenate([whole_jacobian(self.likelihood, e), e.residual[None]])
        best = of_sessions(self, e, rows, x, own)
        for _ in range(ROUNDS if split else 0):
            x, rows = best.x, rows.copy()
            for s, session in enumerate(self.sessions):
                part, at = self.part(session), np.clip(x[s], *e.bounds)
                here = replace(e, jacobian=e.jacobian[:, self.rows[s]]).at(part, at)
                rows[:, self.rows[s]] = np.concatenate([whole_jacobian(part, here), here.residual[None]])
            found = of_sessions(self, e, rows, x, own)
            if np.mean(found.residual**2) > np.mean(best.residual**2):
                break
            small = np.abs((found.x - x)[:, own]) <= CONVERGED * found.std
            best = replace(found, constant=best.constant)
            if small.all():
                break
        return best


@dataclass(frozen=True, eq=False)
class SessionFit:
    """An explanation with parameters of its own in each session.

    Attributes:
        explanation: the fit with constant ones.
        own: positions of these parameters.
        x: (sessions, parameters) coordinates.
        model: linear model of shared and own parameters.
        constant: the same of constant ones.
        residual: (samples,) before the last step.
    """

    explanation: Explanation
    own: tuple[int, ...]
    x: np.ndarray
    model: LinearModel
    constant: LinearModel
    residual: np.ndarray

    @property
    def chi2(self) -> np.ndarray:
        """Reduced chi-squares (views,) that are left."""
        return left_by(self.model)

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (sessions, own)."""
        return np.sqrt(np.diagonal(self.covariance(self.model), axis1=1, axis2=2).T)

    def covariance(self, model: LinearModel) -> np.ndarray:
        """Covariance (own, sessions, sessions) of each own parameter by a model."""
        width, whole = len(self.own), model.posterior().covariance
        first = len(whole) - width * len(self.x)
        return np.array([whole[first + k :: width, first + k :: width] for k in range(width)])

    @property
    def noise(self) -> LinearModel:
        """The model as if noise alone were left: scatter beyond that is what a change point estimates."""
        return replace(self.model, variance=np.ones(len(self.model.variance)), memory=1.0)

    def evidence(self, memory: float, constant: bool = False) -> float:
        """Log evidence [nats] of parameters of each session, or of constant ones; memory: frames that count as one."""
        return replace(self.constant if constant else self.model, memory=memory).evidence()


def left_by(model: LinearModel) -> np.ndarray:
    """Reduced chi-squares (views,) after a model's step."""
    both = np.r_[model.posterior().step, 1.0]
    squares = np.einsum("i,bij,j->b", both, model.products, both)
    return np.bincount(model.view, squares) / np.bincount(model.view, model.samples)


def settled(model: LinearModel) -> LinearModel:
    """The model in units of what it leaves."""
    for _ in range(2):
        model = replace(model, variance=np.maximum(left_by(model), 1.0))
    return model


def of_sessions(logs: Logs, e: Explanation, rows: np.ndarray, x: np.ndarray, own: Sequence[int]) -> SessionFit:
    """One step from coordinates x (sessions, parameters), about which rows (parameters + 1, samples) are."""
    std = np.array([np.ptp(p.bounds) / np.sqrt(12.0) if p.effect and np.ptp(p.bounds) else s
                    for p, s in zip(e.parameters, e.prior_std, strict=True)])  # fmt: skip
    shape = np.array([bool(p.effect) and not p.amplitude for p in e.parameters], dtype=bool)
    low, high = e.bounds
    prior = [np.where(shape, 0.0, -x), np.tile(1.0 / std**2, (len(x), 1)), low - x, high - x]
    model = logs.model(rows, [one[0] for one in prior])
    wide = settled(by_session(model, own, prior))
    shared = [i for i in range(len(e.parameters)) if i not in own]
    step, found = wide.posterior().step, x.copy()
    found[:, shared] += step[: len(shared)]
    found[:, list(own)] += step[len(shared) :].reshape(len(x), len(own))
    return SessionFit(e, tuple(own), found, wide, settled(model), rows[-1])


def by_session(model: LinearModel, own: Sequence[int], prior: Sequence[np.ndarray]) -> LinearModel:
    """The model with columns of its own in each session for some parameters (positions), after the shared ones.

    prior: mean, precision, low and high (sessions, parameters).
    """
    count, width, p = len(prior[0]), len(own), model.products.shape[1] - 1
    shared = [i for i in range(p) if i not in own]
    first, size = len(shared), len(shared) + count * width
    products = np.zeros((len(model.log), size + 1, size + 1))
    for b, s in enumerate(model.log):
        at = np.r_[0:first, first + s * width : first + (s + 1) * width, size]
        products[b][np.ix_(at, at)] = model.products[b][np.ix_(*[[*shared, *own, p]] * 2)]
    mean, precision, low, high = (np.r_[one[0, shared], one[:, list(own)].ravel()] for one in prior)
    return replace(model, products=products, mean=mean, precision=precision, low=low, high=high)


def since_of(problem: Problem, found: Isolation, decided: Decision) -> tuple[Since | None, Decision]:
    """Changes over the sessions of a case, and the decision with them; None of undated cases but for one long log.

    Of logs too long for that, their first part counts.
    """
    problem = problem.shortened(affordable(problem, SAMPLES))
    sessions, unit = sessions_of(problem)
    if len(sessions) < (LEAST if unit == "s" else 2):
        return None, decided
    since = Since(tuple(s.name for s in sessions), tuple(s.time for s in sessions), unit)
    if len(sessions) < LEAST:
        return replace(since, note=FEW.format(len(sessions), LEAST)), decided
    best = decided.best.explanation
    likelihood = on_whole(problem, found, best.robot)
    logs = Logs.of(likelihood, sessions)
    fit = logs.fitted(on_logs(logs, best), own(best))
    since = stated(since, fit, logs, named=bool(best.effects) and decided.verdict in (NAMED, AMBIGUOUS))
    if decided.verdict in (NO_GAP, RETUNE) or (decided.verdict == NAMED and since.clearest is None):
        return since, decided
    return of_changing(since, logs, found, decided, fit)


def on_whole(problem: Problem, found: Isolation, robot: np.ndarray) -> Likelihood:
    """The likelihood of an isolation on other logs of its case, with the memory of what a robot leaves there."""
    views = zip(found.likelihood.views, with_prediction(problem), strict=True)
    whole = replace(found.likelihood, views=tuple(replace(v, problem=p, noise=(), scale=1.0) for v, p in views))
    whole = whole.for_stage("since")
    return whole.with_memory_of(whole.residual(robot[None])[0])


def on_logs(logs: Logs, e: Explanation) -> Explanation:
    """An explanation with residual and nominal Jacobian on all logs."""
    n, residual = e.nominal, logs.likelihood.residual(e.robot[None])[0]
    columns = nominal_jacobian(logs.likelihood, e.at_nominal, e.parameters[:n], e.x[:n], residual)
    return replace(e, residual=residual, jacobian=columns)


def own(e: Explanation) -> list[int]:
    """Positions of the parameters that are followed: amplitudes of effects, or nominal parameters that moved."""
    leads = {next(p.name for p in e.parameters if p.effect == effect) for effect in e.effects}
    if e.effects:
        return [i for i, p in enumerate(e.parameters) if p.name in leads or (p.effect and p.amplitude)]
    return [int(i) for i in np.argsort(-np.abs(e.use))[:FOLLOWED] if abs(e.use[i]) > MOVED]


def stated(since: Since, fit: SessionFit, logs: Logs, named: bool) -> Since:
    """The series of a fit with their changes; the residual's power, too, unless an effect is named."""
    e, likelihood = fit.explanation, logs.likelihood
    series, machine = [], likelihood.robot.machine
    if fit.own:
        noise = fit.covariance(fit.noise)
        for k, i in enumerate(fit.own):
            p = e.parameters[i]
            base = None if p.effect else float(e.values[p.index[0]])

            def value(x: float, p=p, base=base) -> float:
                return p.value(float(x), base)

            head = p.name, p.channels[0] if len(p.channels) == 1 else "", machine.parameters[p.index[0]].unit
            series.append((head, value, fit.x[:, i], fit.std[:, k], noise[k]))
    if not named:
        power = np.log([float(np.mean(e.residual[rows] ** 2)) for rows in logs.rows])
        variance = np.array([2.0 / rows.sum() for rows in logs.rows])
        head = RESIDUAL, "", "noise variances"
        series.append((head, lambda x: float(np.exp(x)), power, np.sqrt(likelihood.memory * variance),
                       np.diag(variance)))  # fmt: skip
    tested = [changes(since.times, *one, count=len(series)) for one in series]
    tested.sort(key=lambda s: (s.p, -s.change.size if s.change else 0.0))
    if not fit.own:
        return replace(since, series=tuple(tested))
    total = float(fit.model.samples @ fit.chi2[fit.model.view] / fit.model.samples.sum())
    memory = likelihood.with_memory_of(fit.residual).memory
    p = float(expit(fit.evidence(memory, constant=True) - fit.evidence(memory)))
    return replace(since, series=tuple(tested), chi2=total, p=p)


def changes(
    times: Sequence[float], head: tuple[str, str, str], value: Callable[[float], float], x: np.ndarray, std: np.ndarray,
    noise: np.ndarray, count: int,
) -> Series:  # fmt: skip
    """A series with its change.

    Args:
        times: of the sessions.
        head: name, channel and unit.
        value: of a coordinate [unit].
        x: (sessions,) coordinates.
        std: (sessions,) standard deviations of these.
        noise: (sessions, sessions) covariance of the coordinates by noise alone.
        count: series that are tested.
    """
    scan = ChangePoint(np.array(times), noise)
    p = min(1.0, float(scan.p_values(x[:, None])[0]) * count)
    change = in_unit(value, scan(x, np.random.default_rng(len(x)))) if p < ALPHA else None
    low, high = np.sort([[value(v) for v in x + sign * NORMAL_90 * std] for sign in (-1.0, 1.0)], axis=0).tolist()
    name, channel, unit = head
    return Series(name, channel, unit, tuple(map(value, x)), tuple(low), tuple(high), p, change)


def in_unit(value: Callable[[float], float], change: Change) -> Change:
    """A change of a coordinate in the unit of its values; the rate is that of the value at the last point."""

    def ordered(ends: Sequence[float]) -> tuple[float, float, float]:
        value, *rest = ends
        low, high = sorted(rest)
        return value, low, high

    before, after = (ordered([value(v) for v in ends]) for ends in (change.before, change.after))
    slope = (value(change.after[0] + 1e-4) - value(change.after[0] - 1e-4)) / 2e-4
    rate = ordered([slope * v for v in change.rate])
    return replace(change, before=before, after=after, rate=rate)


def of_changing(
    since: Since, logs: Logs, found: Isolation, decided: Decision, known: SessionFit
) -> tuple[Since, Decision]:
    """Changes and decision where effects may have amplitudes of their own in each session.

    Args:
        since: what the explanation behind the verdict says.
        logs: of the case.
        found: its isolation.
        decided: by constant parameters.
        known: that explanation with amplitudes of its own in each session.
    """
    screened(found, logs.sessions)
    singles = [f.explanation for key, f in found.search.sets.items() if len(key) == 1]
    fits = [known if e is decided.best.explanation else logs.fitted(on_logs(logs, e), own(e)) for e in singles]
    if not fits:
        return since, decided
    none = logs.likelihood.chi2(logs.likelihood.residual(found.retuned.explanation.robot[None])[0])
    wide = none > 1.0

    def left(fit: SessionFit) -> float:
        return float(np.mean((np.maximum(fit.chi2 - 1.0, 0.0) / (none - 1.0))[wide])) if wide.any() else 0.0

    memory = min(logs.likelihood.with_memory_of(fit.residual).memory for fit in (*fits, known))
    fits.sort(key=lambda fit: -fit.evidence(memory))
    best, name, most = fits[0], fits[0].explanation.effects[0], fits[0].evidence(memory)
    alike = {f.explanation.effects[0]: 1.0 - left(f) for f in fits[1:] if most - f.evidence(memory) < NATS}
    clear = most > known.evidence(memory, constant=True) + NATS and most >= known.evidence(memory)
    effects = [i.effect for i in decided.parts]
    if decided.verdict != UNKNOWN and (not clear or (effects == [name] and decided.verdict == NAMED)):
        return since, decided
    explained = 1.0 - left(best)
    if since.unit == "d" and clear and explained >= MOST:
        word = PARTLY if explained < EXPLAINED else AMBIGUOUS if alike else NAMED
        reason = f"{name} changed: with an amplitude for each session it explains {explained:.0%} of the gap"
        part = Part(name, CAUSE, exactly(explained), alike)
        fitted = found.search.sets[frozenset({name})]
        decided = Decision(word, fitted, (part,), exactly(1.0 - explained), (reason,))
    elif decided.verdict != UNKNOWN and since.unit == "d":
        return since, decided  # windows of one log follow an effect, and leave a name to those that vary in time
    lead = 1.0 - left(best) / max(min([left(f) for f in fits[1:]] or [1.0]), 1e-9)
    since = stated(since, best, logs, decided.verdict in (NAMED, AMBIGUOUS))
    return replace(since, effect=name, lead=lead), decided


def exactly(share: float) -> Interval:
    """A share whose interval is not known."""
    return Interval(share, float("nan"), float("nan"))


def screened(found: Isolation, sessions: Sequence[Session]) -> None:
    """Fits, with constant parameters, further effects that take up most with amplitudes of their own in each session.

    An effect that begins or grows during the sessions may explain less of their mean than a wrong effect does. None for
    windows of one log: only some frames of it are linearised.
    """
    search, none, lin = found.search, found.retuned.explanation, found.lin
    if sessions[0].frames is not None or not lin.probes:
        return
    n, width = len(none.x), len(lin.directions)
    flat = np.zeros(width)
    prior = [np.r_[-none.x, flat], np.r_[none.prior_std**-2.0, flat + 1e-6],
             np.r_[none.bounds[0] - none.x, flat - np.inf], np.r_[none.bounds[1] - none.x, flat + np.inf]]  # fmt: skip
    rows = np.concatenate([whole_jacobian(found.likelihood, none), lin.directions, none.residual[None]])
    logs = Logs.of(found.likelihood, tuple(sessions))
    model = logs.model(rows, prior)

    def scored() -> Iterator[tuple[float, Probe, np.ndarray]]:
        for probe in lin.probes:
            if frozenset({probe.effect}) not in search.sets:
                at = np.r_[0:n, probe.rows, n + width]
                own = range(n, n + len(probe.rows))
                some = replace(model, products=model.products[:, at][:, :, at])
                wide = by_session(some, own, [np.tile(one[at[:-1]], (len(sessions), 1)) for one in prior])
                posterior = wide.posterior()
                yield -posterior.cost, probe, posterior.step[n:].reshape(len(sessions), -1).mean(axis=0)

    best: dict[str, tuple[float, Probe, np.ndarray]] = {}
    for one in scored():
        if one[0] > best.get(one[1].effect, (-np.inf,))[0]:
            best[one[1].effect] = one
    likelihood = found.likelihood.for_stage("since")
    new = [
        Predicted(probe, np.clip(factors, probe.low, probe.high), 0.0, none.x)
        for _, probe, factors in sorted(best.values(), key=lambda one: -one[0])[:SCREENED]
    ]
    search.add(fit_beside(likelihood.scaled_to(none.residual), none, new))
