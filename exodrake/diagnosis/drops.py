"""Which speed commands were lost on the way to the drives, decoded frame by frame from a log.

A lost command can be seen where it would have changed the speed by much: the drive is simulated on the measured
commands and tensions, once with the command and once without, whatever became of the commands after it, and the stroke
of the next frames decides. What cannot be seen counts as received.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.core.machine import Machine
from exodrake.diagnosis.filters import filled_columns

STEP = 4e-3  # m/s: a smaller change of speed moves the stroke by less than two encoder counts a frame
AHEAD = 3  # frames that decide; losses come in bursts
CLEAR = 0.2  # of the squared error that losing the command must leave
# the same, and the change of speed, for a loss that nothing else looks like: the stroke is the held command's to a
# sixth, all that a drive's own errors leave; a weak or late drive's never is
CERTAIN, LARGE = 0.03, 2.0 * STEP
EVIDENCE = 2  # certain losses from which they count as seen
BROKEN = 0.5  # share of lost commands beyond which a drive is late or weak rather than deaf
FUTURES = tuple(product((False, True), repeat=AHEAD - 1))
Z90 = 1.645


@dataclass(frozen=True, eq=False)
class Drops:
    """`packet_arrival` (n, wires): 0 where a command was lost, else 1; events: commands whose loss could be seen,
    lost: those lost, certain: those beyond doubt.
    """

    packet_arrival: np.ndarray
    events: int
    lost: int
    certain: int


class Drive:
    """The three drives alone, tick by tick."""

    def __init__(self, machine: Machine, values: np.ndarray) -> None:
        module, at = compile_machine(machine), 0
        parts = {b.name: sum(e.part == b.name for e in machine.parameters) for b in machine.parts}
        for name, count in parts.items():
            if name == "motor":
                break
            at += count
        self.update, self.p = module.motor__leaf__update, values[at : at + parts["motor"]].copy()
        self.state = np.zeros(sum(machine.part_size(next(b for b in machine.parts if b.name == "motor"))))
        self.slots, self.dt = machine.slots, machine.slot

    def frame(self, state: np.ndarray, before: np.ndarray, after: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """Advances `state` over one frame from read to read; the speed changes on the way. Returns the strokes (3,)
        [m].
        """
        stroke, speed, angle = np.zeros(3), np.zeros(3), np.zeros(3)
        for tick in range(self.slots):
            applied = np.where(tick >= WRITE_AFTER_READ, after, before)
            self.update(state, stroke, speed, angle, self.p, self.dt, applied, tension)
        return stroke


WRITE_AFTER_READ = 4  # slots from a wire's bus read to its bus write: `model.md`, Timing


@dataclass(frozen=True, eq=False)
class Seen:
    """What a log shows: command [m/s], stroke [m], tension [N], each (n, wires), without gaps."""

    command: np.ndarray
    stroke: np.ndarray
    tension: np.ndarray


def decode(machine: Machine, values: np.ndarray, command: np.ndarray, stroke: np.ndarray, tension: np.ndarray) -> Drops:
    """Lost commands of one log. command [m/s], stroke [m], tension [N]: (n, wires), as logged."""
    log = Seen(*map(filled_columns, (command, stroke, tension)))
    drive = Drive(machine, values)
    packet_arrival, applied, state = np.ones_like(log.command), np.zeros(log.command.shape[1]), drive.state
    events = lost = certain = 0
    for n in range(len(packet_arrival) - AHEAD):
        change = np.abs(log.command[n] - applied)
        seen = change > STEP
        if seen.any():
            keep, drop = (least_error(drive, state, applied, seen, log, n, first) for first in (False, True))
            gone = seen & (drop < CLEAR * keep)
            packet_arrival[n, gone] = 0.0
            events, lost = events + int(seen.sum()), lost + int(gone.sum())
            certain += int(np.sum((change > LARGE) & (drop < CERTAIN * keep)))
        now = np.where(packet_arrival[n] == 0.0, applied, log.command[n])
        drive.frame(state, applied, now, log.tension[n])
        applied = now
    return Drops(packet_arrival, events, lost, certain)


def least_error(
    drive: Drive, state: np.ndarray, before: np.ndarray, seen: np.ndarray, log: Seen, n: int, lost: bool
) -> np.ndarray:
    """Least squared error of the strokes (wires,) [m2] over the next frames, whatever is lost after frame n, if the
    commands of the wires that are `seen` are lost in frame n, or are not.
    """
    return np.min([error(drive, state, before, seen, log, n, (lost, *future)) for future in FUTURES], axis=0)


def error(
    drive: Drive,
    state: np.ndarray,
    before: np.ndarray,
    seen: np.ndarray,
    log: Seen,
    n: int,
    lost: tuple[bool, ...],
) -> np.ndarray:
    """Squared error of the strokes (wires,) [m2] over the next frames; `lost`: in which of them commands are."""
    trial, total, speed = state.copy(), np.zeros(len(before)), before
    start = drive_stroke(drive, trial)
    for k in range(AHEAD):
        now = np.where(seen, speed, log.command[n + k]) if lost[k] else log.command[n + k]
        end = drive.frame(trial, speed, now, log.tension[n + k])
        total += ((end - start) - (log.stroke[n + k + 1] - log.stroke[n])) ** 2
        speed = now
    return total


def drive_stroke(drive: Drive, state: np.ndarray) -> np.ndarray:
    """Strokes (3,) of a state [m]: output angle times spool radius."""
    return state[6:9] * drive.p[RADIUS : RADIUS + 3]


RADIUS = 10  # place of r among the drive's numbers: after kM, J, b (three each) and N


def probability(drops: list[Drops]) -> tuple[float, float, float]:
    """Share of lost commands among those whose loss could be seen, with a 90 % interval (Wilson)."""
    n, k = sum(d.events for d in drops), sum(d.lost for d in drops)
    if not n:
        return 0.0, 0.0, 1.0
    centre = (k + Z90**2 / 2) / (n + Z90**2)
    half = Z90 / (n + Z90**2) * np.sqrt(k * (n - k) / n + Z90**2 / 4)
    return k / n, float(max(centre - half, 0.0)), float(min(centre + half, 1.0))


def lossy(drops: list[Drops]) -> bool:
    """Whether the decoded losses are evidence of their own; a drive that follows badly loses commands in this sense,
    too.
    """
    share, _, _ = probability(drops)
    return sum(d.certain for d in drops) >= EVIDENCE and share < BROKEN
