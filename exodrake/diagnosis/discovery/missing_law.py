"""Result of a discovery: point and curve of the missing law, its closure and its evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from exodrake.core.plain import plain
from exodrake.core.robot import Robot
from exodrake.diagnosis.result import Interval


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted law in one channel.

    Attributes:
        u: (points,) abscissas [unit of u].
        value, low, high: (points,) of the law with its 90 % band.
        edges, counts: (bins + 1,), (bins,) of the histogram of u in the fitted logs, in shares.
        formula: a plain formula; empty if none is as likely as the curve.
    """

    u: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    edges: np.ndarray
    counts: np.ndarray
    formula: str = ""


@dataclass(frozen=True)
class Runner:
    """Another law that was fitted: its id, words, and share of the excess that it removes."""

    id: str
    words: str
    share: float


@dataclass(frozen=True, eq=False)
class MissingLaw:
    """The missing law: a free law, fitted through the simulation, with its evidence.

    Attributes:
        found: whether the logs show one.
        reason: why, in one sentence.
        id: id of the effect that it is; its first part is the block.
        words: what it is over what.
        unit: of the variable.
        channels: that have it; () for the whole robot.
        share: of the excess over noise that retuning leaves on the fitted logs, removed by it; what nominal parameters
            use of their tolerances counts as left.
        p_noise: p-value of that were there noise alone.
        runner_up: the best law in another block.
        lead: share of what the runner-up leaves above noise that the law takes up.
        distinguished: whether it is more than a law in a wrong part takes up of a right one's (`compare.LEAD`).
        others: laws that were fitted to the end, the named one first.
        curves: channel -> curve.
        closure: of the held-out logs, from the retuned robot to that with the law.
        held_out: whether these logs were held out.
        robot: with the law, on its own machine.
        text: source of the effect's module.
    """

    found: bool
    reason: str
    id: str = ""
    words: str = ""
    unit: str = ""
    channels: tuple[str, ...] = ()
    share: float = float("nan")
    p_noise: float = float("nan")
    runner_up: Runner | None = None
    lead: float = float("nan")
    distinguished: bool = False
    others: tuple[Runner, ...] = ()
    curves: dict[str, Curve] = field(default_factory=dict)
    closure: Interval | None = None
    held_out: bool = False
    robot: Robot | None = None
    text: str = ""

    @property
    def block(self) -> str:
        """Block of the robot that it acts in."""
        return self.id.split(".")[0]

    def to_json(self) -> dict[str, Any]:
        """The answer as plain data, in SI."""
        names = [name for name in self.__dataclass_fields__ if name not in ("robot", "text")]
        return plain({name: getattr(self, name) for name in names})
