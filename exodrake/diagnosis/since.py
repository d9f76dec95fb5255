"""Changes over the sessions of a case: change points of the named effect's parameters and of the residual.

A series is a quantity session by session: the amplitudes of the effects of the explanation behind the verdict; for
RETUNE the nominal parameters that moved; where no effect is named, the residual's power, too. Each is tested for a
change (`change_point`), with Bonferroni's correction for their number.

A robot that changed has no constant explanation: its case may be UNKNOWN, or its change passes for the law's error of a
wrong effect. So single effects are compared with amplitudes of their own in each session (`changing`). An effect is
NAMED if its residual is consistent with noise and errors of its law, and it takes up most of what each other leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import LEAST
from exodrake.diagnosis.comparison import power, richer_law
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.levels import Tests
from exodrake.diagnosis.likelihood import likelihood_of
from exodrake.diagnosis.linearise import Linearisation, nominal_jacobian
from exodrake.diagnosis.moved import moved
from exodrake.diagnosis.part_used import DATED, affordable
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN
from exodrake.diagnosis.session_screen import screened
from exodrake.diagnosis.session_series import RESIDUAL, Series, SessionFit, series_of, tested
from exodrake.diagnosis.sessions import ROUNDS, Session, dated_sessions, estimates, windows
from exodrake.diagnosis.verdict import Decision

MOST, TRIED = 4, 5  # nominal parameters that are followed, and single effects that are tried
BEHIND = 10.0  # excess over the least after a first step beyond which an effect is not fitted on: assumed
FEW = "{} sessions: a change needs {} or more"


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
        p: p-value of what is left so; NaN if none is followed.
        lead: share of what the next best effect leaves so that the followed one takes up; NaN if none is followed.
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


def since_of(problem: Problem, found: Isolation, decision: Decision) -> tuple[Since | None, Decision]:
    """Changes over the sessions of a case, and the decision with them; None of undated cases but for one long log.

    Of logs too long for that, their first part counts.
    """
    problem = problem.shortened(affordable(problem, DATED))
    sessions, unit = sessions_of(problem)
    if len(sessions) < (LEAST if unit == "s" else 2):
        return None, decision
    since = Since(tuple(s.name for s in sessions), tuple(s.time for s in sessions), unit)
    if len(sessions) < LEAST:
        return replace(since, note=FEW.format(len(sessions), LEAST)), decision
    if decision.verdict == UNKNOWN and found.tested:
        return of_changing(since, problem, found, decision, sessions)
    fit = follow(problem, found, decision.best.explanation, sessions, decision.verdict)
    since = replace(since, series=tested(fit.followed, sessions), chi2=fit.chi2, p=fit.p)
    if unit == "s" or since.clearest is None or len(decision.best.explanation.effects) != 1:
        return since, decision
    return of_changing(since, problem, found, decision, sessions)


def sessions_of(problem: Problem) -> tuple[tuple[Session, ...], str]:
    """Sessions of the fitted logs by date, or windows of a single one, and the unit of their times."""
    dated = dated_sessions(problem.case, [trial.name for trial in problem.fit])
    if dated or len(problem.fit) != 1:
        return dated, "d"
    return windows(len(problem.fit[0].reference), problem.robot.machine.frame), "s"


def of_changing(
    since: Since, problem: Problem, found: Isolation, decision: Decision, sessions: Sequence[Session]
) -> tuple[Since, Decision]:
    """Changes and decision where effects may have amplitudes of their own in each session.

    Args:
        since: what the explanation behind the verdict says; of an unknown cause, its sessions alone.
        problem: the case.
        found: its isolation, with single effects that were tested.
        decision: by constant parameters.
        sessions: of the case.
    """
    tests = whole(problem, found, found.retuned.explanation) if since.unit == "s" else found.tests
    alike, lead = changing(found, tests, sessions)
    names = [t.explanation.name for t in alike]
    left = [t for t in decision.left if t.explanation.name in names]
    if left:
        return since, changed(found, decision, left, since.p)
    fit = follow(problem, found, alike[0].explanation, sessions, UNKNOWN)
    followed, unknown = fit.followed, decision.verdict == UNKNOWN
    if named := since.unit == "d" and fit.p > ALPHA and not (unknown and alike[0].levels.consistent):
        decision = changed(found, decision, alike, fit.p)
        followed = tuple(one for one in followed if one.name != RESIDUAL)
    if not named and not unknown:
        return since, decision
    series = tested(followed, sessions)
    return replace(since, series=series, effect=names[0], chi2=fit.chi2, p=fit.p, lead=lead), decision


def changing(found: Isolation, tests: Tests, sessions: Sequence[Session]) -> tuple[list[Tested], float]:
    """The single effects that leave least with amplitudes of their own in each session, and the lead of the first.

    On the frames of the tests. Another effect is among them if it leaves no more than noise may, or the first one takes
    up no larger share of it than an absent effect takes up, unless it is a richer law of one of them.
    """

    def left(k: int, rounds: int) -> float:
        e = singles[k].explanation if tests is found.tests else on_whole(tests, singles[k].explanation)
        none = np.zeros((2, len(e.residual)))
        made = estimates(tests.likelihood.scaled_to(e.residual), e, sessions, own(found, e), none, rounds)
        return max(sum(float(r @ r) for r in made.residuals) - len(e.residual), 0.0)

    singles = found.tested[0][:TRIED]
    singles += tuple(screened(found, sessions, [t.explanation.name for t in singles]))
    noise = float(np.quantile(power(tests.noise.retuned), 1.0 - ALPHA)) - tests.likelihood.samples
    first = [left(k, 1) for k in range(len(singles))]
    near = BEHIND * max(noise, min(first))
    tried = sorted((left(k, ROUNDS) if one <= near else one, k) for k, one in enumerate(first))
    most = max(noise, tried[0][0] / (1.0 - tests.calibration.taken))
    alike = [singles[k] for excess, k in tried if excess <= most]
    others = [(*tried[1:], (float("inf"), -1))[0][0], 1e-9]
    return [t for t in alike if not any(richer(found, t, o) for o in alike)], 1.0 - tried[0][0] / max(others)


def richer(found: Isolation, t: Tested, other: Tested) -> bool:
    """Whether an explanation is a richer law of another one."""
    return richer_law(found.likelihood, t.explanation, other.explanation)


def changed(found: Isolation, decision: Decision, left: Sequence[Tested], p: float) -> Decision:
    """The decision for effects that are left with an amplitude for each session."""
    if list(left) == list(decision.left):
        return decision
    names = ", ".join(t.explanation.name for t in left)
    reason = f"the sessions reject none of these: {names}"
    if len(left) == 1:
        size = f"by no more than noise and the error of its law (p = {p:.2g})"
        reason = f"{names} changed: with an amplitude for each session the logs differ from the robot {size}"
    return Decision(
        NAMED if len(left) == 1 else AMBIGUOUS,
        left[0],
        tuple(left),
        (*decision.reasons[:-1], reason),
        found.fitted(left[0]),
    )


def follow(problem: Problem, found: Isolation, e: Explanation, sessions: Sequence[Session], verdict: str) -> SessionFit:
    """Series of an explanation on all frames of the logs, and what they leave."""
    tests = whole(problem, found, e)
    return series_of(tests, on_whole(tests, e), sessions, own(found, e), verdict)


def whole(problem: Problem, found: Isolation, e: Explanation) -> Tests:
    """Tests of one explanation on all frames of the logs."""
    likelihood = likelihood_of(problem, e.robot, found.likelihood.simulated).for_stage("since")
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
