"""The operating point: the loop at rest under constant references, settled by simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from exodrake.analysis.frame_map import FrameMap, references_of
from exodrake.analysis.linear import excursions, used
from exodrake.core.errors import InputError

CHUNK, CHUNKS = 100, 30  # frames between two looks; looks
REST = 1e-8  # change over a frame, in units of a state's excursion, below which the loop rests
SLOW = 1e-4  # the same after 60 s, below which what still moves is too slow to matter
GENTLE = {"controller.kp": 1e-3, "controller.kd": 0.0}  # gains that bring a loop to rest whose own do not


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """Where the loop rests.

    Attributes:
        references: (tendons,) [N]. state: (states,) at a frame's start.
        tension: (tendons,) [N] at the cell. angle: (joints,) [rad].
        frames: simulated until rest. residual: largest change over one frame, in units of each state's excursion.
        steady: whether the robot's own gains brought it there, rather than gentler ones.
        slack: names of tendons without tension.
    """

    references: np.ndarray
    state: np.ndarray
    tension: np.ndarray
    angle: np.ndarray
    frames: int
    residual: float
    steady: bool
    slack: tuple[str, ...]


def moved(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> float:
    """Largest change over one frame of a state on which the log depends, in units of its excursion."""
    after, _ = loop.run(state, references[None, :])
    size = excursions(loop, state, references)
    keep = used(loop, state, references, size)
    return float(np.max(np.abs(after - state)[keep] / size[keep], initial=0.0))


def settle(loop: FrameMap, references: np.ndarray) -> tuple[np.ndarray, int, float]:
    """State after the loop came to rest, frames until then, what still moves; after 60 s as it is, at rest or not."""
    state, rows = loop.start(), np.tile(references, (CHUNK, 1))
    residual = np.inf
    for look in range(1, CHUNKS + 1):
        state, _ = loop.run(state, rows)
        residual = moved(loop, state, references)
        if residual < REST:
            return state, look * CHUNK, residual
    return state, CHUNKS * CHUNK, residual


def operating_point(loop: FrameMap, at: Mapping[str, float] | None = None) -> OperatingPoint:
    """The loop at rest under references `at` [N per tendon].

    Where the robot's own gains do not bring it to rest, gentle ones do; that state counts if its own keep it at rest.
    InputError where neither does, for such a loop has no operating point: drift, creep, tremor, a limit cycle.
    """
    references = references_of(loop.robot, at)
    state, frames, residual = settle(loop, references)
    steady = residual < SLOW
    if not steady:
        state, more, _ = settle(gentle(loop), references)
        residual, frames = moved(loop, state, references), frames + more
        if not residual < SLOW:
            raise InputError(
                f"the loop does not come to rest at {in_words(loop, references)}: it still moves {residual:.2g} a frame"
            )
    _, signals = loop.run(state, references[None, :])
    tension, angle = signals[0, loop.signals["tension"]], signals[0, loop.signals["angle"]]
    slack = tuple(n for n, t in zip(loop.robot.machine.axes.tendons, tension) if not t > 0.0)
    return OperatingPoint(references, state, tension, angle, frames, residual, steady, slack)


def gentle(loop: FrameMap) -> FrameMap:
    """The same loop with gentle gains."""
    return loop.with_values(GENTLE)


def in_words(loop: FrameMap, references: np.ndarray) -> str:
    """References in words."""
    return ", ".join(f"{name} = {r:g} N" for name, r in zip(loop.robot.machine.axes.tendons, references))
