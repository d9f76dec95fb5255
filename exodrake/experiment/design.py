"""Search for the motion that distinguishes rivals best and is safe on each of them: docs/howto/experiment.md.

A motion is a course of shares (frames, channels) of the span between the lowest and the highest reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from exodrake.core.errors import InputError
from exodrake.data.log import Log
from exodrake.data.plot import LONG, plot_log, render_png
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.engine.inputs import Reference
from exodrake.experiment.contest import Contest, Information, information, refit
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import complete_inputs, protocol, smooth

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
MARGIN = 0.05  # of a range, by which it is widened at either end, for overshoot: assumed
FASTER = 1.1  # times the fastest rate known: assumed
PIECES = 4, 2  # motifs in a sequence: short ones, then slow ones, since friction shows where reversals are slow
RANDOM, WINDOWS, MUTATIONS = 80, 24, 12  # motifs in a search of two rivals; fewer for more
WHOLE = 6  # random motions for two rivals that the sequences are held against: assumed
FINAL = 2  # motions on which refits are carried to their end: assumed
LIBRARY = 6  # one in so many of the motifs is kept, those on which the rivals as they are differ most
SMALLER, SHRINKS = 0.8, 5  # factor by which an unsafe motion shrinks towards rest, and how often


class Motif(NamedTuple):
    """A motion by parameters in 0 .. 1."""

    channels: np.ndarray  # (3, channels) level, swing and phase of each
    common: np.ndarray  # (4,) first and last frequency, how long rise and fall take, and above a half triangles

    def shares(self, frames: int, rest: np.ndarray) -> np.ndarray:
        """Shares (frames, channels) of the span; rest: (channels,) where it begins and ends."""
        level, swing, phase = self.channels
        u = HEADROOM + (1.0 - 2.0 * HEADROOM) * level
        most = min(CYCLES[1], frames / FASTEST)
        first, last = CYCLES[0] * (most / CYCLES[0]) ** self.common[:2]
        s = np.linspace(0.0, 1.0, frames)
        turns = first * s + 0.5 * (last - first) * s**2
        wave = np.sin(2.0 * np.pi * (turns[:, None] + phase))
        wave = np.arcsin(wave) / (0.5 * np.pi) if self.common[3] > 0.5 else wave
        course = u + swing * np.minimum(u, 1.0 - u) * wave
        return lead_from_rest(course, rest, 0.5 * max(float(self.common[2]) ** 2, 2.0 / frames))


def random_motif(channels: int, rng: np.random.Generator) -> Motif:
    """A motif of that many channels with parameters drawn evenly; some channels do not swing."""
    values = rng.random((3, channels))
    values[1] *= rng.random(channels) >= STEADY
    return Motif(values, rng.random(4))


def lead_from_rest(course: np.ndarray, rest: np.ndarray, rise: float) -> np.ndarray:
    """A course (frames, channels) that begins and ends at rest (channels,); rise: share of it that each takes."""
    s = np.linspace(0.0, 1.0, len(course))
    return rest + (smooth(s / rise) * smooth((1.0 - s) / rise))[:, None] * (course - rest)


class Stage:
    """Map from shares of a span to references within their limits, which `check_length` demands.

    Rest is where the first log begins; positions go no faster than in the logs, further inputs stay as they were there,
    but for rates of change, which are those of the motion.
    """

    def __init__(self, robot: Robot, trials: tuple[Trial, ...]) -> None:
        self.machine, (self.low, self.high) = robot.machine, robot.reference_limits()  # (channels,) [SI]
        width, self.begin, self.frame = len(self.low), trials[0].reference[0], robot.machine.frame
        self.fastest = np.full(width, np.inf)  # rate of the reference [SI / s]; infinite for what may step
        if self.machine.signal[self.machine.references[0].signal].unit in POSITIONS:
            rows = [t.reference[:, :width] for t in trials if len(t.reference) > 1]
            self.fastest = np.max([np.abs(np.diff(r, axis=0)).max(axis=0) for r in rows], axis=0) / self.frame
        # (channels,) where motions begin and end, in shares of the span
        self.rest = np.clip((self.begin[:width] - self.low) / np.maximum(self.high - self.low, 1e-12), 0.0, 1.0)

    def reference(self, shares: np.ndarray) -> Reference:
        """The reference of shares (frames, channels): no faster than allowed, further inputs beside it."""
        rows, most = self.low + np.clip(shares, 0.0, 1.0) * (self.high - self.low), self.fastest * self.frame
        if (np.abs(np.diff(rows, axis=0)) > most).any():
            slow = rows.copy()
            for end in (rows[0], rows[-1]):  # forwards, then from the end backwards
                slow[0] = end
                for k in range(1, len(slow)):
                    slow[k] = slow[k - 1] + np.clip(slow[k] - slow[k - 1], -most, most)
                slow = slow[::-1].copy()
            slow = uniform_filter1d(slow, max(round(CORNER / self.frame), 3), axis=0, mode="nearest")
            rows = np.where(np.isfinite(most), slow, rows)
        return Reference(complete_inputs(self.machine, rows, self.begin), "experiment")


def check_length(robot: Robot, duration: float | None) -> int:
    """Frames of an experiment of a length [s]; of a minute, or as many as a slow machine needs, if None.

    InputError for a length out of range, and for a machine whose references have no limits.
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


