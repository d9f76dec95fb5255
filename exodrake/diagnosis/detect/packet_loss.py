"""Packet loss: which commands did not reach the drives, decoded from a log.

The drives alone are simulated on the measured commands and loads, along several paths side by side: each command
arrives, or the last one that arrived is held on. The path of least cost tells the losses (Viterbi 1967):

    cost = sum of (moved - measured)^2 / (2 s^2)   +   ENTER where a run of losses begins, STAY where it goes on

moved, measured: change of position in a frame; s: noise of two readings, and the error of the drive's model, as large
as a log shows it on the whole. So a drive that follows badly loses no commands, and a burst is seen though it begins
with small changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.diagnosis.detection import Detection
from exodrake.diagnosis.drive import Drive, Record, load_kinds
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.result import Interval, NamedEffect

if TYPE_CHECKING:
    from exodrake.diagnosis.problem import Problem, Trial

INPUT = "packet_arrival"  # signal that tells a simulated bus which commands arrive
ENTER, STAY = 12.0, 1.0  # -log of the probabilities that a run of losses begins at a change (6e-6), and goes on (0.4)
PATHS, FAR = 6, 40.0  # most paths at a time; a path that costs so much more than the best is given up
STILL = 0.25  # standard deviations of a reading in a frame: smaller changes of the command count as none
SHOWN = 10.0  # the same, from which the loss of a single command shows
LAGS = 3  # frames in which a drive follows a command
QUARTILE = 0.32  # of the absolute value of a normal number, in standard deviations
CLEAR = (
    0.1  # of the errors around them that losses may leave; in development cases 0.02-0.05, a drive at its limit 0.2-0.9
)
CONFIDENCE, DRAWS = 0.9, 4000  # of the interval of a share, and draws for it


@dataclass(frozen=True, eq=False)
class PacketLoss:
    """Lost commands of one log.

    Attributes:
        packet_arrival: (n, channels), 0 where a command was lost, else 1.
        events: (2,) commands whose loss could be seen, after one that arrived and after one that was lost.
        lost: (2,) those that were lost.
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
    named = NamedEffect(effect.id, (), (), {lead.name: Interval(*counted, lead.unit)}, {}, 1.0)
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
    before, after_loss = np.zeros(log.command.shape[1]), np.zeros(log.command.shape[1], dtype=bool)
    events, gone = np.zeros(2, dtype=int), np.zeros(2, dtype=int)
    for command, missed in zip(log.command, lost, strict=True):
        shown = np.abs(command - before) * frame > SHOWN * noise
        for k, cell in enumerate((shown & ~after_loss, shown & after_loss)):
            events[k], gone[k] = events[k] + cell.sum(), gone[k] + (cell & missed).sum()
        before, after_loss = np.where(missed, before, command), missed
    explained = path_errors(drive, log, moved, lost)
    squared = [float(np.sum((e / spread)[around] ** 2 - 1.0)) for e in (errors, explained)]
    return PacketLoss(1.0 - lost, events, gone, np.array(squared))


def path_errors(drive: Drive, log: Record, moved: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Errors (frames, channels) of the changes of position with the commands (n, channels) that are lost."""
    state, before, errors = drive.state.copy(), np.zeros(moved.shape[1]), np.zeros(moved.shape)
    position = drive.position(state)
    for n in range(len(moved)):
        held = np.where(lost[n], before, log.command[n])
        after = drive.frame(state, before, held, log.loads_at(n))
        errors[n], position, before = after - position - moved[n], after, held
    return errors


def best_path(drive: Drive, log: Record, moved: np.ndarray, spread: np.ndarray, still: float) -> np.ndarray:
    """Which commands (n, channels) are lost on the path of least cost of each channel.

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
    lost, lane = np.zeros(log.command.shape, dtype=bool), paths.cost.argmin(axis=0)
    channel = np.arange(len(lane))
    for n, (parent, gone, _) in reversed(list(enumerate(history))):
        lost[n], lane = gone[lane, channel], parent[lane, channel]
    return lost


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
        ends = [drive.position(state) for state in states]
        for k, state in enumerate(states):
            ends[k] = drive.frame(state, before[k], held[k], log.loads_at(n)) - ends[k]
        return Paths(states, held, lost, cost + 0.5 * ((np.array(ends) - moved) / spread) ** 2)


def loss_probability(losses: list[PacketLoss]) -> tuple[float, float, float]:
    """Share of lost commands with its 90 % interval.

    Losses come in runs, so that a loss shows more often within a run than where it begins. Of a Markov chain that
    enters runs with probability e and stays with s, the share is e / (e + 1 - s); e and s have Jeffreys' posterior.
    """
    from scipy.stats import beta

    lost, kept = (np.sum(rows, axis=0) for rows in ([d.lost for d in losses], [d.events - d.lost for d in losses]))
    enter, stay = (beta.rvs(lost[k] + 0.5, kept[k] + 0.5, size=DRAWS, random_state=k) for k in range(2))
    low, middle, high = np.quantile(enter / (enter + 1.0 - stay), (0.5 - CONFIDENCE / 2, 0.5, 0.5 + CONFIDENCE / 2))
    return float(middle), float(low), float(high)
