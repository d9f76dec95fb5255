"""Result of a diagnosis, also as JSON by field names, but for `seconds` (`run_time`) and `floor` (`noise_std`)."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.plain import plain
from exodrake.core.provenance import configuration, robot_digest
from exodrake.diagnosis.calibration import read_calibration
from exodrake.machines.robot_file import robot_text
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot

if TYPE_CHECKING:
    from exodrake.diagnosis.discovery.discover import MissingLaw
    from exodrake.diagnosis.problem import Problem
    from exodrake.diagnosis.since import Since

NO_GAP, RETUNE, NAMED, AMBIGUOUS = "NO_GAP", "RETUNE", "NAMED", "AMBIGUOUS"
PARTLY, UNKNOWN = "PARTLY", "UNKNOWN"
CAUSE, REFINEMENT = "cause", "refinement"
TOO_LITTLE = "but the logs tell too little to say so"  # in a reason of UNKNOWN where a set of effects may be chance
NOT_IN_JSON = ("robots", "problem", "run_time")  # the latter is `seconds` there


@dataclass(frozen=True)
class Interval:
    """A value with the ends of its 90 % interval."""

    value: float  # estimate [unit]
    low: float  # lower end of the interval [unit]
    high: float  # upper end of the interval [unit]
    unit: str = "-"  # SI unit


WHOLE = Interval(1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Where:
    """Location of a gap."""

    block: str  # block of the robot; `none` without a gap or where retuning suffices
    wires: tuple[str, ...] = ()  # tendons that the gap affects
    joints: tuple[str, ...] = ()  # joints that the gap affects
    # block -> share of the gap that its effects take up; without named effects, the best one alone
    shares: dict[str, float] = field(default_factory=dict)
    # condition -> share of the residual's variance that it explains
    regime: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SignalGap:
    """Gap of a signal on the judged logs."""

    before: float  # RMS error of the nominal robot [unit]
    retuned: float  # RMS error of the retuned robot [unit]
    after: float  # RMS error of the improved robot [unit]
    noise_std: float  # noise standard deviation [unit]
    closure: float  # closure from the nominal to the improved robot
    unit: str  # unit of the signal

    def to_json(self) -> dict[str, Any]:
        """The gap as plain data, the noise standard deviation as `floor`."""
        return plain({"floor" if name == "noise_std" else name: value for name, value in vars(self).items()})


@dataclass(frozen=True)
class Closure:
    """Closure over all signals with 90 % intervals, and signal by signal."""

    overall: Interval  # from the nominal to the improved robot
    retune: Interval  # from the nominal to the retuned robot
    effect: Interval  # from the retuned to the improved robot; NaN where retuning leaves nothing
    signals: dict[str, SignalGap]  # column -> gap
    measured_on: tuple[str, ...] = ()  # kinds of motion that it was measured on
    # kind of fitted motion -> overall closure on it by the robot that was fitted to the other kinds
    motions: dict[str, Interval] = field(default_factory=dict)

    @property
    def rms(self) -> dict[str, float]:
        """RMS error over all signals of the nominal, the retuned and the improved robot [noise_std]; 1 is noise."""
        names = ("before", "retuned", "after")
        squares = [[(getattr(gap, name) / gap.noise_std) ** 2 for gap in self.signals.values()] for name in names]
        return {name: float(np.sqrt(np.mean(s))) if s else float("nan") for name, s in zip(names, squares, strict=True)}


@dataclass(frozen=True)
class EffectRival:
    """An effect that explains as much in the place of another."""

    id: str  # id of the effect
    share: Interval  # of the gap beyond retuning that it would take up


@dataclass(frozen=True)
class NamedEffect:
    """An effect of the improved robot."""

    id: str  # id of the effect
    wires: tuple[str, ...]  # tendons that it sits on
    joints: tuple[str, ...]  # joints that it sits on
    parameters: dict[str, Interval]  # parameter -> interval; values are NaN where channels differ
    # parameter -> channel -> interval, for what differs from channel to channel
    channels: dict[str, dict[str, Interval]]
    kind: str = ""  # what it is in words, such as dry friction
    role: str = CAUSE  # `cause`, or `refinement`: it is in the improved robot and may be the error of a cause's law
    share: Interval = WHOLE  # of the gap beyond retuning that it takes up
    rivals: tuple[EffectRival, ...] = ()  # effects that would take up as much in its place


@dataclass(frozen=True)
class Rival:
    """An explanation still in play beside others, as a robot for `exodrake experiment`."""

    effects: tuple[str, ...]  # ids of its effects; none for the retuned robot
    # full name -> value [SI] of all parameters by which its robot differs from the nominal one
    parameters: dict[str, float]

    @property
    def name(self) -> str:
        """Ids joined by +; `retune` without an effect."""
        return " + ".join(self.effects) or "retune"


@dataclass(frozen=True)
class Remainder:
    """What the answer leaves unexplained."""

    value: float  # share of the gap beyond retuning; NaN without a gap
    low: float  # lower end of its 90 % interval
    high: float  # upper end of it
    noise_std: float  # the same beyond noise, RMS over all channels [noise standard deviations]
    block: str = ""  # where it is (`localise.remaining`); empty where nothing much is left
    # condition -> share of its variance that the condition explains
    regime: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Moved:
    """A nominal parameter that retuning moved."""

    name: str  # full name
    nominal: float  # value before retuning [unit]
    value: float  # value after retuning [unit]
    unit: str  # its unit
    deviations: float  # change in standard deviations of its tolerance


@dataclass(frozen=True)
class Retune:
    """Nominal parameters that retuning moved, and effects that would explain as much."""

    # parameters that moved by more than a standard deviation of their tolerance, largest change first
    moved: tuple[Moved, ...] = ()
    # for RETUNE, effect -> share of what retuning explains that it explains alone
    alike: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Candidate:
    """A set of effects that was fitted."""

    id: str  # ids of its effects, joined by +
    share: float  # of the gap beyond retuning that it takes up
    chi2: float  # reduced chi-square in closed loop
    prediction_chi2: float  # the same as prediction error; NaN without an observer
    evidence: float  # log evidence beyond that of the retuned robot [nats]


@dataclass(frozen=True)
class Provenance:
    """Provenance of an answer: code, command, robot, calibration and files."""

    date: str  # Coordinated Universal Time in the form of ISO 8601
    version: str  # of the package
    code: str  # first digits of the SHA-256 of the code that finds answers
    command: str  # as it was typed, absolute paths by their last part; empty for a call from Python
    robot: str  # file of the nominal robot
    # first digits of the SHA-256 of its parameters, the overrides of the case included, with variants, tolerances and
    # limits
    parameters: str
    calibration: str  # source of the stated error rates; `none` where none were measured
    files: dict[str, str]  # file of the case -> SHA-256; none for a case that was not read from files


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Localisation, isolation and closure of a gap, with their evidence.

    Attributes:
        case: name of the case.
        verdict: `NO_GAP`, `RETUNE`, `NAMED`, `AMBIGUOUS`, `PARTLY` or `UNKNOWN`.
        where: localisation of the gap.
        effects: causes, then refinements, the largest share first; none of UNKNOWN, whose best set is a candidate.
        equivalents: for AMBIGUOUS, the first cause that has rivals and these.
        remainder: what is left unexplained.
        closure: reduction of the gap on the judged logs.
        rivals: explanations that the logs do not tell apart, for `exodrake experiment`; none where one is left.
        candidates: all sets that were fitted, the most likely first.
        reasons: reasons for the verdict, a sentence each.
        notes: remarks on logs, their used part and the calibration, a sentence each.
        run_time: duration of the diagnosis [s].
        robots: the nominal, the retuned and the improved robot.
        evidence: reduced chi-squares of these on the fitted logs.
        simulated: simulated time by stage [s].
        retune: nominal parameters that retuning moved.
        provenance: version, command, robot, calibration and files that the answer was made from.
        since: changes over dated sessions or one long log; None of other cases.
        missing_law: the free law that explains the logs best; None without discovery.
        problem: case as a regression, with detected effects; neither it nor the robots are part of the JSON.

    Examples:
        >>> import exodrake as exo
        >>> far = exo.load_robot("emps").splice("scale.offset", {"offset": 0.01})
        >>> found = exo.diagnose(exo.simulate(far, "chirp"), exo.load_robot("emps"))
        >>> print(found)
        Diagnosis(NAMED, chirp)
        Offset (scale.offset) at joint carriage explains 100 % of the gap; nothing remains.
    """

    case: str
    verdict: str
    where: Where
    effects: tuple[NamedEffect, ...]
    equivalents: tuple[str, ...]
    remainder: Remainder
    closure: Closure
    rivals: tuple[Rival, ...]
    candidates: tuple[Candidate, ...]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    run_time: float
    robots: dict[str, Robot]
    evidence: dict[str, float] = field(default_factory=dict)
    simulated: dict[str, float] = field(default_factory=dict)
    retune: Retune = field(default_factory=Retune)
    provenance: Provenance | None = None
    since: Since | None = None
    missing_law: MissingLaw | None = None
    problem: Problem | None = None

    def __repr__(self) -> str:
        said = import_module("exodrake.report.wording").headline(self)  # a room above this one
        return f"Diagnosis({self.verdict}, {self.case})\n{said}"

    def _repr_html_(self) -> str:
        return import_module("exodrake.report.notebook").diagnosis_html(self)

    @property
    def machine(self) -> Machine:
        """The machine of its robots."""
        return self.robots["nominal"].machine

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
        case = None if self.problem is None else self.problem.case
        dates = [item.date for item in case.logs if item.date is not None] if case else []
        robot = {"serial": case.serial if case else "", "date": max(dates).isoformat() if dates else None}
        apart = None  # the command that designs the experiment which tells apart what the logs do not
        if self.verdict == AMBIGUOUS and self.rivals:
            command = f"exodrake experiment {self.case} --out reference.csv"
            apart = {"command": command, "between": [rival.name for rival in self.rivals]}
        more = {"confirmed": self.confirmed, "next_experiment": apart, "seconds": self.run_time}
        more["simulated_seconds"] = self.simulated_time
        return plain(answer | robot | {"closure": closure} | more)


def record_provenance(problem: Problem) -> Provenance:
    """The provenance of an answer that is made now."""
    robot, code = problem.robot, configuration()
    return Provenance(
        date=datetime.now(UTC).replace(microsecond=0).isoformat(), version=code["version"], code=code["code"],
        command="", robot=robot.source or robot.machine.name, parameters=robot_digest(robot),
        calibration=read_calibration(robot.machine).source or "none", files=dict(problem.case.hashes),
    )  # fmt: skip
