"""Changes over the sessions of a case: an explanation's parameters session by session, and their change points.

A session is the logs of one date, or a window of one long log. All sessions share the nominal parameters; each has the
amplitudes of the effects for itself. A robot that changed has no constant explanation: its case may be UNKNOWN, or
several effects imitate the change. So effects that vary by session are compared with the constant one by evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from exodrake.core.confidence import NORMAL_90
from exodrake.data.case import Case, written_date
from exodrake.diagnosis.change_point import LEAST, Change, ChangePoint
from exodrake.diagnosis.fit import Explanation, fit_beside, whole_jacobian
from exodrake.diagnosis.isolation import Isolation, affordable, fit_on
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.result import AMBIGUOUS, CAUSE, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN, Interval
from exodrake.diagnosis.search import NATS, Predicted
from exodrake.diagnosis.verdict import EXPLAINED, MOST, VISIBLE, Decision, Part
from exodrake.model.display import percent

RESIDUAL = "residual"  # name of the series of the residual's power
SAMPLES = 500_000  # in which changes are sought: 4 GB with the 60 parameters of an Exo-Index
WINDOW, WINDOWS = 10.0, 24  # s of a long log that count as a session at least, longer than loops remember; most of them
ROUNDS, CONVERGED = 5, 0.1  # steps of logs by date at most, and the step that ends them [standard deviations]
FOLLOWED = 4  # nominal parameters that moved visibly and are followed
SCREENED = 2  # effects that are tried beside those fitted with constant parameters


class Session(NamedTuple):
    """A session."""

    name: str  # its date, or the window of the log
    time: float  # days since the first session's date; of a window its middle [s]
    logs: tuple[int, ...]  # positions of its logs among those that are fitted
    frames: tuple[int, int] | None = None  # window (first, end) of the log; None for whole logs


@dataclass(frozen=True)
class Series:
    """A quantity session by session."""

    name: str  # parameter, or `residual`
    channel: str  # tendon or joint; empty for one of the whole robot
    unit: str  # of its values; the residual's power is in noise variances
    values: tuple[float, ...]  # one for each session [unit]
    low: tuple[float, ...]  # ends of their 90 % intervals [unit]
    high: tuple[float, ...]
    p: float  # p-value of no change, corrected for the number of series
    change: Change | None = None  # in the series' unit; None where p is above the level


@dataclass(frozen=True)
class Since:
    """Changes over the sessions of a case."""

    sessions: tuple[str, ...]  # names, dates or windows
    times: tuple[float, ...]  # of the sessions [unit]
    unit: str  # `d` since the first session, or `s` since the log's begin
    series: tuple[Series, ...] = ()  # of all quantities, the clearest change first
    effect: str = ""  # the followed effect where constant parameters name another one or none
    chi2: float = float("nan")  # what parameters of each session leave, reduced; NaN if none is followed
    p: float = float("nan")  # probability by evidence that these are constant; NaN if none is followed
    lead: float = float("nan")  # share of what the next best effect leaves that `effect` takes up; NaN without it
    note: str = ""  # why nothing could be said

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
        return {"changed": self.clearest is not None, "began": self.began} | vars(self)


def date_sessions(case: Case, names: Sequence[str]) -> tuple[Session, ...]:
    """Sessions of fitted logs (files `names`) by date, in order; none if a log has no date."""
    dates = {item.file: item.date for item in case.logs}
    found = [date for date in map(dates.__getitem__, names) if date is not None]
    if len(found) < len(names) or not found:
        return ()
    logs = {date: tuple(k for k, one in enumerate(found) if one == date) for date in sorted(set(found))}
    first = min(found)
    return tuple(Session(written_date(d), (d - first) / timedelta(days=1), own) for d, own in logs.items())


@dataclass(frozen=True, eq=False)
class SessionFit:
    """An explanation with parameters of its own in each session."""

    explanation: Explanation  # the fit with constant ones
    own: tuple[int, ...]  # positions of these parameters
    x: np.ndarray  # (sessions, parameters) coordinates
    model: LinearModel  # of shared and own parameters
    constant: LinearModel  # of constant ones
    residual: np.ndarray  # (samples,) before the last step

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (sessions, own)."""
        return np.sqrt(np.diagonal(self.covariance(self.model), axis1=1, axis2=2).T)

    def covariance(self, model: LinearModel) -> np.ndarray:
        """Covariance (own, sessions, sessions) of each own parameter by a model."""
        width, whole = len(self.own), model.posterior().covariance
        first = len(whole) - width * len(self.x)
        return np.array([whole[first + k :: width, first + k :: width] for k in range(width)])


