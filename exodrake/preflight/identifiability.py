"""Identifiability: the effects that the motion of a case could show, and those that it could not tell apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.likelihood import duration, output_error
from exodrake.diagnosis.linearise import linearise
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import make_problem
from exodrake.preflight.directions import SEEN, Direction, directions, model_of
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
    model = model_of(lin, machine, [mask_of(problem, kinds == k) for k in known], times)
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
