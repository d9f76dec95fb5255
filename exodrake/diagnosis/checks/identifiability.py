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
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from exodrake.core.machine import Column, Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.likelihood import CORRELATION, duration, output_error
from exodrake.diagnosis.linear import LinearModel, bounded
from exodrake.diagnosis.linearise import Linearisation, Probe, linearise
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.search import LAW

SEEN = 4.0  # standard deviations; that of one test among a hundred effects and channels at 0.3 % (normal law)
STRETCH = (0.0, 1.5)  # by which a direction that was simulated at one size only may be scaled: assumed
FRAMES = 1500  # of the case that are simulated for each direction; they stand for all, so that a check takes seconds
SENSOR = 5e-4  # noise of a sensor not there yet, as a share of its signal's span: assumed, an encoder of 12 bits
EXTRA = "also"  # kind of the columns of such sensors


@dataclass(frozen=True)
class Direction:
    """An effect of typical size on one channel.

    Attributes:
        effect: id.
        channel: "" for an effect of the whole robot.
        unit: of its first parameter.
        typical: value of that parameter [unit].
        seen: how far the logs change [standard deviations].
        smallest: value that could just be seen [unit], within the plausible range; NaN where sizes do not scale.
        taken_for: effects that could be taken for it -> share of the change that they leave [-].
    """

    effect: str
    channel: str
    unit: str
    typical: float
    seen: float
    smallest: float
    taken_for: dict[str, float]


@dataclass(frozen=True)
class Sensor:
    """A signal that is not logged, with the numbers of hidden and mistaken directions if it were."""

    signal: str
    unit: str
    noise: float
    hidden: int
    mistaken: int