@dataclass(frozen=True, eq=False)
class Logs:
    """The logs of a case, session by session."""

    likelihood: Likelihood
    sessions: tuple[Session, ...]

    @cached_property
    def rows(self) -> tuple[np.ndarray, ...]:
        """Mask (samples,) of each session."""
        found, views = np.zeros((len(self.sessions), self.likelihood.samples), dtype=bool), self.likelihood.views
        for mask, session in zip(found, self.sessions, strict=True):
            for v, k, some in self.likelihood.blocks:
                part = mask[some].reshape(-1, len(views[v].problem.columns))  # a view: frames, columns
                part[slice(*(session.frames or (None,)))] = k in session.logs
        return tuple(found)

    @cached_property
    def blocks(self) -> list[tuple[int, int, np.ndarray]]:
        """View, session and samples of each session in each view."""
        view = np.repeat(np.arange(len(self.likelihood.views)), [v.samples for v in self.likelihood.views])
        return [(v, s, np.flatnonzero(m & (view == v))) for v in range(view[-1] + 1) for s, m in enumerate(self.rows)]

    def fit(self, e: Explanation) -> SessionFit:
        """An explanation on these logs with parameters of its own in each session.

        These are the amplitudes of its effects, or the nominal parameters that moved. Logs by date are simulated again
        with what their session has found, and the step is repeated.
        """
        e = e.at(self.likelihood, e.x)
        e = replace(e, jacobian=nominal_jacobian(self.likelihood, e))
        leads = {next(p.name for p in e.parameters if p.effect == effect) for effect in e.effects}
        own = [i for i, p in enumerate(e.parameters) if p.name in leads or (p.effect and p.amplitude)]
        if not e.effects:
            own = [int(i) for i in np.argsort(-np.abs(e.use))[:FOLLOWED] if abs(e.use[i]) > VISIBLE]
        x = np.tile(e.x, (len(self.sessions), 1))
        rows = np.concatenate([whole_jacobian(self.likelihood, e), e.residual[None]])
        best, problem = self.step(e, rows, x, own), self.likelihood.views[0].problem
        for _ in range(ROUNDS if self.sessions[0].frames is None and own else 0):
            x, rows = best.x, rows.copy()
            for session, at, mask in zip(self.sessions, np.clip(x, *e.bounds), self.rows, strict=True):
                part = self.likelihood.on(replace(problem, fit=tuple(problem.fit[k] for k in session.logs)))
                here = replace(e, jacobian=e.jacobian[:, mask]).at(part, at)
                rows[:, mask] = np.concatenate([whole_jacobian(part, here), here.residual[None]])
            found = self.step(e, rows, x, own)
            if np.mean(found.residual**2) > np.mean(best.residual**2):
                break
            best = replace(found, constant=best.constant)
            if (np.abs((found.x - x)[:, own]) <= CONVERGED * found.std).all():
                break
        return best

    def step(self, e: Explanation, rows: np.ndarray, x: np.ndarray, own: Sequence[int]) -> SessionFit:
        """One step from coordinates x (sessions, parameters), about which rows (parameters + 1, samples) are."""
        prior = e.prior(x)
        model = LinearModel.of_rows(rows, self.blocks, [one[0] for one in prior], self.likelihood.memory)
        wide = rescale(split_by_session(model, own, prior))
        shared = [i for i in range(len(e.parameters)) if i not in own]
        step, found = wide.posterior().step, x.copy()
        found[:, shared] += step[: len(shared)]
        found[:, list(own)] += step[len(shared) :].reshape(len(x), len(own))
        return SessionFit(e, tuple(own), found, wide, rescale(model), rows[-1])


def chi2_after_step(model: LinearModel) -> np.ndarray:
    """Reduced chi-squares (views,) after a model's step."""
    both = np.r_[model.posterior().step, 1.0]
    squares = np.einsum("i,bij,j->b", both, model.products, both)
    return np.bincount(model.view, squares) / np.bincount(model.view, model.samples)


def rescale(model: LinearModel) -> LinearModel:
    """The model in units of what it leaves."""
    for _ in range(2):
        model = replace(model, variance=np.maximum(chi2_after_step(model), 1.0))
    return model


def split_by_session(model: LinearModel, own: Sequence[int], prior: Sequence[np.ndarray]) -> LinearModel:
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


