"""Search for the motion that distinguishes rivals best and is safe on each of them.

    library: random motifs, and windows of the machine's own experiments or of the case's motion
    sequence: the motifs of largest joint information (greedy; information adds), then local search by mutation of one;
        once of many short motifs, once of a few long ones
    random: motions of the whole length, since one may be better; their median shows the gain of the search
    check: the whole motion on every explanation; made smaller until it is safe
    refit: of all parameters, to convergence, on the best few motions; the best one after it is kept

A motion is safe where on every explanation all signals stay within ranges that are known to be safe. That of a signal
spans

    the limits of the robot file, for signals in the unit of the reference
    the values in runs of each explanation on the logs of the case, which the robot has survived
    the values in runs of the nominal robot on the machine's own experiments, which stay within the stated limits

and is widened by a share. Positions have a range of rates, too, from the last two. All random draws are seeded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine, signal_count
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.experiment.contest import Contest, Information, information, refit
from exodrake.experiment.motion import POSITIONS, Motif, Window, check_length, prepare_stage, random_motif
from exodrake.simulation.references import protocol

MARGIN = 0.05  # of a range, by which it is widened at either end, for overshoot: assumed
FASTER = 1.1  # times the fastest rate known: assumed
PIECES = 4, 2  # motifs in a sequence: short ones, then slow ones, since friction shows where reversals are slow
RANDOM, WINDOWS, MUTATIONS = 80, 24, 12  # motifs in a search of two rivals; fewer for more
WHOLE = 6  # random motions for two rivals that the sequences are held against: assumed
FINAL = 2  # motions on which refits are carried to their end: assumed
LIBRARY = 6  # one in so many of the motifs is kept, those on which the rivals as they are differ most
SMALLER, SHRINKS = 0.8, 5  # factor by which an unsafe motion shrinks towards rest, and how often


@dataclass(frozen=True, eq=False)
class Safety:
    """Ranges of all signals.

    Attributes:
        machine: whose signals they are.
        low, high: (signals,) ends of the ranges [SI]; infinite for what is not limited.
        rate: (signals,) largest rates of positions [SI / s]; infinite for the others.
    """

    machine: Machine
    low: np.ndarray
    high: np.ndarray
    rate: np.ndarray

    def allows(self, records: np.ndarray) -> bool:
        """Whether runs (explanations, frames, signals) [SI] stay within the ranges."""
        records = np.nan_to_num(records, nan=np.inf)
        rates = np.abs(np.diff(records, axis=1)) / self.machine.frame
        return not ((records < self.low) | (records > self.high)).any() and not (rates > self.rate).any()

    def spans(self, records: np.ndarray) -> list[tuple[str, str, np.ndarray, np.ndarray]]:
        """Logged signals, each on the channel that comes nearest to an end of its range.

        Args:
            records: (explanations, frames, signals) of runs [SI].

        Returns:
            Name with channel, unit, ends of what is reached and of the range (2,) [SI] of each.
        """
        machine, found = self.machine, []
        low, high = records.min(axis=(0, 1)), records.max(axis=(0, 1))
        logged = {column.signal for column in machine.columns}
        for signal in machine.signals:
            if signal.name in logged and signal.name not in machine.inputs:
                at = machine.offsets[signal.name]
                room = np.minimum(self.high - high, low - self.low)[at] / np.maximum(self.high - self.low, 1e-12)[at]
                k = at.start + int(room.argmin())
                name = f"{signal.name}_{machine.axes.of(signal.axis)[k - at.start]}".rstrip("_")
                ends = np.array([low[k], high[k]]), np.array([self.low[k], self.high[k]])
                found.append((name, signal.unit, *ends))
        return found


def measure_safety(problem: Problem, robots: np.ndarray, known: Sequence[Reference]) -> Safety:
    """The ranges for a case.

    Args:
        problem: the case.
        robots: (explanations, parameters) flat parameter vectors [SI].
        known: the machine's own experiments.
    """
    machine, nominal = problem.robot.machine, problem.silent()[None]
    own = [Trial(reference.name, "fit", reference.values, np.zeros((0, 0))) for reference in known]
    runs = [run for trial in problem.fit for run in problem.records(robots, trial)]
    runs += [run for trial in own for run in problem.records(nominal, trial)]
    low, high, rate = np.full((3, signal_count(machine)), np.array([[-np.inf], [np.inf], [np.inf]]))
    stated, first = problem.robot.reference_limits(), machine.signal[machine.references[0].signal]
    for signal in machine.signals:
        at = machine.offsets[signal.name]
        if signal.name in machine.inputs:
            continue
        ends = np.array([end for run in runs for end in (run[:, at].min(axis=0), run[:, at].max(axis=0))])
        if (signal.unit, signal.axis) == (first.unit, first.axis):
            ends = np.concatenate([ends, stated])
        low[at], high[at] = ends.min(axis=0), ends.max(axis=0)
        wider = MARGIN * (high[at] - low[at])
        low[at], high[at] = low[at] - wider, high[at] + wider
        if signal.unit in POSITIONS:
            fastest = [np.abs(np.diff(run[:, at], axis=0)).max(axis=0, initial=0.0) for run in runs]
            rate[at] = FASTER * np.max(fastest, axis=0) / machine.frame
    return Safety(machine, low, high, rate)


@dataclass(frozen=True, eq=False)
class Piece:
    """A motif with its safe course in shares (frames, channels) and its expected information."""

    motif: Motif | Window
    course: np.ndarray
    information: Information


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment.

    Attributes:
        reference: to be sent to the robot.
        information: what it tells.
        size: factor by which the whole was made smaller to be safe [-].
        safety: ranges that it keeps.
        random: probability that the median of random motions of this length promises.
    """

    reference: Reference
    information: Information
    size: float
    safety: Safety
    random: float = 0.0


