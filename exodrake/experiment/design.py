"""Search for the motion that distinguishes rivals best and is safe on each of them.

    library: random motifs, and windows of the machine's own experiments or of the case's motion
    sequence: the motifs of largest joint information (greedy; information adds), then local search by mutation of one;
        once of many short motifs, once of a few long ones
    random: motions of the whole length, since one may be better; their median shows the gain of the search
    check: the whole motion on every explanation; made smaller until it is safe
    refit: of all parameters, to convergence, on the best few motions; the best one after it is kept

All random draws are seeded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.data.log import Log
from exodrake.experiment.contest import Contest, Information, information, refitted
from exodrake.experiment.motion import Motif, Window, default_duration, frames_of, random_motif, stage_of
from exodrake.experiment.safety import Safety, safety_of
from exodrake.simulation.references import protocol

PIECES = 4, 2  # motifs in a sequence: short ones, then slow ones, since friction shows where reversals are slow
RANDOM, WINDOWS, MUTATIONS = 80, 24, 12  # motifs in a search of two rivals; fewer for more
WHOLE = 6  # random motions for two rivals that the sequences are held against: assumed
FINAL = 2  # motions on which refits are carried to their end: assumed
LIBRARY = 6  # one in so many of the motifs is kept, those on which the rivals as they are differ most
SMALLER, SHRINKS = 0.8, 5  # factor by which an unsafe motion shrinks towards rest, and how often
ENOUGH = 0.5  # probability below which an experiment is not recommended: assumed


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
        tried: motions that were simulated.
        random: probability that the median of random motions of this length promises.
    """

    reference: Reference
    information: Information
    size: float
    safety: Safety
    tried: int
    random: float = 0.0

    def log(self, machine: Machine) -> Log:
        """The reference as a log of its columns alone, for `simulate --reference` and for the robot."""
        time = machine.frame * np.arange(len(self.reference.values))
        return Log(time, dict(zip(machine.log_names(machine.references), self.reference.values.T, strict=True)))

    @property
    def enough(self) -> bool:
        """Whether the experiment is recommended."""
        return self.information.probability >= ENOUGH