def follow_sessions(found: Isolation, decided: Decision) -> tuple[Since | None, Decision]:
    """Changes over the sessions of a case, and the decision with them; None of undated cases but for one long log.

    Of logs too long for that, their first part counts.
    """
    problem = found.whole.shorten(affordable(found.whole, SAMPLES))
    sessions, unit = date_sessions(problem.case, [trial.name for trial in problem.fit]), "d"
    if not sessions and len(problem.fit) == 1:  # windows of equal length of one log
        frame, unit = problem.robot.machine.frame, "s"
        frames = len(problem.fit[0].reference)
        ends = np.linspace(0, frames, min(int(frames * frame / WINDOW), WINDOWS) + 1).round().astype(int).tolist()
        names = [(f"{a * frame:.0f} to {b * frame:.0f} s", (a, b)) for a, b in pairwise(ends)]
        sessions = tuple(Session(name, 0.5 * sum(span) * frame, (0,), span) for name, span in names)
    if len(sessions) < (LEAST if unit == "s" else 2):
        return None, decided
    since = Since(tuple(s.name for s in sessions), tuple(s.time for s in sessions), unit)
    if len(sessions) < LEAST:
        return replace(since, note=f"{len(sessions)} sessions: a change needs {LEAST} or more"), decided
    best, likelihood = decided.best.explanation, found.likelihood.on(problem).for_stage("since")
    logs = Logs(likelihood.with_memory(likelihood.residual(best.robot[None])[0]), sessions)
    fit = logs.fit(best)
    since = add_series(since, fit, logs, named=bool(best.effects) and decided.verdict in (NAMED, AMBIGUOUS))
    if decided.verdict in (NO_GAP, RETUNE) or (decided.verdict == NAMED and since.clearest is None):
        return since, decided
    return follow_effects(since, logs, found, decided, fit)


def add_series(since: Since, fit: SessionFit, logs: Logs, named: bool) -> Since:
    """The series of a fit with their changes; the residual's power, too, unless an effect is named."""
    e, machine = fit.explanation, logs.likelihood.robot.machine
    # name, channel and unit; its values at coordinates; these by session with their standard deviations; covariance
    series: list[tuple[tuple[str, str, str], Callable[[float], float], np.ndarray, np.ndarray, np.ndarray]] = []
    # as if noise alone were left: scatter beyond that is what a change point estimates
    noise = fit.covariance(replace(fit.model, variance=np.ones(len(fit.model.variance)), memory=1.0))
    for k, i in enumerate(fit.own):
        p = e.parameters[i]
        value = partial(p.value, base=None if p.effect else float(e.values[p.index[0]]))
        head = p.name, p.channels[0] if len(p.channels) == 1 else "", machine.parameters[p.index[0]].unit
        series.append((head, value, fit.x[:, i], fit.std[:, k], noise[k]))
    if not named:
        power = np.log([float(np.mean(e.residual[rows] ** 2)) for rows in logs.rows])
        variance = np.array([2.0 / rows.sum() for rows in logs.rows])
        std = np.sqrt(logs.likelihood.memory * variance)
        series.append(((RESIDUAL, "", "noise variances"), lambda x: float(np.exp(x)), power, std, np.diag(variance)))
    tested = []
    for head, value, x, std, covariance in series:
        p, change = ChangePoint(np.array(since.times), covariance).judge(x, len(series))
        if change is not None:  # in the unit of the values; the rate is that of the value at the last point
            after = change.after[0]
            slope = (value(after + 1e-4) - value(after - 1e-4)) / 2e-4
            ends = [[*map(value, change.before)], [*map(value, change.after)], [slope * v for v in change.rate]]
            before, after, rate = ((first, *sorted(rest)) for first, *rest in ends)
            change = replace(change, before=before, after=after, rate=rate)
        ends = [list(map(value, end.tolist())) for end in (x - NORMAL_90 * std, x + NORMAL_90 * std)]
        low, high = map(tuple, np.sort(ends, axis=0).tolist())
        tested.append(Series(*head, tuple(map(value, x.tolist())), low, high, p, change))
    tested.sort(key=lambda s: (s.p, -s.change.size if s.change else 0.0))
    since = replace(since, series=tuple(tested))
    if not fit.own:
        return since
    samples, memory = fit.model.samples, logs.likelihood.with_memory(fit.residual).memory
    total = float(samples @ chi2_after_step(fit.model)[fit.model.view] / samples.sum())
    return replace(since, chi2=total, p=float(expit(fit.constant.evidence(memory) - fit.model.evidence(memory))))


