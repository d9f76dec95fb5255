"""Packet loss: decoding of the commands that did not reach the drives, from a log.

A command arrives at the drives, or the last one that arrived is held on. Only the drives are simulated, on the measured
commands and loads, along several paths side by side. The path of least cost is the likeliest (Viterbi 1967):

    cost = sum of (moved - measured)^2 / (2 s^2)   +   ENTER where a run of losses begins, STAY where it goes on

moved, measured: change of position in a frame. s: standard deviation of two readings and of the drive's model error,
which is taken from the whole log. A drive that follows badly therefore loses no commands. A burst of losses is detected
even if it begins with small changes. A run of losses is accepted if it removes most of the errors around it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.schedule import outer_reads
from exodrake.core.confidence import CONFIDENCE
from exodrake.core.effect import Effect
from exodrake.core.machine import CommandLink, Machine
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.gap import Interval
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.problem import Detection
from exodrake.diagnosis.result import NamedEffect
from exodrake.diagnosis.search import kind_of

if TYPE_CHECKING:
    from exodrake.diagnosis.problem import Problem, Trial

ENTER, STAY = 12.0, 1.0  # -log of the probabilities that a run of losses begins at a change (6e-6), and goes on (0.4)
PATHS, FAR = 6, 40.0  # most paths at a time; a path that costs so much more than the best is given up
LAGS = 3  # frames in which a drive follows a command
QUARTILE = 0.32  # of the absolute value of a normal number, in standard deviations
SHOWN = 10.0  # the same, from which the loss of a single command shows
INPUT = "packet_arrival"  # signal that tells a simulated bus which commands arrive
STILL = 0.25  # standard deviations of a reading in a frame: smaller changes of the command count as none
CLEAR = 0.1  # of the errors around them that losses may leave: development cases 0.02-0.05, drives at a limit 0.2-0.7
SURE = 2.0 * ENTER**0.5  # spreads of a change whose loss is decoded for sure: it then costs twice ENTER
AGES = 12  # frames after which a command that was seen tells nothing more of the next one: 0.24 s; assumed
GRID = 120  # points of each probability of the Markov chain


@dataclass(frozen=True, eq=False)
class PacketLoss:
    """Lost commands of one log.

    Attributes:
        packet_arrival: (n, channels), 0 where a command was lost, else 1.
        events: (2, AGES) commands whose loss could be seen, so many frames after one seen to arrive, and one seen lost.
        lost: (2, AGES) those that were lost.
        errors: (2,) squared errors around the losses, above those of noise and model, if they had arrived and lost.
    """

    packet_arrival: np.ndarray
    events: np.ndarray
    lost: np.ndarray
    errors: np.ndarray


def detect(problem: Problem, effect: Effect, values: np.ndarray) -> Problem:
    """The problem whose trials carry the packet losses that their logs show.

    They are decoded with the nominal drives, as retuned ones imitate losses. A drive at its limit seems to lose
    commands, but leaves errors; the effect remains a candidate, with the share that was counted as its parameter, where
    the losses leave few, and is none elsewhere.
    """
    machine, kinds, found = problem.robot.machine, problem.kinds, []
    nominal, noise = problem.silent(), reading_noise(problem)

    def decoded(trial: Trial) -> Trial:
        measured = {kind: trial.measured[:, [k == kind for k in kinds]] for kind in kinds}
        losses = decode(machine, nominal, measured, noise)
        if losses is None:
            return trial
        found.append(losses)
        return replace(trial, latent={**trial.latent, INPUT: losses.packet_arrival})

    original, problem = problem, replace(problem, fit=tuple(map(decoded, problem.fit)))
    lost = int(sum(np.sum(d.packet_arrival == 0.0) for d in found))
    arrived, left = sum((d.errors for d in found), start=np.zeros(2))
    if not lost or left > CLEAR * arrived:
        return replace(original, tried=original.tried - {effect.id})
    counted = loss_probability(found)
    problem = replace(problem, holdout=tuple(map(decoded, problem.holdout)))
    lead = effect.parameters[0]
    named = NamedEffect(effect.id, (), (), {lead.name: Interval(*counted, lead.unit)}, {}, kind_of(effect))
    detection = Detection(named, {}, f"{lost} commands look lost, one by one")
    return replace(problem, detected=(*problem.detected, detection))


def reading_noise(problem: Problem) -> float:
    """Standard deviation of a reading of the drives' position [its unit]; 0 for a machine without a command link."""
    link = problem.robot.machine.command_link
    if link is None or link.output not in problem.kinds:
        return 0.0
    seen = [std for kind, std in zip(problem.kinds, problem.noise_std, strict=True) if kind == link.output]
    return sensor_noise_std(problem.robot).get(link.output, float(np.median(seen)))


