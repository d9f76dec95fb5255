"""Motions of an experiment: motifs, and the stage on which they keep within the limits of a robot.

A motif is a short motion from rest to rest with a few parameters. In it every channel goes to a level, swings about it,
and comes back:

    u(t) = u0 + e(t) (level + swing sin(2 pi phi(t) + phase) - u0)         phi' from f_first to f_last

The envelope e rises and falls within a share of the motif: a short share gives a step and a hold, a long one a ramp.
With a swing the motif is a sine, a chirp, or a triangle of constant speed. u is a share of the span between the lowest
and the highest reference; the stage maps it to a reference that is no faster than those of the logs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.diagnosis.problem import Trial
from exodrake.simulation.protocols import smooth

SHORTEST, LONGEST, DEFAULT = 20.0, 60.0, 60.0  # s of an experiment
FEWEST, MOST = 60, 200  # frames of one, for a machine whose frames are long: assumed
HEADROOM = 0.05  # of the span, between a level and either end, which a swing may reach: assumed
CYCLES = 0.5, 12.0  # of a swing in a motif, at least and at most, so that each is seen: assumed
FASTEST = 8.0  # frames in the shortest period: two samples an edge
STEADY = 0.25  # probability that a channel of a random motif does not swing: assumed
BLEND = 0.1  # share of a window at either end that leads from and to rest: assumed
STEP = 0.15  # standard deviation of a mutation of a parameter in 0 .. 1: assumed
CHANGED = 0.3  # probability that a mutation touches a parameter: assumed
POSITIONS = ("m", "rad")  # units of references that may not step
CORNER = 0.1  # s over which a course that may not step is averaged: assumed


@dataclass(frozen=True, eq=False)
class Motif:
    """A motion by parameters in 0 .. 1.

    Attributes:
        channels: (3, channels) level, swing and phase of each.
        common: (4,) first and last frequency, how long rise and fall take, and above a half triangles for sines.
    """

    channels: np.ndarray
    common: np.ndarray

    def shares(self, frames: int, rest: np.ndarray) -> np.ndarray:
        """Shares (frames, channels) of the span; rest: (channels,) where it begins and ends."""
        level, swing, phase = self.channels
        u = HEADROOM + (1.0 - 2.0 * HEADROOM) * level
        room = swing * np.minimum(u, 1.0 - u)
        most = min(CYCLES[1], frames / FASTEST)
        first, last = CYCLES[0] * (most / CYCLES[0]) ** self.common[:2]
        s = np.linspace(0.0, 1.0, frames)
        turns = first * s + 0.5 * (last - first) * s**2
        wave = np.sin(2.0 * np.pi * (turns[:, None] + phase))
        wave = np.arcsin(wave) / (0.5 * np.pi) if self.common[3] > 0.5 else wave
        return lead_from_rest(u + room * wave, rest, 0.5 * max(float(self.common[2]) ** 2, 2.0 / frames))

    def mutate(self, rng: np.random.Generator) -> Motif:
        """The motif with some parameters changed."""
        changed = []
        for values in (self.channels, self.common):
            change = STEP * rng.standard_normal(values.shape) * (rng.random(values.shape) < CHANGED)
            changed.append(np.clip(values + change, 0.0, 1.0))
        return Motif(*changed)


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a known motion, `course` (frames, channels) in shares of the span, led from and to rest."""

    course: np.ndarray

    def shares(self, frames: int, rest: np.ndarray) -> np.ndarray:
        """Shares (frames, channels) of the span; rest: (channels,) where it begins and ends."""
        at = np.linspace(0.0, len(self.course) - 1.0, frames).round().astype(int)
        return lead_from_rest(self.course[at], rest, BLEND)

    def mutate(self, rng: np.random.Generator) -> Motif:
        """A random motif that replaces the window."""
        return random_motif(self.course.shape[1], rng)