def follow_effects(
    since: Since, logs: Logs, found: Isolation, decided: Decision, known: SessionFit
) -> tuple[Since, Decision]:
    """Changes and decision where effects may have amplitudes of their own in each session.

    `since` and `known` are of the explanation behind the verdict that constant parameters `decided`.
    """
    search = found.search
    if logs.sessions[0].frames is None and search.lin.probes:  # of windows of one log, only some frames are linearised
        fit_screened(found, logs.sessions)
    singles = [f.explanation for key, f in search.sets.items() if len(key) == 1]
    fits = [known if e is decided.best.explanation else logs.fit(e) for e in singles]
    if not fits:
        return since, decided
    none = logs.likelihood.chi2(logs.likelihood.residual(found.retuned.explanation.robot[None])[0])
    memory, wide = min(logs.likelihood.with_memory(fit.residual).memory for fit in (*fits, known)), none > 1.0
    fits.sort(key=lambda fit: -fit.model.evidence(memory))
    excess = [np.maximum(chi2_after_step(fit.model)[wide] - 1.0, 0.0) / (none[wide] - 1.0) for fit in fits]
    left = [float(np.mean(one)) if wide.any() else 0.0 for one in excess]
    names = [fit.explanation.effects[0] for fit in fits]
    most, name, explained = fits[0].model.evidence(memory), names[0], 1.0 - left[0]
    clear = most > known.constant.evidence(memory) + NATS and most >= known.model.evidence(memory)
    if decided.verdict != UNKNOWN:
        same = decided.verdict == NAMED and [part.effect for part in decided.parts] == [name]
        # windows of one log follow an effect, and leave a name to those that vary in time
        if not clear or same or (since.unit == "d" and explained < MOST):
            return since, decided
    if since.unit == "d" and clear and explained >= MOST:
        rest = zip(names[1:], fits[1:], left[1:], strict=True)
        unsure = float("nan"), float("nan")
        alike = {i: Interval(1.0 - x, *unsure) for i, fit, x in rest if most - fit.model.evidence(memory) < NATS}
        word = PARTLY if explained < EXPLAINED else AMBIGUOUS if alike else NAMED
        reason = f"{name} changed: with an amplitude for each session it explains {percent(explained)} of the gap"
        part = Part(name, CAUSE, Interval(explained, *unsure), alike)
        best = search.sets[frozenset({name})]
        decided = Decision(word, best, (part,), Interval(left[0], *unsure), (reason,), fit_on(found, best))
    lead = 1.0 - left[0] / max(min(left[1:] or [1.0]), 1e-9)
    since = add_series(since, fits[0], logs, decided.verdict in (NAMED, AMBIGUOUS))
    return replace(since, effect=name, lead=lead), decided


def fit_screened(found: Isolation, sessions: tuple[Session, ...]) -> None:
    """Fits, with constant parameters, further effects that take up most with amplitudes of their own in each session.

    An effect that begins or grows during the sessions may explain less of their mean than a wrong effect does.
    """
    search, none, logs = found.search, found.retuned.explanation, Logs(found.likelihood, sessions)
    lin = search.lin
    n, columns, memory = len(none.x), whole_jacobian(found.likelihood, none), found.likelihood.memory
    model = LinearModel.with_directions(none, columns, lin.directions, logs.blocks, memory, 1e-6, lin.kept)
    best: dict[str, tuple[float, Predicted]] = {}
    for probe in (probe for probe in lin.probes if frozenset({probe.effect}) not in search.sets):
        at, own = np.r_[0:n, n + probe.rows], range(n, n + len(probe.rows))
        ends = [*at, len(model.mean)]
        some = replace(model, products=model.products[:, ends][:, :, ends])
        prior = (model.mean, model.precision, model.low, model.high)
        posterior = split_by_session(some, own, [np.tile(one[at], (len(sessions), 1)) for one in prior]).posterior()
        if -posterior.cost > best.get(probe.effect, (-np.inf,))[0]:
            factors = posterior.step[n:].reshape(len(sessions), -1).mean(axis=0)
            predicted = Predicted(probe, np.clip(factors, probe.low, probe.high), 0.0, none.x)
            best[probe.effect] = -posterior.cost, predicted
    new = [predicted for _, predicted in sorted(best.values(), key=lambda one: -one[0])[:SCREENED]]
    search.add(fit_beside(found.likelihood.for_stage("since").scaled_to(none.residual), none, new))
