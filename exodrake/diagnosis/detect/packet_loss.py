"""Packet loss: decoding of the commands that did not reach the drives, from a log.

Only the drives are simulated, on measured commands and loads; the path of least cost is the likeliest (Viterbi 1967):

    cost = sum of (moved - measured)^2 / (2 s^2)   +   ENTER where a run of losses begins, STAY where it goes on

moved, measured: change of position in a frame. s: standard deviation of two readings and of the drive's model error,
taken from the whole log, so that a drive that follows badly loses no commands. Where losses are found, they are decoded
once more with the probability that they show (Viterbi training; Juang & Rabiner 1990). Commands whose loss cannot be
seen may be lost as well: what that changes in a log counts as noise.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from exodrake.core.confidence import CONFIDENCE
from exodrake.data.log import fill_columns
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.problem import Detection, Problem, Trial
from exodrake.diagnosis.result import Interval, NamedEffect
from exodrake.diagnosis.search import name_kind
from exodrake.engine.compose import compile_machine
from exodrake.engine.schedule import outer_reads
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine

# -log of the probabilities that a run of losses begins at a change (6e-6), and goes on (0.4), where none is known yet
ENTER, STAY = 12.0, 1.0
PATHS, FAR = 6, 40.0  # most paths at a time; a path that costs so much more than the best is given up
ROUNDS = 2  # of decoding with the probability that the losses of the last one show
LAGS = 3  # frames in which a drive follows a command
QUARTILE = 0.32  # of the absolute value of a normal number, in standard deviations
SHOWN = 10.0  # the same, from which the loss of a single command shows
INPUT = "packet_arrival"  # signal that tells a simulated bus which commands arrive
LOST, ARRIVED, UNSEEN = 0.0, 1.0, 2.0  # its values; UNSEEN: it arrives on the likeliest path, and no reading shows it
STILL = 0.25  # standard deviations of a reading in a frame: smaller changes of the command count as none
CLEAR = 0.1  # of the errors around them that losses may leave: development cases 0.02-0.05, drives at a limit 0.2-0.7
SURE = 2.0 * ENTER**0.5  # spreads of a change whose loss is decoded for sure: it then costs twice ENTER
AGES = 12  # frames after which a command that was seen tells nothing more of the next one: 0.24 s; assumed
GRID = 120  # points of each probability of the Markov chain


class PacketLoss(NamedTuple):
    """Lost commands of one log."""

    packet_arrival: np.ndarray  # (n, channels), LOST, ARRIVED or UNSEEN
    events: np.ndarray  # (2, AGES) commands whose loss could be seen, so many frames after one seen to arrive, or lost
    lost: np.ndarray  # (2, AGES) those that were lost
    errors: np.ndarray  # (2,) squared errors around the losses, above those of noise and model, had they arrived; lost


def detect(problem: Problem, effect: Effect, values: np.ndarray) -> Problem:
    """The problem whose trials carry the packet losses that their logs show.

    They are decoded with the nominal drives, as retuned ones imitate losses. A drive at its limit seems to lose
    commands, but leaves errors; the effect remains a candidate, with the share that was counted as its parameter, where
    the losses leave few, and is none elsewhere.
    """
    machine, nominal, kinds = problem.robot.machine, problem.silent(), np.array(problem.kinds)
    needed, lead = list_needed(machine), effect.parameters[0]
    absent = replace(problem, tried=problem.tried - {effect.id})
    if not needed or any(np.sum(kinds == kind) < max(machine.column_width(kind), 1) for kind in needed):
        return absent
    noise = sensor_noise_std(problem.robot).get(needed[1], float(np.median(problem.noise_std[kinds == needed[1]])))
    trials, count, share = (*problem.fit, *problem.holdout), len(problem.fit), (0.0, 0.0, 0.0)
    drives = [Drive(machine, nominal, [t.measured[:, kinds == kind] for kind in needed], noise) for t in trials]
    decoded = [drive.decode() for drive in drives]
    arrived, left = sum((losses.errors for losses in decoded[:count]), start=np.zeros(2))
    if not arrived or left > CLEAR * arrived:
        return absent
    for _ in range(ROUNDS):
        share = loss_probability(decoded[:count])
        enter = max(float(np.log(1.0 / share[0] - 1.0)), STAY)
        decoded = [drive.decode(enter, known) for drive, known in zip(drives, decoded, strict=True)]
    arrivals = [losses.packet_arrival for losses in decoded]
    heard = tuple(replace(t, latent={**t.latent, INPUT: a}) for t, a in zip(trials, arrivals, strict=True))
    named = NamedEffect(effect.id, (), (), {lead.name: Interval(*share, lead.unit)}, {}, name_kind(effect))
    reason = f"{sum(np.sum(arrival == LOST) for arrival in arrivals[:count])} commands look lost, one by one"
    unseen = partial(draw_unseen, [*machine.effect_indices(effect.id, lead.name).values()], share[0])
    detected = (*problem.detected, Detection(named, {}, reason, unseen))
    return replace(problem, fit=heard[:count], holdout=heard[count:], detected=detected)


def draw_unseen(
    places: list[int], probability: float, problem: Problem, values: np.ndarray, trial: Trial, rng: np.random.Generator
) -> np.ndarray:
    """A run of a robot that loses some more commands, where no reading shows them, less that as decoded.

    places: of the probability of a loss in the flat vector `values` (parameters,). Returns (n, columns) [SI].
    """
    if INPUT not in trial.latent:
        return np.zeros(trial.measured.shape)
    values, arrival = values.copy(), trial.latent[INPUT]
    values[places] = probability
    drawn = np.where(arrival == UNSEEN, rng.uniform(size=arrival.shape), arrival)
    drawn = replace(trial, latent={**trial.latent, INPUT: drawn})
    return np.subtract(*(problem.predict(values[None], one)[0] for one in (drawn, trial)))


def count_visible(command: np.ndarray, lost: np.ndarray, sure: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which commands' loss could be seen; their number and that of the lost, by the last one seen and the frames since.

    A command is seen if it differs from every one that may be held by then, for sure by `sure` [its unit]. Whether it
    is does not depend on which of them were lost: a run of losses would show more often than it occurs if a change from
    the held one were enough. Arguments and the first result are (n, channels), the others (2, AGES) as in `PacketLoss`.
    """
    channels = command.shape[1]
    low, high = np.zeros(channels), np.zeros(channels)  # ends of what may be held
    state, age = np.zeros(channels, dtype=int), np.full(channels, AGES - 1)
    events, gone = np.zeros((2, 2, AGES), dtype=int)
    seen = np.zeros(command.shape, dtype=bool)
    for now, missed, least, shown in zip(command, lost, sure, seen, strict=True):
        shown[:] = (now < low - least) | (now > high + least)
        np.add.at(events, (state[shown], age[shown]), 1)
        np.add.at(gone, (state[shown], age[shown]), missed[shown])
        state, age = np.where(shown, missed, state), np.where(shown, 0, np.minimum(age + 1, AGES - 1))
        low = np.where(shown, np.where(missed, low, now), np.minimum(low, now))
        high = np.where(shown, np.where(missed, high, now), np.maximum(high, now))
    return seen, events, gone


