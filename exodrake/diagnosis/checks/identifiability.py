"""Identifiability: the effects that the motion of a case could show, and those that it could not tell apart.

The case counts as a planned experiment: the logs that the nominal robot would give, with every signal in them. An
effect of typical size changes them by a direction d, in noise standard deviations and with the nominal parameters free
within their tolerances. It is seen where |d| exceeds `SEEN`. Another effect can be taken for it where its own
directions D, scaled within their ranges, leave less than the noise or the error rho of a law does (`LAW`):

    left = min_f | d - D f |          taken for it: left < max(SEEN, rho |d|)

As in a diagnosis, samples within the correlation time of a model's error count as one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from exodrake.core.machine import Column, Machine
from exodrake.core.progress import no_progress
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.likelihood import CORRELATION, duration, output_error
from exodrake.diagnosis.linear import LinearModel, bounded
from exodrake.diagnosis.linearise import Linearisation, linearise
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.search import LAW

SEEN = 4.0  # standard deviations; that of one test among a hundred effects and channels at 0.3 % (normal law)
STRETCH = (0.0, 1.5)  # by which a direction that was simulated at one size only may be scaled: assumed
FRAMES = 1500  # of the case that are simulated for each direction; they stand for all, so that a check takes seconds
SENSOR = 5e-4  # noise of a sensor not there yet, as a share of its signal's span: assumed, an encoder of 12 bits
EXTRA = "also"  # kind of the columns of such sensors


class Direction(NamedTuple):
    """An effect of typical size on one channel."""

    effect: str
    channel: str  # "" for an effect of the whole robot
    unit: str  # of the effect's first parameter
    typical: float  # value of that parameter [unit]
    seen: float  # how far the logs change [standard deviations]
    smallest: float  # value that could just be seen [unit], within the plausible range; NaN where sizes do not scale
    taken_for: dict[str, float]  # effects that could be taken for it -> share of the change that they leave


class Sensor(NamedTuple):
    """A signal that is not logged, with the numbers of hidden and mistaken directions if it were."""

    signal: str
    unit: str
    noise: float
    hidden: int
    mistaken: int


class Fewer(NamedTuple):
    """Identifiability with some kinds of sensors alone, and the effects that are then no longer distinguished."""

    kinds: tuple[str, ...]
    left: Identifiability
    lost: tuple[str, ...]


class Identifiability(NamedTuple):
    """Identifiability of effects from the references and columns of a case."""

    directions: tuple[Direction, ...]
    sensors: tuple[Sensor, ...] = ()  # signals whose measurement would help most, best first
    fewer: tuple[Fewer, ...] = ()  # with one kind of sensor less, and with each alone

    @property
    def clear(self) -> tuple[Direction, ...]:
        """Directions that the logs would show and distinguish from other effects."""
        return tuple(d for d in self.directions if d.seen >= SEEN and not d.taken_for)

    @property
    def hidden(self) -> tuple[Direction, ...]:
        """Directions that the logs would not show."""
        return tuple(d for d in self.directions if d.seen < SEEN)

    @property
    def mistaken(self) -> tuple[Direction, ...]:
        """Directions that they would show, and another effect could be taken for."""
        return tuple(d for d in self.directions if d.seen >= SEEN and d.taken_for)


def identifiability(
    case: Case, robot: Robot, tried: frozenset[str] | None = None, progress: Callable[[str], object] = no_progress
) -> Identifiability:
    """Identifiability of effects (ids; those of a diagnosis by default) from the references and columns of a case."""
    whole = make_problem(case, robot, tried)
    problem = plan_experiment(whole)
    machine = problem.robot.machine
    effects = [effect for effect in machine.effects if effect.id in problem.tried]
    nominal = nominal_parameters(problem.robot)
    progress(f"simulating {len(effects)} effects")
    lin = linearise(output_error(problem), problem.silent(), np.zeros(len(nominal)), nominal, effects)
    progress("telling the effects apart")
    # a linear model of nominal parameters and, last, directions, with a block for each kind of column
    kinds, known = np.array(problem.kinds), list(dict.fromkeys(problem.kinds))
    kind = np.concatenate([np.tile(kinds, len(trial.measured)) for trial in problem.fit])
    rows = np.concatenate([lin.jacobian, lin.directions, np.zeros((1, lin.directions.shape[1]))], dtype=np.float32)
    places = [np.flatnonzero(kind == k) for k in known]
    ends = np.cumsum([0, *map(len, places)])
    blocks = [(0, 0, slice(int(a), int(b))) for a, b in pairwise(ends)]
    free = np.full(len(rows) - 1, np.inf)
    precision = np.r_[[p.prior_std**-2.0 for p in nominal], np.zeros(len(free) - len(nominal))]
    memory = max(CORRELATION / machine.frame, 1.0) / (duration(whole) / duration(problem))
    prior = (0.0 * precision, precision, -free, free)
    model = LinearModel.of_rows(rows[:, np.concatenate(places)], blocks, prior, memory)

    def with_kinds(some: Sequence[str], every: bool = False) -> Identifiability:
        return Identifiability(find_directions(lin, machine, model, np.isin(known, some), every))

    own = [k for k in known if not k.startswith(EXTRA)]
    found, sensors, fewer = with_kinds(own, every=True), [], []
    for k in (k for k in known if k.startswith(EXTRA)):
        better, signal = with_kinds([*own, k]), machine.signal[machine.column(k).signal]
        noise = float(problem.noise_std[kinds == k].max())
        if len(better.hidden) + len(better.mistaken) < len(found.hidden) + len(found.mistaken):
            sensors.append(Sensor(signal.name, signal.unit, noise, len(better.hidden), len(better.mistaken)))
    sensors.sort(key=lambda s: (s.hidden + s.mistaken, s.hidden))
    # one kind of sensor less, and each alone; a command that is logged is no sensor, and stays
    removable = [k for k in own if machine.observer is None or k != machine.observer.measured_input]
    sets = [tuple(k for k in own if k != gone) for gone in removable]
    sets += [tuple(k for k in own if k == kept or k not in removable) for kept in removable]
    for some in dict.fromkeys(sets) if len(removable) > 1 else ():
        left = with_kinds(some)
        clear = {d.effect for d in left.clear}
        fewer.append(Fewer(some, left, tuple(dict.fromkeys(d.effect for d in found.clear if d.effect not in clear))))
    return found._replace(sensors=tuple(sensors), fewer=tuple(fewer))


def plan_experiment(problem: Problem) -> Problem:
    """The problem as an experiment: logs that the nominal robot would give, with every signal in them."""
    machine, noise, own = problem.robot.machine, sensor_noise_std(problem.robot), len(problem.columns)
    logged = {c.signal for c in machine.columns if any(col.startswith(f"{c.kind}_") for col in problem.columns)}
    written = {name for part in machine.parts for output in part.outputs for name in output.writes}
    more = [s for s in machine.signals if s.name in written - logged]
    extra = tuple(Column(EXTRA + s.name.replace("_", ""), s.name, required=False) for s in more)
    wide = replace(machine, columns=machine.columns + extra, nominal=None)
    short = problem.shortened(min(1.0, FRAMES / sum(len(t.reference) for t in problem.fit)))
    columns, robot = (*problem.columns, *machine.log_names(extra)), replace(problem.robot, machine=wide)
    every, trials = replace(short, robot=robot, columns=columns, holdout=()), []
    for trial in short.fit:
        (simulated,) = every.predict(every.silent()[None], trial)
        simulated[:, :own][np.isnan(trial.measured)] = np.nan
        trials.append(replace(trial, measured=simulated))
    kinds = {c.signal: c.kind for c in machine.columns}
    span = np.max([np.ptp(np.nan_to_num(t.measured), axis=0) for t in trials], axis=0)[own:]
    levels = np.array([noise.get(kinds.get(s.name, ""), 0.0) for s in more for _ in machine.axes.of(s.axis)])
    stated = np.concatenate([problem.noise_std, np.where(levels > 0.0, levels, SENSOR * span)])
    keep = (np.arange(len(stated)) < own) | ((stated > 0.0) & np.isfinite(stated))
    fit = tuple(replace(t, measured=t.measured[:, keep]) for t in trials)
    return replace(every, columns=tuple(np.array(columns)[keep].tolist()), noise_std=stated[keep], fit=fit)


def find_directions(
    lin: Linearisation, machine: Machine, model: LinearModel, blocks: np.ndarray, every: bool
) -> tuple[Direction, ...]:
    """All effects of typical size on each channel, by some blocks (mask) of the linear model of `lin`.

    every: whether all effects that could be taken for one are sought; else the first.
    """
    some = replace(model, products=model.products * blocks[:, None, None])
    gram, found = some.eliminated(len(lin.nominal)).normal, []
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    least = np.array([least_left(gram, probe.rows) for probe in lin.probes])
    for effect in dict.fromkeys(p.effect for p in lin.probes):
        info, probes = machine.effect(effect).parameters[0], [p for p in lin.probes if p.effect == effect]
        others = np.array([p.effect != effect for p in lin.probes])
        # the directions at the modest amplitude: of each channel where their sizes scale, else of the typical probe
        scaled = next((probe for probe in probes if probe.scaled), None)
        if scaled is not None and scaled.parameters[scaled.scaled[0]].channels != ("",):
            typical = [(int(row), scaled, k) for row, k in zip(scaled.rows, scaled.scaled, strict=True)]
        else:
            probe = min(probes, key=lambda p: abs(p.x[0] - p.parameters[0].start))
            typical = [(int(probe.rows[0]), probe, 0)]
        for row, probe, k in typical:
            parameter, x, seen = probe.parameters[k], float(probe.x[k]), float(size[row])
            channel = parameter.channels[0] if probe is scaled and len(parameter.channels) == 1 else ""
            smallest, taken, most = float("nan"), dict[str, float](), max(SEEN, LAW * seen)
            if probe.scaled and seen > 0.0:  # no weaker than plausible
                ends = [parameter.coordinate(end) for end in (info.low, info.high)]
                weakest = min(map(abs, ends)) if ends[0] * ends[1] > 0.0 else 0.0
                smallest = parameter.value(float(np.copysign(max(abs(x) * SEEN / seen, weakest), x)))
            near = np.flatnonzero(others & (least[:, row] < most)) if seen >= SEEN else []
            for rival in (lin.probes[i] for i in sorted(near, key=lambda i: least[i, row])):
                low, high = (rival.low, rival.high) if rival.scaled else np.array(STRETCH)[:, None]
                _, gain = bounded(gram[np.ix_(rival.rows, rival.rows)], -gram[rival.rows, row], low, high)
                rest = float(np.sqrt(max(gram[row, row] + 2.0 * gain, 0.0)))
                if rest < most:
                    taken[rival.effect] = min(taken.get(rival.effect, 1.0), rest / seen)
                    if not every:
                        break
            taken = dict(sorted(taken.items(), key=lambda item: item[1]))
            found.append(Direction(effect, channel, info.unit, parameter.value(x), seen, smallest, taken))
    return tuple(found)


def least_left(gram: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """What any sizes of some directions leave of each (directions,) [standard deviations]; 0 if rounding hides it."""
    size = np.sqrt(np.maximum(np.diag(gram)[rows], 1e-12))
    normal = gram[np.ix_(rows, rows)] / np.outer(size, size) + 1e-8 * np.eye(len(rows))
    if np.linalg.eigvalsh(normal)[0] <= 0.0:
        return np.zeros(len(gram))
    cross = gram[rows] / size[:, None]
    return np.sqrt(np.maximum(np.diag(gram) - np.sum(cross * np.linalg.solve(normal, cross), axis=0), 0.0))