class Designer:
    """Search for the most informative experiment of one contest.

    Args:
        contest: explanations still in play.
        duration: length of the experiment [s].
        seed: of all chance.

    Raises:
        InputError: for a length out of range, and for a machine whose references have no limits.
    """

    def __init__(self, contest: Contest, duration: float, seed: int) -> None:
        self.contest, self.tried, self.pieces = contest, 0, PIECES[0]
        problem = contest.problem
        self.rng = np.random.default_rng(seed)
        self.stage = stage_of(problem.robot, problem.fit)
        self.whole = frames_of(duration, self.stage.frame)
        self.known = known_motions(contest)
        self.safety = safety_of(problem, contest.robots, self.known if problem.robot.machine.experiments else [])
        self.fewer = 2.0 / len(contest.explanations)

    @property
    def frames(self) -> int:
        """Frames of a piece."""
        return self.whole // self.pieces

    def shares_of(self, reference: Reference) -> np.ndarray:
        """A known motion in shares (frames, channels) of the span."""
        return (reference.values[:, : len(self.stage.low)] - self.stage.low) / (self.stage.high - self.stage.low)

    def cut(self, reference: Reference) -> list[Window]:
        """A known motion in windows of a piece's length."""
        shares = self.shares_of(reference)
        starts = range(0, max(len(shares) - self.frames + 1, 1), self.frames)
        return [Window(shares[k : k + self.frames]) for k in starts if len(shares) >= 2]

    def safe(self, shares: np.ndarray, shrinks: int) -> tuple[np.ndarray, float, float] | None:
        """Shares (frames, channels) made smaller until safe, by which factor, and how rivals differ there; or None."""
        self.tried += 1
        rest = self.stage.rest
        for size in SMALLER ** np.arange(shrinks):
            course = rest + size * (shares - rest)
            records = self.contest.records(self.stage.reference(course))
            if not self.safety.violations(self.contest.names, records):
                return course, float(size), self.contest.difference(records)
        return None

    def piece(self, motif: Motif | Window) -> Piece | None:
        """A motif at a safe size with its information, unless a robot does not come to its end."""
        kept = self.safe(motif.shares(self.frames, self.stage.rest), SHRINKS)
        found = information(self.contest, self.stage.reference(kept[0]).values) if kept else None
        return Piece(motif, kept[0], found) if kept and found else None

    def library(self) -> list[Piece]:
        """Random motifs and windows of known motions on which the rivals differ most, at a size that is safe."""
        channels, rest = len(self.stage.low), self.stage.rest
        motifs = [random_motif(channels, self.rng) for _ in range(max(round(RANDOM * self.fewer), self.pieces))]
        windows = [window for reference in self.known for window in self.cut(reference)]
        order = self.rng.permutation(len(windows))[: max(round(WINDOWS * self.fewer), 3)]
        tried = [*motifs, *(windows[i] for i in order)]
        safe = [(motif, kept) for motif in tried if (kept := self.safe(motif.shares(self.frames, rest), SHRINKS))]
        safe.sort(key=lambda item: -item[1][2])
        found = []
        for motif, (course, _, _) in safe[: max(len(safe) // LIBRARY, self.pieces)]:
            if told := information(self.contest, self.stage.reference(course).values):
                found.append(Piece(motif, course, told))
        if not found:
            raise InputError(f"{self.contest.problem.case.name}: no motion is safe on every explanation still in play")
        return found

    def sequence(self) -> list[Piece]:
        """Pieces of largest joint information, chosen one after the other, then mutated one at a time."""
        library, chosen = self.library(), []
        for _ in range(self.pieces):
            chosen.append(max(library, key=lambda piece: total([*chosen, piece]).criterion))
        best = total(chosen).criterion
        for _ in range(round(MUTATIONS * self.fewer)):
            at = int(self.rng.integers(self.pieces))
            if piece := self.piece(chosen[at].motif.mutated(self.rng)):
                trial = [*chosen[:at], piece, *chosen[at + 1 :]]
                if (reached := total(trial).criterion) > best:
                    chosen, best = trial, reached
        return chosen

    def designed(self) -> Design:
        """The experiment: the best of sequences of short and of long pieces, and of random motions."""
        found = [design for shares in self.random() if (design := self.checked(shares))]
        random = sorted(found, key=lambda d: d.information.criterion)[len(found) // 2 :][:1]
        for self.pieces in PIECES:
            if design := self.checked(np.concatenate([piece.course for piece in self.sequence()])):
                found.append(design)
        if not found:
            raise InputError(f"{self.contest.problem.case.name}: no experiment is safe on every explanation in play")
        found.sort(key=lambda d: d.information.criterion, reverse=True)
        last = []
        for made in found[:FINAL]:
            if told := refitted(self.contest, made.reference.values):
                last.append(replace(made, information=told))
        best = max(last or found[:1], key=lambda d: d.information.criterion)
        promised = [min(d.information.probability, best.information.probability) for d in random]
        return replace(best, tried=self.tried, random=promised[0] if promised else 0.0)

    def random(self) -> list[np.ndarray]:
        """Random motions of the whole length, led from and to rest, in shares (frames, channels) of the span."""
        length, robot = self.whole * self.stage.frame, self.contest.problem.robot
        count = max(round(WHOLE * self.fewer), 3)
        texts = [f"random-motion:seed={k},duration={length:g}" for k in self.rng.integers(2**31, size=count)]
        return [Window(self.shares_of(protocol(t, robot))).shares(self.whole, self.stage.rest) for t in texts]

    def checked(self, shares: np.ndarray) -> Design | None:
        """The experiment of shares (frames, channels), made smaller until it is safe as a whole; or None."""
        if (kept := self.safe(shares, 2 * SHRINKS)) is None:
            return None
        reference = self.stage.reference(kept[0])
        found = information(self.contest, reference.values)
        return Design(reference, found, kept[1], self.safety, self.tried) if found else None


def known_motions(contest: Contest) -> list[Reference]:
    """The machine's own experiments; those of the case for a machine that declares none."""
    robot = contest.problem.robot
    if robot.machine.experiments:
        return [replace(protocol(text, robot), name=name) for name, text in robot.machine.experiments.items()]
    return [Reference(trial.reference, trial.name) for trial in contest.problem.fit]


def total(pieces: list[Piece]) -> Information:
    """Information of several pieces together."""
    found = pieces[0].information
    for piece in pieces[1:]:
        found = found + piece.information
    return found


def design(contest: Contest, duration: float | None = None, seed: int = 0) -> Design:
    """The experiment that tells rivals apart best.

    Args:
        contest: explanations still in play.
        duration: its length [s]; a minute, or as many frames as a slow machine needs, if None.
        seed: of the search.

    Raises:
        InputError: for a length out of range, a machine whose references have no limits, and where nothing is safe.
    """
    length = default_duration(contest.problem.robot.machine.frame) if duration is None else duration
    return Designer(contest, length, seed).designed()