@dataclass(frozen=True, eq=False)
class Safety:
    """Ranges of all signals (signals,) [SI]; infinite for what is not limited."""

    machine: Machine
    low: np.ndarray
    high: np.ndarray
    rate: np.ndarray  # largest rates of positions [SI / s]

    def allows(self, records: np.ndarray) -> bool:
        """Whether runs (explanations, frames, signals) [SI] stay within the ranges."""
        records = np.nan_to_num(records, nan=np.inf)
        rates = np.abs(np.diff(records, axis=1)) / self.machine.frame
        return not ((records < self.low) | (records > self.high)).any() and not (rates > self.rate).any()

    def spans(self, records: np.ndarray) -> list[tuple[str, str, np.ndarray, np.ndarray]]:
        """Logged signals in runs (explanations, frames, signals) [SI], each on the channel nearest to an end.

        Name with channel, unit, ends of what is reached and of the range (2,) [SI] of each.
        """
        machine, found = self.machine, []
        low, high = records.min(axis=(0, 1)), records.max(axis=(0, 1))
        logged = {column.signal for column in machine.columns} - set(machine.inputs)
        for signal in (s for s in machine.signals if s.name in logged):
            at = machine.offsets[signal.name]
            room = np.minimum(self.high - high, low - self.low)[at] / np.maximum(self.high - self.low, 1e-12)[at]
            k = at.start + int(room.argmin())
            name = f"{signal.name}_{machine.axes.of(signal.axis)[k - at.start]}".rstrip("_")
            found.append((name, signal.unit, np.array([low[k], high[k]]), np.array([self.low[k], self.high[k]])))
        return found


def measure_safety(problem: Problem, robots: np.ndarray, known: Sequence[Reference]) -> Safety:
    """The ranges for a case, by robots (explanations, parameters) [SI] and the machine's own experiments."""
    machine, nominal = problem.robot.machine, problem.silent()[None]
    own = [Trial(reference.name, reference.values, np.zeros((0, 0))) for reference in known]
    runs = [run for trial in problem.fit for run in problem.records(robots, trial)]
    runs += [run for trial in own for run in problem.records(nominal, trial)]
    low, high = np.min([run.min(axis=0) for run in runs], axis=0), np.max([run.max(axis=0) for run in runs], axis=0)
    rate = np.max([np.abs(np.diff(run, axis=0)).max(axis=0, initial=0.0) for run in runs], axis=0)
    stated, first = problem.robot.reference_limits(), machine.signal[machine.references[0].signal]
    for signal in machine.signals:
        at = machine.offsets[signal.name]
        if (signal.unit, signal.axis) == (first.unit, first.axis):
            low[at], high[at] = np.minimum(low[at], stated[0]), np.maximum(high[at], stated[1])
        if signal.name in machine.inputs:
            low[at], high[at] = -np.inf, np.inf
        if signal.name in machine.inputs or signal.unit not in POSITIONS:
            rate[at] = np.inf
    wider = MARGIN * (high - low)
    return Safety(machine, low - wider, high + wider, FASTER * rate / machine.frame)


