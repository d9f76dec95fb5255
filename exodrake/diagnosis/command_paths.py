"""Paths of commands through a log: each command arrives at the drives, or the last one that arrived is held on.

Only the drives are simulated, on the measured commands and loads, along several paths side by side. The path of least
cost is the likeliest (Viterbi 1967):

    cost = sum of (moved - measured)^2 / (2 s^2)   +   ENTER where a run of losses begins, STAY where it goes on

moved, measured: change of position in a frame. s: standard deviation of two readings and of the drive's model error,
which is taken from the whole log. A drive that follows badly therefore loses no commands. A burst of losses is detected
even if it begins with small changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.drive import Drive, Record

ENTER, STAY = 12.0, 1.0  # -log of the probabilities that a run of losses begins at a change (6e-6), and goes on (0.4)
PATHS, FAR = 6, 40.0  # most paths at a time; a path that costs so much more than the best is given up
LAGS = 3  # frames in which a drive follows a command
QUARTILE = 0.32  # of the absolute value of a normal number, in standard deviations
SHOWN = 10.0  # the same, from which the loss of a single command shows


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