@dataclass(frozen=True, eq=False)
class Fewer:
    """Identifiability with a subset of the sensors; `lost` holds the effects that are no longer distinguished."""

    kinds: tuple[str, ...]
    left: Identifiability
    lost: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Identifiability of effects from the references and columns of a case.

    Attributes:
        directions: of all effects.
        sensors: signals whose measurement would help most, best first.
        fewer: the same with one kind of sensor less, and with each alone.
    """

    directions: tuple[Direction, ...]
    sensors: tuple[Sensor, ...] = ()
    fewer: tuple[Fewer, ...] = ()

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
    case: Case,
    robot: Robot,
    tried: frozenset[str] | None = None,
    progress: Callable[[str], object] = lambda text: None,
) -> Identifiability:
    """Identifiability of effects from the references of a case, whatever its measured values are.

    Args:
        case: references and columns.
        robot: nominal robot.
        tried: ids of effects; those of a diagnosis by default.
        progress: called with what is done.
    """
    whole = make_problem(case, robot, tried)
    problem = plan_experiment(whole)
    machine = problem.robot.machine
    effects = [effect for effect in machine.effects if effect.id in problem.tried]
    nominal, values = nominal_parameters(problem.robot), problem.silent()
    progress(f"simulating {len(effects)} effects")
    lin = linearise(output_error(problem), values, np.zeros(len(nominal)), nominal, effects)
    progress("telling the effects apart")
    # a linear model of nominal parameters and, last, directions, with a block for each kind of column
    kinds = np.array(problem.kinds)
    known = list(dict.fromkeys(problem.kinds))
    samples = [np.concatenate([np.tile(kinds == k, len(trial.measured)) for trial in problem.fit]) for k in known]
    rows = np.concatenate([lin.jacobian, lin.directions, np.zeros((1, lin.directions.shape[1]))], dtype=np.float32)
    ends = np.cumsum([0, *(mask.sum() for mask in samples)])
    blocks = [(0, 0, slice(int(a), int(b))) for a, b in pairwise(ends)]
    precision, free = np.zeros(len(rows) - 1), np.full(len(rows) - 1, np.inf)
    precision[: len(nominal)] = [p.prior_std**-2.0 for p in lin.nominal]
    memory = max(CORRELATION / machine.frame, 1.0) / (duration(whole) / duration(problem))
    order = np.concatenate([np.flatnonzero(mask) for mask in samples])
    model = LinearModel.of_rows(rows[:, order], blocks, (np.zeros(len(free)), precision, -free, free), memory)
    own = [kind for kind in known if not kind.startswith(EXTRA)]

    def with_kinds(some: Sequence[str], every: bool = False) -> Identifiability:
        return Identifiability(find_directions(lin, machine, model, np.isin(known, some), every))

    found = with_kinds(own, every=True)
    sensors = []
    for kind in (kind for kind in known if kind.startswith(EXTRA)):
        better, signal = with_kinds([*own, kind]), machine.signal[machine.column(kind).signal]
        noise = float(problem.noise_std[kinds == kind].max())
        sensors.append(Sensor(signal.name, signal.unit, noise, len(better.hidden), len(better.mistaken)))
    helpful = [s for s in sensors if s.hidden + s.mistaken < len(found.hidden) + len(found.mistaken)]
    best = tuple(sorted(helpful, key=lambda s: (s.hidden + s.mistaken, s.hidden)))
    # one kind of sensor less, and each alone; a command that is logged is no sensor, and stays
    removable = [kind for kind in own if machine.observer is None or kind != machine.observer.measured_input]
    sets = [tuple(k for k in own if k != kind) for kind in removable]
    sets += [tuple(k for k in own if k == kind or k not in removable) for kind in removable]
    fewer = []
    for some in dict.fromkeys(sets) if len(removable) > 1 else ():
        left = with_kinds(some)
        clear = {d.effect for d in left.clear}
        lost = tuple(dict.fromkeys(d.effect for d in found.clear if d.effect not in clear))
        fewer.append(Fewer(some, left, lost))
    return replace(found, sensors=best, fewer=tuple(fewer))


def plan_experiment(problem: Problem) -> Problem:
    """The problem as an experiment: logs that the nominal robot would give, with every signal in them."""
    machine, noise = problem.robot.machine, sensor_noise_std(problem.robot)
    logged = {c.signal for c in machine.columns if any(col.startswith(f"{c.kind}_") for col in problem.columns)}
    written = {name for part in machine.parts for output in part.outputs for name in output.writes}
    more = [s for s in machine.signals if s.name in written - logged]
    extra = tuple(Column(EXTRA + s.name.replace("_", ""), s.name, required=False) for s in more)
    wide = replace(machine, columns=machine.columns + extra, nominal=None)
    names = machine.log_names(extra)
    short = problem.shortened(min(1.0, FRAMES / sum(len(t.reference) for t in problem.fit)))
    every = replace(short, robot=replace(problem.robot, machine=wide), columns=(*problem.columns, *names), holdout=())
    values, trials = every.silent(), []
    for trial in short.fit:
        (simulated,) = every.predict(values[None], trial)
        simulated[:, : len(problem.columns)][np.isnan(trial.measured)] = np.nan
        trials.append(replace(trial, measured=simulated))
    kinds = {c.signal: c.kind for c in machine.columns}
    span = np.max([np.ptp(np.nan_to_num(t.measured), axis=0) for t in trials], axis=0)
    levels = [noise.get(kinds.get(s.name, ""), 0.0) for s in more for _ in machine.axes.of(s.axis)]
    stated = np.where(np.array(levels) > 0.0, levels, SENSOR * span[len(problem.columns) :])
    keep = np.concatenate([np.ones(len(problem.columns), bool), (stated > 0.0) & np.isfinite(stated)])
    return replace(
        every,
        columns=tuple(c for c, k in zip(every.columns, keep, strict=True) if k),
        noise_std=np.concatenate([problem.noise_std, stated])[keep],
        fit=tuple(replace(t, measured=t.measured[:, keep]) for t in trials),
    )


def find_directions(
    lin: Linearisation, machine: Machine, model: LinearModel, blocks: np.ndarray, every: bool
) -> tuple[Direction, ...]:
    """All effects of typical size on each channel, by some blocks (mask) of the linear model of `lin`.

    every: whether all effects that could be taken for one are sought; else the first.
    """
    some = replace(model, products=model.products * blocks[:, None, None])
    gram = some.eliminated(len(lin.nominal)).normal
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    found = []
    least = np.array([least_left(gram, probe.rows) for probe in lin.probes])
    for effect in dict.fromkeys(p.effect for p in lin.probes):
        info, probes = machine.effect(effect).parameters[0], [p for p in lin.probes if p.effect == effect]
        others = np.array([p.effect != effect for p in lin.probes])
        # the directions at the modest amplitude: of each channel where their sizes scale, else of the typical probe
        scaled = next((probe for probe in probes if probe.scaled), None)
        if scaled is not None and scaled.parameters[scaled.scaled[0]].channels != ("",):
            channels = [scaled.parameters[k].channels[0] for k in scaled.scaled]
            typical = [(int(r), scaled, k, c) for r, k, c in zip(scaled.rows, scaled.scaled, channels, strict=True)]
        else:
            probe = min(probes, key=lambda p: abs(p.x[0] - p.parameters[0].start))
            typical = [(int(probe.rows[0]), probe, 0, "")]
        for row, probe, k, channel in typical:
            parameter, x = probe.parameters[k], float(probe.x[k])
            seen, most = float(size[row]), max(SEEN, LAW * float(size[row]))
            near = np.flatnonzero(others & (least[:, row] < most)) if seen >= SEEN else []
            rivals = [lin.probes[i] for i in sorted(near, key=lambda i: least[i, row])]
            smallest = float("nan")
            if probe.scaled and seen > 0.0:  # no weaker than plausible
                ends = [parameter.coordinate(end) for end in (info.low, info.high)]
                weakest = min(map(abs, ends)) if ends[0] * ends[1] > 0.0 else 0.0
                smallest = parameter.value(float(np.copysign(max(abs(x) * SEEN / seen, weakest), x)))
            taken = mistaken_for(gram, row, rivals, most, every)
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


def mistaken_for(gram: np.ndarray, row: int, probes: Sequence[Probe], most: float, every: bool) -> dict[str, float]:
    """Effects that leave less than `most` [standard deviations] of a direction -> share left, least first."""
    left: dict[str, float] = {}
    for probe in probes:
        low, high = (probe.low, probe.high) if probe.scaled else (np.array([STRETCH[0]]), np.array([STRETCH[1]]))
        _, gain = bounded(gram[np.ix_(probe.rows, probe.rows)], -gram[probe.rows, row], low, high)
        rest = float(np.sqrt(max(gram[row, row] + 2.0 * gain, 0.0)))
        if rest < most:
            left[probe.effect] = min(left.get(probe.effect, 1.0), rest / float(np.sqrt(gram[row, row])))
            if not every:
                break
    return dict(sorted(left.items(), key=lambda item: item[1]))