class Motion(NamedTuple):
    """A safe motion."""

    motif: Motif | None  # None of a known motion
    course: np.ndarray  # (frames, channels) in shares of the span
    size: float  # factor by which it was made smaller to be safe
    reference: Reference  # what the robot gets for the course
    difference: float  # of the most similar explanations, as they are


class Piece(NamedTuple):
    """A safe motion with its information."""

    motion: Motion
    information: Information


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment."""

    reference: Reference  # to be sent to the robot
    information: Information
    size: float  # factor by which the whole was made smaller to be safe
    safety: Safety
    random: float  # probability that the median of random motions of this length promises


class Designer:
    """Search for the most informative experiment of one contest; arguments as of `design`."""

    def __init__(self, contest: Contest, duration: float | None, seed: int) -> None:
        problem, machine = contest.problem, contest.problem.robot.machine
        self.contest, self.rng = contest, np.random.default_rng(seed)
        self.whole, self.stage = check_length(problem.robot, duration), Stage(problem.robot, problem.fit)
        self.fewer = 2.0 / len(contest.explanations)
        # the machine's own experiments, or those of the case for a machine that declares none
        own = [replace(protocol(text, problem.robot), name=name) for name, text in machine.experiments.items()]
        self.known = own or [Reference(trial.reference, trial.name) for trial in problem.fit]
        self.safety = measure_safety(problem, contest.robots, own)

    def to_course(self, reference: Reference, start: int, end: int, frames: int) -> np.ndarray:
        """A window of a known motion in shares (frames, channels) of the span, led from and to rest."""
        at = np.linspace(start, min(end, len(reference.values)) - 1.0, frames).round().astype(int)
        shares = (reference.values[at, : len(self.stage.low)] - self.stage.low) / (self.stage.high - self.stage.low)
        return lead_from_rest(shares, self.stage.rest, BLEND)

    def make_safe(self, motif: Motif | None, shares: np.ndarray, shrinks: int = SHRINKS) -> list[Motion]:
        """A motion of shares (frames, channels) made smaller until it is safe; none if it never is."""
        rest = self.stage.rest
        for size in SMALLER ** np.arange(shrinks):
            course = rest + size * (shares - rest)
            records = self.contest.records(reference := self.stage.reference(course))
            if self.safety.allows(records):
                return [Motion(motif, course, float(size), reference, self.contest.difference(records))]
        return []

    def judge(self, motions: Sequence[Motion]) -> list[Piece]:
        """Motions with their information, without those on which an explanation diverges."""
        judged = [(motion, information(self.contest, motion.reference.values)) for motion in motions]
        return [Piece(motion, found) for motion, found in judged if found]

    def search_sequence(self, pieces: int) -> np.ndarray:
        """Course (frames, channels) of the pieces of largest joint information, then mutated one at a time.

        Their library: random motifs and windows of known motions, those on which the rivals as they are differ most.
        """
        frames, rest, rng = self.whole // pieces, self.stage.rest, self.rng
        motifs = [random_motif(len(rest), rng) for _ in range(max(round(RANDOM * self.fewer), pieces))]
        windows = [
            self.to_course(motion, start, start + frames, frames)
            for motion in self.known
            if len(motion.values) >= 2
            for start in range(0, max(len(motion.values) - frames + 1, 1), frames)
        ]
        order = rng.permutation(len(windows))[: max(round(WINDOWS * self.fewer), 3)]
        tried = [*((motif, motif.shares(frames, rest)) for motif in motifs), *((None, windows[i]) for i in order)]
        safe = sorted((m for one in tried for m in self.make_safe(*one)), key=lambda m: -m.difference)
        library = self.judge(safe[: max(len(safe) // LIBRARY, pieces)])
        if not library:
            raise InputError(f"{self.contest.problem.case.name}: no motion is safe on every explanation still in play")

        def joint(chosen: Sequence[Piece]) -> tuple[float, float]:
            return reduce(add, (piece.information for piece in chosen)).criterion

        chosen: list[Piece] = []
        for _ in range(pieces):
            chosen.append(max(library, key=lambda piece: joint([*chosen, piece])))
        best = joint(chosen)
        for _ in range(round(MUTATIONS * self.fewer)):
            at = int(rng.integers(pieces))
            if known := chosen[at].motion.motif:
                moves = [STEP * rng.standard_normal(v.shape) * (rng.random(v.shape) < CHANGED) for v in known]
                motif = Motif(*(np.clip(v + move, 0.0, 1.0) for v, move in zip(known, moves, strict=True)))
            else:
                motif = random_motif(len(rest), rng)
            for piece in self.judge(self.make_safe(motif, motif.shares(frames, rest))):
                trial = [*chosen[:at], piece, *chosen[at + 1 :]]
                if (reached := joint(trial)) > best:
                    chosen, best = trial, reached
        return np.concatenate([piece.motion.course for piece in chosen])


def design(contest: Contest, duration: float | None = None, seed: int = 0) -> Design:
    """The experiment that tells rivals apart best: of sequences of short and of long pieces, and of random motions.

    duration: its length [s]; a minute, or as many frames as a slow machine needs, if None. seed: of the search.
    InputError for a length out of range, a machine whose references have no limits, and where nothing is safe.
    """
    search, robot, tried = Designer(contest, duration, seed), contest.problem.robot, list[Motion]()
    for k in search.rng.integers(2**31, size=max(round(WHOLE * search.fewer), 3)):
        motion = protocol(f"random-motion:seed={k},duration={search.whole * robot.machine.frame:g}", robot)
        tried += search.make_safe(None, search.to_course(motion, 0, len(motion.values), search.whole), 2 * SHRINKS)
    found = sorted(search.judge(tried), key=lambda piece: piece.information.criterion)
    random = found[len(found) // 2 :][:1]
    for pieces in PIECES:
        found += search.judge(search.make_safe(None, search.search_sequence(pieces), 2 * SHRINKS))
    if not found:
        raise InputError(f"{contest.problem.case.name}: no experiment is safe on every explanation in play")
    found.sort(key=lambda piece: piece.information.criterion, reverse=True)
    ended = [(piece.motion, refit(contest, piece.motion.reference.values)) for piece in found[:FINAL]]
    last = [Piece(motion, again) for motion, again in ended if again]
    best = max(last or found[:1], key=lambda piece: piece.information.criterion)
    promised = min(piece.information.probability for piece in (*random, best)) if random else 0.0
    return Design(best.motion.reference, best.information, best.motion.size, search.safety, promised)


def draw_experiment(contest: Contest, design: Design) -> bytes:
    """References of an experiment and the logs of the two closest explanations on it, with differences, as PNG.

    The rival is refitted. Differences are stated in units of noise and of the errors of the laws.
    """
    problem, machine, (true, rival) = contest.problem, contest.problem.robot.machine, design.information.closest
    reference, e = design.reference.values, contest.explanations[rival]
    refitted = apply(e.values, e.parameters, design.information.refit(true, rival))
    robots = np.array([refitted, *contest.robots[[true, rival]], *contest.bare[[true, rival]]])
    logs = problem.predict(robots, contest.trial(true, reference))
    errors = contest.error[[true, rival], None, None] * (logs[3:] - logs[1:3])
    std = np.sqrt(problem.noise_std**2 + np.sum(errors**2, axis=0))
    size, kinds = np.sqrt(np.mean(((logs[1] - logs[0]) / std) ** 2, axis=0)), np.array(problem.kinds)
    said = {k: f"RMS difference: {size[kinds == k].max():.2g} standard deviations" for k in problem.kinds}
    columns = *problem.columns, *machine.log_names(machine.references)
    units = {c: machine.signal[machine.column(c.rsplit("_", 1)[0]).signal].unit for c in columns}
    few = slice(None, None, -(-len(reference) // LONG))  # rows, of which a figure shows each
    time = machine.frame * np.arange(len(reference))[few]
    second, first = (Log(time, dict(zip(columns, np.hstack([x, reference])[few].T)), units) for x in logs[:2])
    title, words = (
        f"{problem.case.name}: the experiment",
        f"{contest.explanations[true].name}; dotted: {e.name} refitted",
    )
    return render_png(plot_log(first, title, second, ("", ""), machine, [words], said, difference=True))
