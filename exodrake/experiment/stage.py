"""The stage of an experiment: references within the limits of a robot, no faster than its references went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.diagnosis.problem import Trial

POSITIONS = ("m", "rad")  # units of references that may not step
CORNER = 0.1  # s over which a course that may not step is averaged: assumed


@dataclass(frozen=True, eq=False)
class Stage:
    """Map from shares of a span to references within their limits.

    Attributes:
        low, high: (channels,) lowest and highest reference [SI].
        rest: (channels,) where motions begin and end, in shares of the span.
        fastest: (channels,) largest rate of the reference [SI unit / s]; infinite for what may step.
        frame: frame period [s].
        others: (others,) values of further inputs [SI].
        starts: (others,) channel whose first reference a further input states instead; -1 for none.
    """

    low: np.ndarray
    high: np.ndarray
    rest: np.ndarray
    fastest: np.ndarray
    frame: float
    others: np.ndarray
    starts: np.ndarray

    def reference(self, shares: np.ndarray, name: str = "experiment") -> Reference:
        """The reference of shares (frames, channels): no faster than allowed, further inputs beside it."""
        rows = self.low + np.clip(shares, 0.0, 1.0) * (self.high - self.low)
        rows = limited(rows, self.fastest * self.frame, max(round(CORNER / self.frame), 3))
        others = np.where(self.starts >= 0, rows[0][np.maximum(self.starts, 0)], self.others)
        return Reference(np.hstack([rows, np.tile(others, (len(rows), 1))]), name)


def limited(rows: np.ndarray, most: np.ndarray, corner: int) -> np.ndarray:
    """Courses (frames, channels) that change by no more than `most` (channels,) a frame and end where they ended.

    corner: frames over which a course is averaged, which bounds its acceleration.
    """
    if (np.abs(np.diff(rows, axis=0)) <= most).all():
        return rows
    out = rows
    out = reaching(reaching(rows, most)[::-1], most, rows[-1])[::-1]  # forwards, then from the end backwards
    return np.where(np.isfinite(most), uniform_filter1d(out, corner, axis=0, mode="nearest"), rows)


def reaching(rows: np.ndarray, most: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Courses (frames, channels) that follow others from `start` (channels,), by `most` (channels,) a frame at most."""
    out = rows.copy()
    out[0] = rows[0] if start is None else start
    for k in range(1, len(out)):
        out[k] = out[k - 1] + np.clip(rows[k] - out[k - 1], -most, most)
    return out


def check_limits(robot: Robot) -> None:
    """InputError for a machine whose references have no limits."""
    machine = robot.machine
    if not machine.reference_limits or not np.isfinite(robot.reference_limits()[1]).all():
        raise InputError(
            f"{machine.name} states no limits of {machine.references[0].kind} (`reference_limits` of machine.py, "
            "`limits` of robot.yaml), so no experiment can be designed within them"
        )


def stage_of(robot: Robot, trials: tuple[Trial, ...]) -> Stage:
    """The stage of a robot beside the logs of its case.

    Rest is where the first log begins; positions go no faster than in the logs, further inputs stay as they were there.

    Raises:
        InputError: as `check_limits`.
    """
    check_limits(robot)
    machine, (low, high) = robot.machine, robot.reference_limits()
    first, *others = machine.references
    width, unit = len(low), machine.signal[first.signal].unit
    rates = [np.abs(np.diff(t.reference[:, :width], axis=0)).max(axis=0) for t in trials if len(t.reference) > 1]
    moves = np.max(rates, axis=0) / machine.frame if unit in POSITIONS else np.full(width, np.inf)
    starts = []
    for column in others:
        count = len(machine.channels(column.signal))
        follows = column.kind == first.kind.removesuffix("_ref") + "_start"
        starts += range(count) if follows else [-1] * count
    begin = trials[0].reference[0]
    rest = np.clip((begin[:width] - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
    return Stage(low, high, rest, moves, machine.frame, begin[width:], np.array(starts, dtype=int))