def loss_probability(losses: list[PacketLoss]) -> tuple[float, float, float]:
    """Share of lost commands to expect, and its 90 % interval.

    Losses come in runs. A Markov chain that enters them with probability e and stays with s loses the share
    p = e / (e + 1 - s), and k frames after a command that arrived (x = 0) or was lost (x = 1) another one with
    probability p + (x - p) (s - e)^k. e and s have Jeffreys' priors.
    """
    from scipy.stats import beta

    lost, events = (np.sum(rows, axis=0) for rows in ([d.lost for d in losses], [d.events for d in losses]))
    steps = beta.ppf((np.arange(GRID) + 0.5) / GRID, 0.5, 0.5)
    enter, stay = (grid.ravel() for grid in np.meshgrid(steps, steps))
    share, support = enter / (enter + 1.0 - stay), np.zeros(GRID**2)
    for x, k in np.argwhere(events):
        chance = np.clip(share + (x - share) * (stay - enter) ** (k + 1), 1e-12, 1.0 - 1e-12)
        support += lost[x, k] * np.log(chance) + (events - lost)[x, k] * np.log1p(-chance)
    order, weights = np.argsort(share), np.exp(support - support.max())
    total = np.cumsum(weights[order])
    low, high = share[order][np.searchsorted(total, (0.5 + np.array([-0.5, 0.5]) * CONFIDENCE) * total[-1])].tolist()
    return float(weights @ share / weights.sum()), low, high


def list_needed(machine: Machine) -> list[str]:
    """Kinds of columns that drives are simulated on: commands, positions and loads; none without a command link."""
    link = machine.command_link
    if link is None:
        return []
    part = next(b for b in machine.parts if b.name == link.part)
    (task,) = (t for t in part.tasks if not t.slots)
    imposed = {i.signal: s.output for s in machine.segments for i in s.imposed if not i.part}
    loads = [imposed[name] for name in outer_reads(part, task.reads) if name != link.received]
    return [link.command, link.output, *loads]