def decode(machine: Machine, values: np.ndarray, measured: Mapping[str, np.ndarray], noise: float) -> PacketLoss | None:
    """Lost commands of one log; None of a machine without a command link, or where a column is missing.

    Args:
        machine: machine with its `command_link`.
        values: (parameters,) flat parameters [SI].
        measured: column kind -> (n, channels) as logged [SI].
        noise: standard deviation of a reading of the position [its unit].
    """
    link = machine.command_link
    if link is None:
        return None
    loads = load_kinds(machine, link)
    needed = (link.command, link.output, *loads.values())
    if any(kind not in measured or measured[kind].shape[1] < machine.column_width(kind) for kind in needed):
        return None
    whole = {kind: filled_columns(rows) for kind, rows in measured.items()}
    log = Record(whole[link.command], whole[link.output], {name: whole[kind] for name, kind in loads.items()})
    return decoded(Drive(machine, values, link), log, noise, machine.frame)


def decoded(drive: Drive, log: Record, noise: float, frame: float) -> PacketLoss:
    """Lost commands of one log; noise: of a reading [unit of the position], frame [s]."""
    moved, whole = np.diff(log.position, axis=0), np.zeros(log.command.shape, dtype=bool)
    errors = path_errors(drive, log, moved, whole)
    spread = error_std(log, errors, noise, frame)
    lost = best_path(drive, log, moved, spread, STILL * noise / frame)
    around = sum((np.roll(lost, k, axis=0) for k in range(LAGS)), start=whole)[: len(moved)]
    sure = np.maximum(SHOWN * noise, SURE * np.vstack([spread, spread[-1:]])) / frame
    events, gone = seen(log.command, lost, sure)
    explained = path_errors(drive, log, moved, lost) if lost.any() else errors
    squared = [float(np.sum((e / spread)[around] ** 2 - 1.0)) for e in (errors, explained)]
    return PacketLoss(1.0 - lost, events, gone, np.array(squared))


