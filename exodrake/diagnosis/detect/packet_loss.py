"""Packet loss: decoding of the commands that did not reach the drives, from a log.

The path of least cost through a log (`command_paths`) gives the losses, run by run. A run of losses is accepted if it
removes most of the errors around it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.confidence import CONFIDENCE
from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.diagnosis.command_paths import ENTER, LAGS, SHOWN, best_path, error_std, path_errors
from exodrake.diagnosis.detection import Detection
from exodrake.diagnosis.drive import Drive, Record, load_kinds
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.gap import Interval
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.result import NamedEffect
from exodrake.diagnosis.search import kind_of

if TYPE_CHECKING:
    from exodrake.diagnosis.problem import Problem, Trial

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
