"""Result of a diagnosis, also as JSON by field names, but for `seconds` (`run_time`) and `floor` (`noise_std`)."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from exodrake.core.plain import plain
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr
from exodrake.diagnosis.gap import Closure, Interval, Where
from exodrake.diagnosis.rival import Rival
from exodrake.machines.write_robot import robot_text

if TYPE_CHECKING:
    from exodrake.diagnosis.discovery.missing_law import MissingLaw
    from exodrake.diagnosis.level_table import LevelTest
    from exodrake.diagnosis.problem import Problem
    from exodrake.diagnosis.provenance import Provenance
    from exodrake.diagnosis.since import Since

NO_GAP, RETUNE, NAMED, AMBIGUOUS, UNKNOWN = "NO_GAP", "RETUNE", "NAMED", "AMBIGUOUS", "UNKNOWN"
NOT_IN_JSON = ("robots", "problem", "run_time")  # the latter is `seconds` there


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the verdict names.

    Attributes:
        id: id of the effect.
        wires: tendons that it sits on.
        joints: joints that it sits on.
        parameters: parameter -> interval.
        channels: parameter -> channel -> interval, for what differs from channel to channel.
        probability: probability of the explanation that the effect belongs to.
    """

    id: str
    wires: tuple[str, ...]
    joints: tuple[str, ...]
    parameters: dict[str, Interval]
    channels: dict[str, dict[str, Interval]]
    probability: float


@dataclass(frozen=True)
class Moved:
    """A nominal parameter that retuning moved.

    Attributes:
        name: full name.
        nominal: value before retuning [unit].
        value: value after retuning [unit].
        unit: its unit.
        deviations: change in standard deviations of its tolerance.
    """

    name: str
    nominal: float
    value: float
    unit: str
    deviations: float


@dataclass(frozen=True)
class Retune:
    """Nominal parameters that retuning moved, and effects that would explain as much.

    Attributes:
        moved: parameters that moved by more than `moved.VISIBLE` standard deviations, largest change first.
        alike: effect -> share of retuning's reduction of the cost that it reaches without retuning (linearised).
    """

    moved: tuple[Moved, ...] = ()
    alike: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Candidate:
    """An explanation that was fitted.

    Attributes:
        id: ids of its effects, joined by +.
        score: share of the gap that it removes beyond retuning, 1 for all of it.
        chi2: reduced chi-square in closed loop.
        prediction_chi2: the same as prediction error; NaN without an observer.
        fit: p-value of its residual (`levels`).
        complete: p-value of what one more effect takes up (`levels`).
        left: whether the logs do not reject it.
    """

    id: str
    score: float
    chi2: float
    prediction_chi2: float
    fit: float
    complete: float
    left: bool


@short_repr
@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Localisation, isolation and closure of a gap, with their evidence.

    Attributes:
        case: name of the case.
        verdict: `NO_GAP`, `RETUNE`, `NAMED`, `AMBIGUOUS` or `UNKNOWN`.
        where: localisation of the gap.
        effects: effects that the verdict names, with parameters and intervals.
        equivalents: for AMBIGUOUS, ids of the effects of all explanations that the logs do not reject.
        closure: reduction of the gap on the judged logs.
        rivals: explanations that the logs do not tell apart, for `exodrake experiment`; none where one is left.
        candidates: all explanations that were fitted, largest sets first.
        baselines: trivial method -> explanation that it would choose among the same fits.
        reasons: reasons for the verdict, a sentence each.
        notes: remarks on logs, their used part and the calibration, a sentence each.
        run_time: duration of the diagnosis [s].
        robots: the nominal, the retuned and the improved robot.
        evidence: reduced chi-squares of these on the fitted logs.
        simulated: simulated time by stage [s].
        retune: nominal parameters that retuning moved.
        tests: of the explanation behind the verdict; of the best one tried for UNKNOWN.
        provenance: version, command, robot, calibration and files that the answer was made from.
        since: changes over dated sessions or one long log; None of other cases.
        missing_law: the free law that explains the logs best; None without discovery.
        problem: case as a regression, with detected effects; neither it nor the robots are part of the JSON.
    """

    case: str
    verdict: str
    where: Where
    effects: tuple[NamedEffect, ...]
    equivalents: tuple[str, ...]
    closure: Closure
    rivals: tuple[Rival, ...]
    candidates: tuple[Candidate, ...]
    baselines: dict[str, str]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    run_time: float
    robots: dict[str, Robot]
    evidence: dict[str, float] = field(default_factory=dict)
    simulated: dict[str, float] = field(default_factory=dict)
    retune: Retune = field(default_factory=Retune)
    tests: tuple[LevelTest, ...] = ()
    provenance: Provenance | None = None
    since: Since | None = None
    missing_law: MissingLaw | None = None
    problem: Problem | None = None

    @property
    def simulated_time(self) -> float:
        """Simulated time of the whole diagnosis [s]."""
        return sum(self.simulated.values())

    @property
    def robot(self) -> Robot:
        """The robot to go on with: the improved one; for UNKNOWN the retuned one, since no candidate is accepted."""
        return self.robots["retuned" if self.verdict == UNKNOWN else "improved"]

    @property
    def confirmed(self) -> bool | None:
        """Whether held-out logs confirm the named effects: their closure beyond retuning is positive by its interval.

        None without held-out logs or effects, and where retuning leaves nothing to close.
        """
        step = self.closure.effect
        if self.problem is None or not self.problem.holdout or not self.effects or step.value != step.value:
            return None
        return step.low > 0.0

    def robot_file(self, robot: Robot) -> str:
        """Text of a robot file for one of the robots."""
        return robot_text(robot, f"{self.verdict}, fitted to {self.case} by exodrake diagnose")

    def to_json(self) -> dict[str, Any]:
        """The answer in SI as plain data; adds `serial`, `date`, `confirmed`, `next_experiment`, `rms` and times."""
        answer = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in NOT_IN_JSON}
        closure = plain(self.closure) | {"rms": self.closure.rms}
        closure["signals"] = {name: gap.to_json() for name, gap in self.closure.signals.items()}
        case = None if self.problem is None else self.problem.case
        dates = [item.date for item in case.logs if item.date is not None] if case else []
        robot = {"serial": case.serial if case else "", "date": max(dates).isoformat() if dates else None}
        more = {"confirmed": self.confirmed, "next_experiment": self.next_experiment, "seconds": self.run_time}
        more["simulated_seconds"] = self.simulated_time
        return plain(answer | robot | {"closure": closure} | more)

    @property
    def next_experiment(self) -> dict[str, Any] | None:
        """The command that designs the experiment which tells apart what the logs do not, and between which."""
        if self.verdict != AMBIGUOUS or not self.rivals:
            return None
        command = f"exodrake experiment {self.case} --out reference.csv"
        return {"command": command, "between": [rival.name for rival in self.rivals]}