def seen(command: np.ndarray, lost: np.ndarray, sure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Commands whose loss could be seen and those that were lost, by the last one seen and the frames since.

    A command is seen if it differs from every one that may be held by then. Whether it is does not depend on which of
    them were lost: a run of losses would show more often than it occurs if a change from the held one were enough.

    Args:
        command: (n, channels) [its unit].
        lost: (n, channels) those that were lost.
        sure: (n, channels) changes that show for sure [unit of the command].

    Returns:
        (2, AGES) each, as in `PacketLoss`.
    """
    channels = command.shape[1]
    low, high = np.zeros(channels), np.zeros(channels)  # ends of what may be held
    state, age = np.zeros(channels, dtype=int), np.full(channels, AGES - 1)
    events, gone = np.zeros((2, AGES), dtype=int), np.zeros((2, AGES), dtype=int)
    for now, missed, least in zip(command, lost, sure, strict=True):
        shown = (now < low - least) | (now > high + least)
        np.add.at(events, (state[shown], age[shown]), 1)
        np.add.at(gone, (state[shown], age[shown]), missed[shown])
        state, age = np.where(shown, missed, state), np.where(shown, 0, np.minimum(age + 1, AGES - 1))
        arrived = shown & ~missed
        low = np.where(arrived, now, np.where(shown, low, np.minimum(low, now)))
        high = np.where(arrived, now, np.where(shown, high, np.maximum(high, now)))
    return events, gone


def loss_probability(losses: list[PacketLoss]) -> tuple[float, float, float]:
    """Share of lost commands with its 90 % interval.

    Losses come in runs. A Markov chain that enters them with probability e and stays with s loses the share
    p = e / (e + 1 - s), and k frames after a command that arrived (x = 0) or was lost (x = 1) another one with
    probability p + (x - p) (s - e)^k. e and s have Jeffreys' priors.
    """
    from scipy.stats import beta

    lost, kept = (np.sum(rows, axis=0) for rows in ([d.lost for d in losses], [d.events - d.lost for d in losses]))
    steps = beta.ppf((np.arange(GRID) + 0.5) / GRID, 0.5, 0.5)
    enter, stay = (grid.ravel() for grid in np.meshgrid(steps, steps))
    share = enter / (enter + 1.0 - stay)
    support = np.zeros(len(share))
    for (x, k), count in np.ndenumerate(lost + kept):
        if count:
            chance = np.clip(share + (x - share) * (stay - enter) ** (k + 1), 1e-12, 1.0 - 1e-12)
            support += lost[x, k] * np.log(chance) + kept[x, k] * np.log1p(-chance)
    order = np.argsort(share)
    weights = np.cumsum(np.exp(support - support.max())[order])
    ends = np.array([0.5, 0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2]) * weights[-1]
    middle, low, high = share[order][np.searchsorted(weights, ends)]
    return float(middle), float(low), float(high)


def best_path(drive: Drive, log: Record, moved: np.ndarray, spread: np.ndarray, still: float) -> np.ndarray:
    """Mask (n, channels) of the commands that are lost on the path of least cost of each channel.

    Args:
        drive: the drives.
        log: what was measured.
        moved: (frames, channels) changes of position.
        spread: (frames, channels) their standard deviation.
        still: change of command that counts as none [its unit].
    """
    paths, history = Paths.start(drive.state, log.command.shape[1]), []
    for n in range(len(moved)):
        chosen = paths.branches(log.command[n], still)
        history.append(chosen)
        paths = paths.advanced(drive, chosen, log, n, moved[n], spread[n])
    lost, path = np.zeros(log.command.shape, dtype=bool), paths.cost.argmin(axis=0)
    channel = np.arange(len(path))
    for n, (parent, gone, _) in reversed(list(enumerate(history))):
        lost[n], path = gone[path, channel], parent[path, channel]
    return lost


def path_errors(drive: Drive, log: Record, moved: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Errors (frames, channels) of the changes of position with the commands (n, channels) that are lost."""
    states, before, errors = drive.state[None].copy(), np.zeros((1, moved.shape[1])), np.zeros(moved.shape)
    for n in range(len(moved)):
        held = np.where(lost[n], before, log.command[n])
        errors[n] = drive.moves(states, before, held, log.loads_at(n))[0] - moved[n]
        before = held
    return errors


def error_std(log: Record, errors: np.ndarray, noise: float, frame: float) -> np.ndarray:
    """Standard deviation of the changes of position (frames, channels): two readings, and the drive's model.

    The model's error is a share of what the commands of the last frames change; the lower quartile of the errors where
    nothing is lost tells the share, which commands that are lost in less than half of the time do not enlarge.
    """
    change = np.abs(np.diff(log.command[: len(errors)], axis=0, prepend=0.0)) * frame
    recent = sum((np.roll(change, k, axis=0) for k in range(1, LAGS)), start=change)
    large = recent > SHOWN * noise
    share = np.quantile(np.abs(errors[large]) / recent[large], 0.25) / QUARTILE if large.any() else 0.0
    return np.sqrt(2.0 * noise**2 + (share * recent) ** 2)


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of all channels side by side, (paths, channels) each; a path of one channel knows nothing of the others.

    Attributes:
        states: (paths, states) of the drives.
        held: command that arrived last.
        lost: whether the last command was lost.
        cost: so far.
    """

    states: np.ndarray
    held: np.ndarray
    lost: np.ndarray
    cost: np.ndarray

    @classmethod
    def start(cls, state: np.ndarray, channels: int) -> Paths:
        """One path at rest."""
        return cls(state[None].copy(), np.zeros((1, channels)), np.zeros((1, channels), bool), np.zeros((1, channels)))

    def branches(self, command: np.ndarray, still: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Paths through a further command: parent, whether it is lost, and cost, (paths, channels) each."""
        found = [self.branches_of(channel, value, still) for channel, value in enumerate(command)]
        count = max(len(branches) for branches in found)
        filled = [branches + branches[:1] * (count - len(branches)) for branches in found]
        cost, parent, lost = np.array(filled, dtype=float).transpose(2, 1, 0)
        return parent.astype(int), lost.astype(bool), cost

    def branches_of(self, channel: int, command: float, still: float) -> list[tuple[float, int, bool]]:
        """Branches of one channel, cheapest first: the command arrives on the best path, or is lost on some."""
        cost, best = self.cost[:, channel], int(self.cost[:, channel].argmin())
        found = [(float(cost[best]), best, False)]
        for k in np.flatnonzero(np.abs(self.held[:, channel] - command) > still):
            found.append((float(cost[k]) + (STAY if self.lost[k, channel] else ENTER), int(k), True))
        found = sorted(set(found))
        return [branch for branch in found if branch[0] < found[0][0] + FAR][:PATHS]

    def advanced(
        self,
        drive: Drive,
        chosen: tuple[np.ndarray, np.ndarray, np.ndarray],
        log: Record,
        n: int,
        moved: np.ndarray,
        spread: np.ndarray,
    ) -> Paths:
        """The paths after frame n of a log, in which its positions moved (channels,); `spread`: their error."""
        parent, lost, cost = chosen
        channel = np.arange(parent.shape[1])
        states = self.states[parent[:, drive.channel], np.arange(len(drive.state))]
        before = self.held[parent, channel]
        held = np.where(lost, before, log.command[n])
        errors = drive.moves(states, before, held, log.loads_at(n)) - moved
        return Paths(states, held, lost, cost + 0.5 * (errors / spread) ** 2)


class Drive:
    """The drives of a machine without its other parts, advanced frame by frame between readings of their positions.

    Attributes:
        state: (states,) at rest.
        channel: (states,) the channel that each state belongs to.
    """

    def __init__(self, machine: Machine, values: np.ndarray, link: CommandLink) -> None:
        part = next(b for b in machine.parts if b.name == link.part)
        self.compiled, self.slots, self.dt = compile_machine(machine).moves, machine.slots, machine.slot
        self.p = values[[i for i, info in enumerate(machine.parameters) if info.part == part.name]]
        self.state = np.zeros(sum(machine.part_size(part)))
        states = (*part.states, *(s for e in machine.effects_on(part) for s in e.states))
        self.channel = np.concatenate([np.repeat(np.arange(machine.width(s.axis)), s.width) for s in states])
        (task,) = (t for t in part.tasks if not t.slots)
        self.loads = [name for name in outer_reads(part, task.reads) if name != link.received]
        self.switch = write_slot(machine, link.received) - write_slot(machine, machine.column(link.output).signal)

    def moves(
        self, states: np.ndarray, before: np.ndarray, after: np.ndarray, loads: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Advances states (n, states) in place by one frame, in which the commands (n, channels) change.

        Returns:
            (n, channels) by how much the positions moved.
        """
        moved, given = np.empty(before.shape), (loads[name] for name in self.loads)
        self.compiled(states, self.p, self.dt, self.slots, self.switch, before, after, *given, moved)
        return moved


def write_slot(machine: Machine, signal: str) -> int:
    """First slot in which the part that writes a signal runs."""
    part = next(b for b in machine.parts if any(signal in o.writes for o in b.outputs))
    return min(slot for task in part.tasks for slot in task.slots)


def load_kinds(machine: Machine, link: CommandLink) -> dict[str, str]:
    """Signals that the drive reads besides its command, and the column kinds that measure them."""
    part = next(b for b in machine.parts if b.name == link.part)
    read = {name for t in part.tasks if not t.slots for name in outer_reads(part, t.reads)} - {link.received}
    imposed = {i.signal: s.output for s in machine.segments for i in s.imposed if not i.part}
    return {name: imposed[name] for name in sorted(read)}


@dataclass(frozen=True, eq=False)
class Record:
    """Measured command, position and loads by signal, each (n, channels) [SI] without gaps."""

    command: np.ndarray
    position: np.ndarray
    loads: Mapping[str, np.ndarray]

    def loads_at(self, frame: int) -> dict[str, np.ndarray]:
        """Loads (channels,) by signal in a frame."""
        return {name: rows[frame] for name, rows in self.loads.items()}
