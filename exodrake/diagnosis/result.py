"""The answer of a diagnosis: frozen results, and their form as JSON (`diagnosis.md`, The answer as JSON)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from exodrake.core.plain import plain
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

if TYPE_CHECKING:
    from exodrake.diagnosis.problem import Problem

NO_GAP, RETUNE, NAMED, AMBIGUOUS, UNKNOWN = "NO_GAP", "RETUNE", "NAMED", "AMBIGUOUS", "UNKNOWN"


@dataclass(frozen=True)
class Interval:
    """A value with the ends of its 90 % interval, SI."""

    value: float
    low: float
    high: float
    unit: str = "-"

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}


@dataclass(frozen=True)
class NamedEffect:
    """An effect with the channels that it sits on, its parameters and the probability that it is there.

    `channels`: parameter -> channel -> interval, for what differs from channel to channel.
    """

    id: str
    wires: tuple[str, ...]
    joints: tuple[str, ...]
    parameters: dict[str, Interval]
    channels: dict[str, dict[str, Interval]]
    probability: float

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return {
            "id": self.id,
            "wires": list(self.wires),
            "joints": list(self.joints),
            "parameters": {name: value.to_json() for name, value in self.parameters.items()},
            "channels": {n: {channel: i.to_json() for channel, i in at.items()} for n, at in self.channels.items()},
            "probability": self.probability,
        }


@dataclass(frozen=True)
class Detection:
    """An effect that a detector found.

    Attributes:
        effect: effect as the answer states it.
        values: parameter name -> value [SI] that all further robots have; none for an effect that remains a candidate
            of the fits.
        reason: how it was found, in one sentence.
    """

    effect: NamedEffect
    values: dict[str, float]
    reason: str

    @property
    def certain(self) -> bool:
        """Whether the effect is there, whatever a fit finds."""
        return bool(self.values)


@dataclass(frozen=True)
class Where:
    """Block, wires and joints of the gap.

    shares: block -> share of the gap. segments: exact Shapley shares of replayed segments. regime: condition -> share
    of the residual's variance that it explains.
    """

    block: str
    wires: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)
    segments: dict[str, float] = field(default_factory=dict)
    replay: dict[str, float] = field(default_factory=dict)
    regime: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return {
            "block": self.block,
            "wires": list(self.wires),
            "joints": list(self.joints),
            "shares": self.shares,
            "segments": self.segments,
            "replay": self.replay,
            "regime": self.regime,
        }


@dataclass(frozen=True)
class SignalGap:
    """Gap of a signal on held-out logs before and after, its noise [unit of the signal], and the closure."""

    before: float
    retuned: float
    after: float
    floor: float
    closure: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return dict(vars(self))


@dataclass(frozen=True)
class Closure:
    """Closure over all signals with 90 % intervals, and signal by signal.

    Attributes:
        overall: from the nominal to the improved robot.
        retune: from the nominal to the retuned robot.
        effect: from the retuned to the improved robot; NaN where retuning leaves nothing.
        signals: column -> gap.
    """

    overall: Interval
    retune: Interval
    effect: Interval
    signals: dict[str, SignalGap]

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        steps = {name: getattr(self, name).to_json() for name in ("overall", "retune", "effect")}
        steps = {name: {k: v for k, v in step.items() if k != "unit"} for name, step in steps.items()}
        return {**steps, "signals": {name: s.to_json() for name, s in self.signals.items()}}


@dataclass(frozen=True)
class Moved:
    """A nominal parameter that retuning moved.

    Attributes:
        name: full name.
        nominal, value: before and after [unit].
        unit: its unit.
        deviations: change in standard deviations of its tolerance.
    """

    name: str
    nominal: float
    value: float
    unit: str
    deviations: float

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return dict(vars(self))


@dataclass(frozen=True)
class Retune:
    """What retuning did.

    Attributes:
        moved: parameters that moved by more than `moved.VISIBLE` standard deviations, largest change first.
        alike: effect -> share of what retuning explains that it explains alone, with nominal parameters, by the
            linearisation.
    """

    moved: tuple[Moved, ...] = ()
    alike: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return {"moved": [m.to_json() for m in self.moved], "alike": self.alike}


@dataclass(frozen=True)
class Candidate:
    """An explanation that was fitted.

    Attributes:
        id: ids of its effects, joined by +.
        score: share of the gap that it removes beyond retuning, 1 for all of it.
        chi2: reduced chi-square in closed loop.
        prediction_chi2: the same as prediction error; NaN without an observer.
        fit, complete: p-values (`levels`).
        left: whether the logs do not reject it.
    """

    id: str
    score: float
    chi2: float
    prediction_chi2: float
    fit: float
    complete: float
    left: bool

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return dict(vars(self))


@short_repr
@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where, which and how far, and how sure.

    Attributes:
        robots: the nominal, the retuned and the improved robot.
        evidence: reduced chi-squares of these on the fitted logs.
        simulated: simulated seconds by stage [s].
        retune: what retuning moved.
        problem: case as a regression, with what detectors found; not part of the JSON.
    """

    case: str
    verdict: str
    where: Where
    effects: tuple[NamedEffect, ...]
    equivalents: tuple[str, ...]
    closure: Closure
    next_experiment: dict[str, Any] | None
    candidates: tuple[Candidate, ...]
    baselines: dict[str, str]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float
    robots: dict[str, Robot]
    evidence: dict[str, float] = field(default_factory=dict)
    simulated: dict[str, float] = field(default_factory=dict)
    retune: Retune = field(default_factory=Retune)
    problem: Problem | None = None

    @property
    def simulated_seconds(self) -> float:
        """Simulated seconds of the whole diagnosis [s]."""
        return sum(self.simulated.values())

    def to_json(self) -> dict[str, Any]:
        """The answer as plain data, in SI."""
        answer = {
            "case": self.case,
            "verdict": self.verdict,
            "where": self.where.to_json(),
            "effects": [e.to_json() for e in self.effects],
            "equivalents": list(self.equivalents),
            "closure": self.closure.to_json(),
            "next_experiment": self.next_experiment,
            "candidates": [c.to_json() for c in self.candidates],
            "baselines": self.baselines,
            "evidence": self.evidence,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "seconds": self.seconds,
            "retune": self.retune.to_json(),
            "simulated": self.simulated,
            "simulated_seconds": self.simulated_seconds,
        }
        return plain(answer)