def lead_from_rest(course: np.ndarray, rest: np.ndarray, rise: float) -> np.ndarray:
    """A course (frames, channels) that begins and ends at rest (channels,); rise: share of it that each takes."""
    s = np.linspace(0.0, 1.0, len(course))
    return rest + (smooth(s / rise) * smooth((1.0 - s) / rise))[:, None] * (course - rest)


def random_motif(channels: int, rng: np.random.Generator) -> Motif:
    """A motif of that many channels with parameters drawn evenly; some channels do not swing."""
    values = rng.random((3, channels))
    values[1] *= rng.random(channels) >= STEADY
    return Motif(values, rng.random(4))


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

    def reference(self, shares: np.ndarray) -> Reference:
        """The reference of shares (frames, channels): no faster than allowed, further inputs beside it."""
        rows = self.low + np.clip(shares, 0.0, 1.0) * (self.high - self.low)
        rows = limit_rate(rows, self.fastest * self.frame, max(round(CORNER / self.frame), 3))
        others = np.where(self.starts >= 0, rows[0][np.maximum(self.starts, 0)], self.others)
        return Reference(np.hstack([rows, np.tile(others, (len(rows), 1))]), "experiment")


def limit_rate(rows: np.ndarray, most: np.ndarray, corner: int) -> np.ndarray:
    """Courses (frames, channels) that change by no more than `most` (channels,) a frame and end where they ended.

    corner: frames over which a course is averaged, which bounds its acceleration.
    """
    if (np.abs(np.diff(rows, axis=0)) <= most).all():
        return rows
    out, end = rows.copy(), rows[-1].copy()
    for backwards in (False, True):  # forwards, then from the end backwards
        if backwards:
            out = out[::-1].copy()
            out[0] = end
        for k in range(1, len(out)):
            out[k] = out[k - 1] + np.clip(out[k] - out[k - 1], -most, most)
    return np.where(np.isfinite(most), uniform_filter1d(out[::-1], corner, axis=0, mode="nearest"), rows)


def prepare_stage(robot: Robot, trials: tuple[Trial, ...]) -> Stage:
    """The stage of a robot beside the logs of its case.

    Rest is where the first log begins; positions go no faster than in the logs, further inputs stay as they were there.

    Raises:
        InputError: For a machine whose references have no limits.
    """
    check_length(robot, None)
    machine, (low, high) = robot.machine, robot.reference_limits()
    first, *others = machine.references
    width, unit = len(low), machine.signal[first.signal].unit
    rates = [np.abs(np.diff(t.reference[:, :width], axis=0)).max(axis=0) for t in trials if len(t.reference) > 1]
    fastest = np.max(rates, axis=0) / machine.frame if unit in POSITIONS else np.full(width, np.inf)
    starts = []
    for column in others:
        count = len(machine.channels(column.signal))
        follows = column.kind == first.kind.removesuffix("_ref") + "_start"
        starts += range(count) if follows else [-1] * count
    begin = trials[0].reference[0]
    rest = np.clip((begin[:width] - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
    return Stage(low, high, rest, fastest, machine.frame, begin[width:], np.array(starts, dtype=int))


def check_length(robot: Robot, duration: float | None) -> int:
    """Frames of an experiment of a length [s]; of a minute, or as many as a slow machine needs, if None.

    Raises:
        InputError: For a length out of range, and for a machine whose references have no limits.
    """
    machine, frame = robot.machine, robot.machine.frame
    if not machine.reference_limits or not np.isfinite(robot.reference_limits()[1]).all():
        raise InputError(
            f"{machine.name} states no limits of {machine.references[0].kind} (`reference_limits` of machine.py, "
            "`limits` of robot.yaml), so no experiment can be designed within them"
        )
    length = max(DEFAULT, 2.0 * FEWEST * frame) if duration is None else duration
    low, high = max(SHORTEST, FEWEST * frame), max(LONGEST, MOST * frame)
    if not low <= length <= high:
        raise InputError(f"--duration {length:g}: wanted {low:g} to {high:g} s for this machine")
    return round(length / frame)
