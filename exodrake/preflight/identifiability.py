"""Identifiability: the effects that the motion of a case could show, and those that it could not tell apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.linearise import Linearisation, linearise
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.preflight.directions import SEEN, Direction, directions
from exodrake.preflight.planned import EXTRA, mask_of, planned


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


def identifiability(case: Case, robot: Robot, tried: frozenset[str] | None = None) -> Identifiability:
    """Identifiability of effects from the references of a case, whatever its measured values are.

    Args:
        case: references and columns.
        robot: nominal robot.
        tried: ids of effects; those of a diagnosis by default.
    """
    problem = planned(make_problem(case, robot, tried))
    machine = problem.robot.machine
    effects = [effect for effect in machine.effects if effect.id in problem.tried]
    nominal, values = nominal_parameters(problem.robot), problem.silent()
    likelihood = output_error(problem)
    lin = linearise(likelihood, values, np.zeros(len(nominal)), nominal, effects)
    own = np.array([not column.startswith(EXTRA) for column in problem.columns])
    groups = {column.rsplit("_", 1)[0]: None for column in problem.columns if column.startswith(EXTRA)}
    found = Identifiability(directions(lin, machine, mask_of(problem, own)))
    sensors = []
    for kind in groups:
        extra = np.array([column.rsplit("_", 1)[0] == kind for column in problem.columns])
        better = Identifiability(directions(lin, machine, mask_of(problem, own | extra)))
        signal = machine.signal[machine.column(kind).signal]
        hidden, mistaken = len(better.hidden), len(better.mistaken)
        noise = float(problem.noise_std[extra].max())
        sensors.append(Sensor(signal.name, signal.unit, noise, hidden, mistaken))
    helpful = [s for s in sensors if s.hidden + s.mistaken < len(found.hidden) + len(found.mistaken)]
    best = tuple(sorted(helpful, key=lambda s: (s.hidden + s.mistaken, s.hidden)))
    return replace(found, sensors=best, fewer=fewer(problem, lin, found))


def fewer(problem: Problem, lin: Linearisation, found: Identifiability) -> tuple[Fewer, ...]:
    """Identifiability with one kind of sensor less, and with each alone; none for a log with one kind.

    A command that is logged is no sensor, and stays.
    """
    kinds = tuple(dict.fromkeys(kind for kind in problem.kinds if not kind.startswith(EXTRA)))
    observer = problem.robot.machine.observer
    sensors = [kind for kind in kinds if observer is None or kind != observer.measured_input]
    sets = [tuple(k for k in kinds if k != kind) for kind in sensors]
    sets += [tuple(k for k in kinds if k == kind or k not in sensors) for kind in sensors]
    if len(sensors) < 2:
        return ()
    return tuple(with_kinds(problem, lin, found, some) for some in dict.fromkeys(sets))


def with_kinds(problem: Problem, lin: Linearisation, found: Identifiability, kinds: tuple[str, ...]) -> Fewer:
    """Identifiability with some kinds of columns alone."""
    mask = mask_of(problem, np.isin(problem.kinds, kinds))
    left = Identifiability(directions(lin, problem.robot.machine, mask))
    clear = {d.effect for d in left.clear}
    return Fewer(kinds, left, tuple(dict.fromkeys(d.effect for d in found.clear if d.effect not in clear)))
