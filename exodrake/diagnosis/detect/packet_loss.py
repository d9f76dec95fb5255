"""Packet loss: which commands did not reach the drives, decoded frame by frame from a log.

A lost command shows where it would have changed the speed by much. Only the drives are simulated on the measured
commands and loads, with the command and without it, for every pattern of losses in the frames that follow; the measured
positions of these frames decide by the least squared error. A change of speed that moves the drive less in these frames
than the noise of a reading counts as received.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.leaf_functions import held_signals, outer_reads
from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.core.segment import CommandLink
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.result import Detection, Interval, NamedEffect

if TYPE_CHECKING:
    from exodrake.diagnosis.problem import Problem, Trial

INPUT = "packet_arrival"  # signal that tells a simulated bus which commands arrive
AHEAD = 3  # frames that decide; losses come in bursts
CLEAR = 0.2  # of the squared error that losing the command must leave
CERTAIN = 6.0  # standard deviations of a reading that a loss must show; a healthy log has 500 changes: 1e-9 each
FUTURES = tuple(product((False, True), repeat=AHEAD - 1))
CONFIDENCE = 0.9


@dataclass(frozen=True, eq=False)
class PacketLoss:
    """Lost commands of one log.

    Attributes:
        packet_arrival: (n, channels), 0 where a command was lost, else 1.
        events: commands whose loss could be seen.
        lost: those that were lost.
    """

    packet_arrival: np.ndarray
    events: int
    lost: int


def detect(problem: Problem, effect: Effect, values: np.ndarray) -> Problem:
    """The problem whose trials carry the packet losses that their logs show.

    They are decoded with the nominal drives, as retuned ones imitate losses. A drive that follows badly loses commands,
    too, so the effect remains a candidate, with the share that was counted as its parameter; it is none where
    no loss is seen.
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

    problem = replace(problem, fit=tuple(map(decoded, problem.fit)))
    lost, counted = sum(d.lost for d in found), loss_probability(found)
    problem = replace(problem, holdout=tuple(map(decoded, problem.holdout)))
    if not lost:
        return replace(problem, tried=problem.tried - {effect.id})
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


class Drive:
    """The drives of a machine without its other parts, advanced frame by frame between readings of their positions."""

    def __init__(self, machine: Machine, values: np.ndarray, link: CommandLink) -> None:
        part = next(b for b in machine.parts if b.name == link.part)
        (task,) = (t for t in part.tasks if not t.slots)
        module, self.slots, self.dt = compile_machine(machine), machine.slots, machine.slot
        self.update = getattr(module, f"{part.name}__leaf__{task.function}")
        self.hold = getattr(module, f"{part.name}__leaf__hold")
        self.p = values[[i for i, info in enumerate(machine.parameters) if info.part == part.name]]
        self.state = np.zeros(sum(machine.part_size(part)))
        self.signals = {name: np.zeros(machine.width(machine.signal[name].axis)) for name in held_signals(part)}
        self.moved, self.received, self.reads = link.moved, link.received, outer_reads(part, task.reads)
        self.switch = write_slot(machine, link.received) - write_slot(machine, machine.column(link.output).signal)

    def frame(self, state: np.ndarray, before: np.ndarray, after: np.ndarray, loads: Mapping[str, np.ndarray]):
        """Advances `state` in place by one frame, in which the command changes; returns positions (channels,)."""
        for tick in range(self.slots):
            now = {self.received: after if tick >= self.switch else before, **loads}
            self.update(state, *self.signals.values(), self.p, self.dt, *(now[name] for name in self.reads))
        return self.signals[self.moved].copy()

    def position(self, state: np.ndarray) -> np.ndarray:
        """Positions (channels,) of a state."""
        self.hold(state, *self.signals.values(), self.p)
        return self.signals[self.moved].copy()


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
    visible = CERTAIN * noise / (AHEAD * frame)
    packet_arrival, applied, state = np.ones_like(log.command), np.zeros(log.command.shape[1]), drive.state
    events = lost = 0
    for n in range(len(packet_arrival) - AHEAD):
        change = np.abs(log.command[n] - applied)
        seen = change > visible
        if seen.any():
            keep, drop = (least_error(drive, state, applied, seen, log, n, first) for first in (False, True))
            shown = seen & (np.abs(keep - drop) > (CERTAIN * noise) ** 2)
            gone = shown & (drop < CLEAR * keep)
            packet_arrival[n, gone] = 0.0
            events, lost = events + int(shown.sum()), lost + int(gone.sum())
        now = np.where(packet_arrival[n] == 0.0, applied, log.command[n])
        drive.frame(state, applied, now, log.loads_at(n))
        applied = now
    return PacketLoss(packet_arrival, events, lost)


def least_error(
    drive: Drive, state: np.ndarray, before: np.ndarray, seen: np.ndarray, log: Record, n: int, lost: bool
) -> np.ndarray:
    """Least squared error (channels,) of the positions over the next frames, whatever is lost after frame n.

    `lost` says whether the commands of the channels that are `seen` are lost in frame n.
    """
    return np.min([error(drive, state, before, seen, log, n, (lost, *future)) for future in FUTURES], axis=0)


def error(
    drive: Drive,
    state: np.ndarray,
    before: np.ndarray,
    seen: np.ndarray,
    log: Record,
    n: int,
    lost: tuple[bool, ...],
) -> np.ndarray:
    """Squared error (channels,) of the positions over the next frames; `lost`: in which of them commands are."""
    trial, total, speed = state.copy(), np.zeros(len(before)), before
    start = drive.position(trial)
    for k in range(AHEAD):
        now = np.where(seen, speed, log.command[n + k]) if lost[k] else log.command[n + k]
        end = drive.frame(trial, speed, now, log.loads_at(n + k))
        total += ((end - start) - (log.position[n + k + 1] - log.position[n])) ** 2
        speed = now
    return total


def loss_probability(losses: list[PacketLoss]) -> tuple[float, float, float]:
    """Share of lost commands among those whose loss could be seen, with its 90 % interval (Wilson)."""
    from scipy.stats import binomtest

    n, k = sum(d.events for d in losses), sum(d.lost for d in losses)
    if not n:
        return 0.0, 0.0, 1.0
    interval = binomtest(k, n).proportion_ci(CONFIDENCE, "wilson")
    return k / n, float(interval.low), float(interval.high)
