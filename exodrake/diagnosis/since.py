"""Since when: change points over the sessions of a case, of the named effect's parameters and of the residual.

A series is a quantity session by session: the amplitudes of the effects of the explanation behind the verdict; for
RETUNE the nominal parameters that moved; where no effect is named, the residual's power, too. Each is tested for a
change (`change_point`), with Bonferroni's correction for their number. A robot that changed has no constant
explanation, so its case may be UNKNOWN: then the single effect is followed that leaves least with amplitudes of its
own in each session. If so it leaves what noise and the error of its law leave, and takes up most of what every other
one leaves so, it is NAMED after all (`named_by_change`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import LEAST
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.levels import Tests
from exodrake.diagnosis.likelihood import likelihood_of
from exodrake.diagnosis.linearise import Linearisation, nominal_jacobian
from exodrake.diagnosis.moved import moved
from exodrake.diagnosis.part_used import DATED, affordable
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.result import NAMED, UNKNOWN
from exodrake.diagnosis.session_series import Series, series_of, tested
from exodrake.diagnosis.sessions import Session, dated_sessions, estimates, windows
from exodrake.diagnosis.verdict import Decision, fitted

MOST, TRIED = 4, 5  # nominal parameters that are followed, and single effects that are tried
FEW = "{} sessions: a change needs {} or more"


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


def since_of(problem: Problem, found: Isolation, decision: Decision) -> Since | None:
    """What the sessions of a case say; None of a case without dates whose logs are several or short.

    Of logs too long for that, their first part counts.
    """
    problem = problem.shortened(affordable(problem, DATED))
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
    e, effect, lead, tests = decision.best.explanation, "", float("nan"), None
    if decision.verdict == UNKNOWN and found.tested:
        tests = whole(problem, found, found.retuned.explanation) if unit == "s" else found.tests
        e, lead = changing(found, tests, sessions)
        effect = e.name
    tests = tests if tests and unit == "s" else whole(problem, found, e)
    followed, chi2, p = series_of(tests, on_whole(tests, e), sessions, own(found, e), decision.verdict)
    return replace(since, series=tested(followed, sessions), effect=effect, chi2=chi2, p=p, lead=lead)


def changing(found: Isolation, tests: Tests, sessions: Sequence[Session]) -> tuple[Explanation, float]:
    """The single effect that leaves least with amplitudes of its own in each session, and its lead.

    On the frames of the tests. The lead is the share of what the next best one leaves above noise that it takes up.
    """

    def left(e: Explanation) -> float:
        e = e if tests is found.tests else on_whole(tests, e)
        none = np.zeros((2, len(e.residual)))
        made = estimates(tests.likelihood.scaled_to(e.residual), e, sessions, own(found, e), none)
        return max(sum(float(r @ r) for r in made.residuals) - len(e.residual), 0.0)

    tried = sorted(((left(t.explanation), k) for k, t in enumerate(found.tested[0][:TRIED])))
    (least, best), (other, _) = tried[0], (*tried[1:], (float("inf"), -1))[0]
    return found.tested[0][best].explanation, 1.0 - least / max(other, 1e-9)


def named_by_change(found: Isolation, decision: Decision, since: Since | None) -> Decision:
    """The decision, NAMED where one effect with an amplitude for each session explains what no constant one does."""
    if since is None or not since.effect or since.unit != "d":
        return decision
    best = next(t for t in found.tested[0] if t.explanation.name == since.effect)
    if best.levels.consistent or since.p <= ALPHA or since.lead <= found.tests.calibration.taken:
        return decision
    leaves = f"leaves what noise and the error of its law leave (p = {since.p:.2g})"
    reason = f"{since.effect} changed: with an amplitude for each session it {leaves}"
    return Decision(NAMED, best, (best,), (reason,), fitted(found, best))


def whole(problem: Problem, found: Isolation, e: Explanation) -> Tests:
    """Tests of one explanation on all frames of the logs."""
    likelihood = likelihood_of(problem, e.robot, found.likelihood.simulated)
    likelihood.stage = "since"
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
