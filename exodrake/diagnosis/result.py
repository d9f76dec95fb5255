"""The answer of a diagnosis: frozen results, and their form as JSON (`diagnosis.md`, The answer as JSON)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

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
    """Closure over all signals with its 90 % interval, and signal by signal."""

    overall: Interval
    signals: dict[str, SignalGap]

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        overall = {k: v for k, v in self.overall.to_json().items() if k != "unit"}
        return {"overall": overall, "signals": {name: s.to_json() for name, s in self.signals.items()}}


@dataclass(frozen=True)
class Candidate:
    """A hypothesis that was fitted: reduced chi-square [noise variance] on fitted and held-out logs, and its score (1
    for the best, 0 as bad as a retune).
    """

    id: str
    score: float
    chi2: float
    holdout_chi2: float

    def to_json(self) -> dict[str, Any]:
        """As in the JSON answer."""
        return dict(vars(self))


@short_repr
@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where, which and how far, and how sure. `robots`: the nominal, the retuned and the improved robot."""

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
        }
        return plain(answer)


def plain(value: Any) -> Any:
    """Data that JSON can hold: numpy numbers as floats, what is not finite as null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
