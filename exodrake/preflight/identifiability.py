"""Identifiability: the effects that the motion of a case could show, and those that it could not tell apart.

The case counts as a planned experiment: the logs that the nominal robot would give, with every signal in them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.machine import Column, Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.likelihood import duration, output_error
from exodrake.diagnosis.linearise import linearise
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.preflight.directions import SEEN, Direction, directions, model_of


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
    problem = planned(whole)
    machine = problem.robot.machine
    effects = [effect for effect in machine.effects if effect.id in problem.tried]
    nominal, values = nominal_parameters(problem.robot), problem.silent()
    progress(f"simulating {len(effects)} effects")
    lin = linearise(output_error(problem), values, np.zeros(len(nominal)), nominal, effects)
    progress("telling the effects apart")
    times, kinds = duration(whole) / duration(problem), np.array(problem.kinds)
    known = list(dict.fromkeys(problem.kinds))
    samples = [np.concatenate([np.tile(kinds == k, len(trial.measured)) for trial in problem.fit]) for k in known]
    model = model_of(lin, machine, samples, times)
    own = [kind for kind in known if not kind.startswith(EXTRA)]

    def with_kinds(some: Sequence[str], every: bool = False) -> Identifiability:
        return Identifiability(directions(lin, machine, model, np.isin(known, some), every))

    found = with_kinds(own, every=True)
    sensors = []
    for kind in (kind for kind in known if kind.startswith(EXTRA)):
        better, signal = with_kinds([*own, kind]), machine.signal[machine.column(kind).signal]
        noise = float(problem.noise_std[kinds == kind].max())
        sensors.append(Sensor(signal.name, signal.unit, noise, len(better.hidden), len(better.mistaken)))
    helpful = [s for s in sensors if s.hidden + s.mistaken < len(found.hidden) + len(found.mistaken)]
    best = tuple(sorted(helpful, key=lambda s: (s.hidden + s.mistaken, s.hidden)))
    fewer = []
    for some in sets_of(own, machine):
        left = with_kinds(some)
        clear = {d.effect for d in left.clear}
        lost = tuple(dict.fromkeys(d.effect for d in found.clear if d.effect not in clear))
        fewer.append(Fewer(some, left, lost))
    return replace(found, sensors=best, fewer=tuple(fewer))


def sets_of(kinds: Sequence[str], machine: Machine) -> tuple[tuple[str, ...], ...]:
    """Kinds of columns with one kind of sensor less, and with each alone; none for a log with one kind.

    A command that is logged is no sensor, and stays.
    """
    observer = machine.observer
    sensors = [kind for kind in kinds if observer is None or kind != observer.measured_input]
    sets = [tuple(k for k in kinds if k != kind) for kind in sensors]
    sets += [tuple(k for k in kinds if k == kind or k not in sensors) for kind in sensors]
    return tuple(dict.fromkeys(sets)) if len(sensors) > 1 else ()


FRAMES = 1500  # of the case that are simulated for each direction; they stand for all, so that a check takes seconds
SENSOR = 5e-4  # noise of a sensor not there yet, as a share of its signal's span: assumed, an encoder of 12 bits
EXTRA = "also"  # kind of the columns of such sensors


def planned(problem: Problem) -> Problem:
    """The problem as an experiment: logs that the nominal robot would give, with every signal in them."""
    machine, noise = problem.robot.machine, sensor_noise_std(problem.robot)
    shown = {c.signal for c in machine.columns if any(col.startswith(f"{c.kind}_") for col in problem.columns)}
    written = {name for part in machine.parts for output in part.outputs for name in output.writes}
    more = [s for s in machine.signals if s.name in written - shown]
    extra = tuple(Column(EXTRA + s.name.replace("_", ""), s.name, required=False) for s in more)
    wide = replace(machine, columns=machine.columns + extra, nominal=None)
    names = machine.log_names(extra)
    short = problem.shortened(min(1.0, FRAMES / sum(len(t.reference) for t in problem.fit)))
    every = replace(short, robot=replace(problem.robot, machine=wide), columns=(*problem.columns, *names), holdout=())
    values, trials = every.silent(), []
    for trial in short.fit:
        (logged,) = every.predict(values[None], trial)
        logged[:, : len(problem.columns)][np.isnan(trial.measured)] = np.nan
        trials.append(replace(trial, measured=logged))
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