class Designer:
    """Search for the most informative experiment of one contest; arguments as of `design`."""

    def __init__(self, contest: Contest, duration: float | None, seed: int) -> None:
        problem, machine = contest.problem, contest.problem.robot.machine
        self.contest, self.rng = contest, np.random.default_rng(seed)
        self.stage, self.whole = prepare_stage(problem.robot, problem.fit), check_length(problem.robot, duration)
        self.fewer = 2.0 / len(contest.explanations)
        # the machine's own experiments, or those of the case for a machine that declares none
        own = [replace(protocol(text, problem.robot), name=name) for name, text in machine.experiments.items()]
        self.known = own or [Reference(trial.reference, trial.name) for trial in problem.fit]
        self.safety = measure_safety(problem, contest.robots, own)

    def to_shares(self, reference: Reference) -> np.ndarray:
        """A known motion in shares (frames, channels) of the span."""
        return (reference.values[:, : len(self.stage.low)] - self.stage.low) / (self.stage.high - self.stage.low)

    def make_safe(self, shares: np.ndarray, shrinks: int = SHRINKS) -> tuple[np.ndarray, float, float] | None:
        """Shares (frames, channels) made smaller until safe, by which factor, and how rivals differ there; or None."""
        rest = self.stage.rest
        for size in SMALLER ** np.arange(shrinks):
            course = rest + size * (shares - rest)
            records = self.contest.records(self.stage.reference(course))
            if self.safety.allows(records):
                return course, float(size), self.contest.difference(records)
        return None

    def make_piece(self, motif: Motif | Window, course: np.ndarray) -> Piece | None:
        """A motif with its information on a safe course, unless a robot does not come to its end."""
        found = information(self.contest, self.stage.reference(course).values)
        return Piece(motif, course, found) if found else None

    def make_library(self, pieces: int) -> list[Piece]:
        """Random motifs and windows of known motions on which the rivals differ most, at a size that is safe."""
        frames, rest, windows = self.whole // pieces, self.stage.rest, []
        motifs = [random_motif(len(rest), self.rng) for _ in range(max(round(RANDOM * self.fewer), pieces))]
        for shares in map(self.to_shares, self.known):
            starts = range(0, max(len(shares) - frames + 1, 1), frames) if len(shares) >= 2 else ()
            windows += [Window(shares[k : k + frames]) for k in starts]
        order = self.rng.permutation(len(windows))[: max(round(WINDOWS * self.fewer), 3)]
        tried = [*motifs, *(windows[i] for i in order)]
        safe = [(motif, kept) for motif in tried if (kept := self.make_safe(motif.shares(frames, rest)))]
        safe.sort(key=lambda item: -item[1][2])
        best = safe[: max(len(safe) // LIBRARY, pieces)]
        found = [piece for motif, (course, _, _) in best if (piece := self.make_piece(motif, course))]
        if not found:
            raise InputError(f"{self.contest.problem.case.name}: no motion is safe on every explanation still in play")
        return found

    def search_sequence(self, pieces: int) -> np.ndarray:
        """Course (frames, channels) of the pieces of largest joint information, then mutated one at a time."""

        def judge(chosen: list[Piece]) -> tuple[float, float]:
            return reduce(add, (piece.information for piece in chosen)).criterion

        library, chosen = self.make_library(pieces), []
        for _ in range(pieces):
            chosen.append(max(library, key=lambda piece: judge([*chosen, piece])))
        best = judge(chosen)
        for _ in range(round(MUTATIONS * self.fewer)):
            at = int(self.rng.integers(pieces))
            motif = chosen[at].motif.mutate(self.rng)
            kept = self.make_safe(motif.shares(self.whole // pieces, self.stage.rest))
            if kept and (piece := self.make_piece(motif, kept[0])):
                trial = [*chosen[:at], piece, *chosen[at + 1 :]]
                if (reached := judge(trial)) > best:
                    chosen, best = trial, reached
        return np.concatenate([piece.course for piece in chosen])

    def check(self, shares: np.ndarray) -> list[Design]:
        """The experiment of shares (frames, channels), made smaller until it is safe as a whole; or none."""
        if (kept := self.make_safe(shares, 2 * SHRINKS)) is None:
            return []
        reference = self.stage.reference(kept[0])
        found = information(self.contest, reference.values)
        return [Design(reference, found, kept[1], self.safety)] if found else []

    def design(self) -> Design:
        """The experiment: the best of sequences of short and of long pieces, and of random motions."""
        length, found = self.whole * self.stage.frame, []
        for k in self.rng.integers(2**31, size=max(round(WHOLE * self.fewer), 3)):
            motion = protocol(f"random-motion:seed={k},duration={length:g}", self.contest.problem.robot)
            found += self.check(Window(self.to_shares(motion)).shares(self.whole, self.stage.rest))
        random = sorted(found, key=lambda d: d.information.criterion)[len(found) // 2 :][:1]
        for pieces in PIECES:
            found += self.check(self.search_sequence(pieces))
        if not found:
            raise InputError(f"{self.contest.problem.case.name}: no experiment is safe on every explanation in play")
        found.sort(key=lambda d: d.information.criterion, reverse=True)
        last = [
            replace(made, information=told)
            for made in found[:FINAL]
            if (told := refit(self.contest, made.reference.values))
        ]
        best = max(last or found[:1], key=lambda d: d.information.criterion)
        promised = [min(d.information.probability, best.information.probability) for d in random]
        return replace(best, random=promised[0] if promised else 0.0)


def design(contest: Contest, duration: float | None = None, seed: int = 0) -> Design:
    """The experiment that tells rivals apart best.

    Args:
        contest: explanations still in play.
        duration: its length [s]; a minute, or as many frames as a slow machine needs, if None.
        seed: of the search.

    Raises:
        InputError: for a length out of range, a machine whose references have no limits, and where nothing is safe.
    """
    return Designer(contest, duration, seed).design()