class Drive:
    """The drives of a machine without its other parts, in one log, from frame to frame.

    rows: (n, channels) of each kind of `list_needed` [SI]. noise: standard deviation of a reading [its unit].
    """

    def __init__(self, machine: Machine, values: np.ndarray, rows: list[np.ndarray], noise: float) -> None:
        def find_slot(signal: str) -> int:
            """First slot in which the part that writes a signal runs."""
            writer = next(b for b in machine.parts if any(signal in o.writes for o in b.outputs))
            return min(slot for task in writer.tasks for slot in task.slots)

        link = machine.command_link
        assert link is not None, "a command link"
        part = next(b for b in machine.parts if b.name == link.part)
        switch = find_slot(link.received) - find_slot(machine.column(link.output).signal)
        p = values[[i for i, info in enumerate(machine.parameters) if info.part == part.name]]
        self.moves, self.given = compile_machine(machine).moves, (p, machine.slot, machine.slots, switch)
        self.rest = np.zeros((1, sum(machine.part_sizes[part.name])))
        states = (*part.states, *(s for e in machine.effects_on(part) for s in e.states))
        self.channel = np.concatenate([np.repeat(np.arange(machine.width(s.axis)), s.width) for s in states])
        self.frame, self.noise = machine.frame, noise
        self.command, position, *self.loads = map(fill_columns, rows)
        self.moved = np.diff(position, axis=0)  # (frames, channels), by which positions move

    def decode(self, enter: float = ENTER, known: PacketLoss | None = None) -> PacketLoss:
        """Lost commands of the log.

        enter: cost of the beginning of a run of losses [nats]. known: losses that were decoded before, which tell how
        well the drive's model follows without them.
        """
        whole = np.zeros(self.command.shape, dtype=bool)
        errors = self.errors(whole)
        clean = errors if known is None else self.errors(known.packet_arrival == LOST)
        # two readings, and the drive's model: a share of what the commands of the last frames change, by the lower
        # quartile of the errors where nothing is lost, which commands that are lost in less than half of the time do
        # not enlarge
        change = np.abs(np.diff(self.command[: len(errors)], axis=0, prepend=0.0)) * self.frame
        recent = sum((np.roll(change, k, axis=0) for k in range(1, LAGS)), start=change)
        large = recent > SHOWN * self.noise
        share = np.quantile(np.abs(clean[large]) / recent[large], 0.25) / QUARTILE if large.any() else 0.0
        spread = np.sqrt(2.0 * self.noise**2 + (share * recent) ** 2)
        lost = self.best_path(spread, enter)
        around = sum((np.roll(lost, k, axis=0) for k in range(LAGS)), start=whole)[: len(errors)]
        explained = self.errors(lost) if lost.any() else errors
        squared = np.array([np.sum((e / spread)[around] ** 2 - 1.0) for e in (errors, explained)])
        wide = np.vstack([spread, spread[-1:]])
        _, events, gone = count_visible(self.command, lost, np.maximum(SHOWN * self.noise, SURE * wide) / self.frame)
        seen, *_ = count_visible(self.command, lost, 2.0 * enter**0.5 * wide / self.frame)
        return PacketLoss(np.where(lost, LOST, np.where(seen, ARRIVED, UNSEEN)), events, gone, squared)

    def advance(self, states: np.ndarray, before: np.ndarray, after: np.ndarray, frame: int) -> np.ndarray:
        """Moves (k, channels) in a frame in which commands change so; states (k, states) are advanced in place."""
        moved = np.empty(before.shape)
        self.moves(states, *self.given, before, after, *(rows[frame] for rows in self.loads), moved)
        return moved

    def errors(self, lost: np.ndarray) -> np.ndarray:
        """Errors (frames, channels) of the changes of position with the commands (n, channels) that are lost."""
        states, before, errors = self.rest.copy(), np.zeros((1, lost.shape[1])), np.zeros(self.moved.shape)
        for n in range(len(errors)):
            held = np.where(lost[n], before, self.command[n])
            errors[n] = self.advance(states, before, held, n)[0] - self.moved[n]
            before = held
        return errors

    def best_path(self, spread: np.ndarray, enter: float) -> np.ndarray:
        """Mask (n, channels) of the commands that are lost on the path of least cost of each channel.

        Paths of all channels are advanced side by side; a path of one channel knows nothing of the others. Moves have
        a standard deviation of `spread` (frames, channels); a run of losses costs `enter` [nats].
        """
        channel, history, states = np.arange(spread.shape[1]), [], self.rest.copy()
        still = STILL * self.noise / self.frame
        # command that arrived last, whether the last one was lost, and cost so far: (paths, channels)
        held, gone, cost = (np.zeros((1, len(channel)), dtype=kind) for kind in (float, bool, float))
        for n, command in enumerate(self.command[: len(spread)]):
            each = []
            for c, value in enumerate(command):  # it arrives on the best path, or is lost on some
                best, apart = int(cost[:, c].argmin()), np.flatnonzero(np.abs(held[:, c] - value) > still).tolist()
                lost_now = [(float(cost[k, c]) + (STAY if gone[k, c] else enter), k, True) for k in apart]
                branches = sorted([(float(cost[best, c]), best, False), *lost_now])
                each.append([branch for branch in branches if branch[0] < branches[0][0] + FAR][:PATHS])
            count = max(map(len, each))
            filled = [branches + branches[:1] * (count - len(branches)) for branches in each]
            cost, parent, gone = np.array(filled, dtype=float).transpose(2, 1, 0)
            parent, gone = parent.astype(int), gone.astype(bool)
            history.append((parent, gone))
            states = states[parent[:, self.channel], np.arange(len(self.channel))]
            before = held[parent, channel]
            held = np.where(gone, before, command)
            cost = cost + 0.5 * ((self.advance(states, before, held, n) - self.moved[n]) / spread[n]) ** 2
        lost, path = np.zeros(self.command.shape, dtype=bool), cost.argmin(axis=0)
        for n, (parent, gone) in reversed(list(enumerate(history))):
            lost[n], path = gone[path, channel], parent[path, channel]
        return lost
