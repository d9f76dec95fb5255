"""The operating point: the loop at rest under constant references, by simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from exodrake.analysis.frame_map import FrameMap, references_of
from exodrake.analysis.linear_model import FrameModel, excursions, linearise, used
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot

CHUNK, CHUNKS = 100, 30  # frames between two looks; looks
REST = 1e-8  # change over a frame, in units of a state's excursion, below which the loop rests
SLOW = 1e-4  # the same after 60 s, below which what still moves is too slow to matter


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """Operating point: the state of rest of a loop under constant references.

    Attributes:
        references: (channels,) [SI].
        state: (states,) at a frame's start.
        output: (channels,) the controlled quantity [SI].
        readings: column kind -> reading of each of its channels [SI].
        frames: simulated until rest.
        residual: largest change over one frame, in units of each state's excursion.
        steady: whether the robot's own gains brought it there, rather than gentler ones.
        slack: names of channels whose reference is above 0 and whose output is not, such as slack tendons.
    """

    references: np.ndarray
    state: np.ndarray
    output: np.ndarray
    readings: dict[str, np.ndarray]
    frames: int
    residual: float
    steady: bool
    slack: tuple[str, ...]


def moved(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> float:
    """Largest change [excursions] over a frame from a state (states,), of the states on which the log depends."""
    after, _ = loop.run(state, references[None, :])
    size = excursions(loop, state, references)
    keep = used(loop, state, references, size)
    return float(np.max(np.abs(after - state)[keep] / size[keep], initial=0.0))


def settle(loop: FrameMap, references: np.ndarray) -> tuple[np.ndarray, int, float]:
    """State (states,) [SI] after the loop came to rest, frames until then, what still moves; as it is after 60 s."""
    state, rows = loop.start(), np.tile(references, (CHUNK, 1))
    residual = np.inf
    for look in range(1, CHUNKS + 1):
        state, _ = loop.run(state, rows)
        residual = moved(loop, state, references)
        if residual < REST:
            return state, look * CHUNK, residual
    return state, CHUNKS * CHUNK, residual


def operating_point(loop: FrameMap, at: Mapping[str, float] | str | None = None) -> OperatingPoint:
    """The loop at rest under references `at` [SI per channel, or the name of a point of the machine].

    Where the robot's own gains do not bring it to rest, gentle ones do; that state counts if its own keep it at rest.
    InputError where neither does, for such a loop has no operating point: drift, creep, tremor, a limit cycle.
    """
    references = references_of(loop, at)
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
    output, machine = signals[0, loop.signals[loop.loop.output]], loop.robot.machine
    readings = {c.kind: signals[0, loop.signals[c.signal]] for c in machine.columns}
    slack = tuple(n for n, r, y in zip(loop.channels, references, output) if machine.reference_limits and r > 0.0 >= y)
    return OperatingPoint(references, state, output, readings, frames, residual, steady, slack)


def linearised(
    robot: Robot, at: Mapping[str, float] | str | None = None
) -> tuple[FrameMap, OperatingPoint, FrameModel]:
    """The frame map of a robot, where it rests, and its linear model there. InputError as `operating_point`."""
    loop = FrameMap.of(robot)
    point = operating_point(loop, at)
    return loop, point, linearise(loop, point.state, point.references)


def gentle(loop: FrameMap) -> FrameMap:
    """The frame map with gentle gains."""
    return loop.with_values(loop.loop.gentle)


def in_words(loop: FrameMap, references: np.ndarray) -> str:
    """References (channels,) [SI] in words."""
    unit = loop.robot.machine.signal[loop.loop.reference].unit
    return ", ".join(f"{name} = {r:g} {unit}" for name, r in zip(loop.channels, references))
