"""Which effects the motion of a case could show, and which it could not tell apart, from one linearisation.

An effect of typical size changes the logs by a direction d, in noise standard deviations and with the nominal
parameters free within their tolerances. It is seen where |d| exceeds `SEEN`. Another effect can be taken for it where
its own directions D, scaled within their ranges, leave less than the noise or the error of a law (`calibration`) does:

    left = min_f | d - D f |          taken for it: left < max(SEEN, rho |d|)

As in a diagnosis, samples within the correlation time of a model's error count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.effect import EffectParameter
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.likelihood import CORRELATION, output_error
from exodrake.diagnosis.linearise import Linearisation, Probe, linearise
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.refine import bounded
from exodrake.preflight.planned import EXTRA, mask_of, planned

SEEN = 4.0  # standard deviations; that of one test among a hundred effects and channels at 0.3 % (normal law)
STRETCH = (0.0, 1.5)  # by which a direction that was simulated at one size only may be scaled: assumed


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

    @property
    def name(self) -> str:
        """Effect and channel."""
        return f"{self.effect} {self.channel}".strip()


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


def directions(lin: Linearisation, machine: Machine, samples: np.ndarray) -> tuple[Direction, ...]:
    """All effects of typical size on each channel, judged by some samples (samples,)."""
    scale = 1.0 / np.sqrt(max(CORRELATION / machine.frame, 1.0))
    jacobian = (lin.jacobian[:, samples] * scale).astype(np.float32)
    rows = lin.directions[:, samples] * np.float32(scale)
    precision = np.array([p.prior_std for p in lin.nominal]) ** -2.0
    cross = (jacobian @ rows.T).astype(float)
    normal = (jacobian @ jacobian.T).astype(float) + np.diag(precision)
    gram = (rows @ rows.T).astype(float) - (cross.T @ np.linalg.solve(normal, cross) if len(normal) else 0.0)
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    errors, found = calibration_of(machine), []
    for effect in dict.fromkeys(p.effect for p in lin.probes):
        info = machine.effect(effect)
        error = errors.same_meaning if info.same_meaning else errors.law_error
        for row, value, channel, probe, k in typical([p for p in lin.probes if p.effect == effect]):
            seen = float(size[row])
            taken = {} if seen < SEEN else mistaken_for(gram, row, effect, lin.probes, max(SEEN, error * seen))
            least = smallest(probe, k, info.parameters[0], seen)
            found.append(Direction(effect, channel, info.parameters[0].unit, value, seen, least, taken))
    return tuple(found)


def smallest(probe: Probe, k: int, info: EffectParameter, seen: float) -> float:
    """Value of the k-th parameter of a probe that could just be seen, no weaker than plausible; NaN if none scales."""
    parameter, x = probe.parameters[k], float(probe.x[k])
    if not probe.scaled or not seen > 0.0:
        return float("nan")
    ends = [parameter.coordinate(end) for end in (info.low, info.high)]
    weakest = min(map(abs, ends)) if ends[0] * ends[1] > 0.0 else 0.0
    return parameter.value(float(np.copysign(max(abs(x) * SEEN / seen, weakest), x)))


def typical(probes: list[Probe]) -> list[tuple[int, float, str, Probe, int]]:
    """Row, value, channel, probe and parameter of each direction of an effect at its modest amplitude."""
    scaled = next((probe for probe in probes if probe.scaled), None)
    if scaled is not None and scaled.parameters[scaled.scaled[0]].channels != ("",):
        return [
            (int(row), scaled.parameters[k].value(scaled.x[k]), scaled.parameters[k].channels[0], scaled, k)
            for row, k in zip(scaled.rows, scaled.scaled, strict=True)
        ]
    probe = min(probes, key=lambda p: abs(p.x[0] - p.parameters[0].start))
    return [(int(probe.rows[0]), probe.parameters[0].value(probe.x[0]), "", probe, 0)]


def mistaken_for(gram: np.ndarray, row: int, effect: str, probes: Sequence[Probe], most: float) -> dict[str, float]:
    """Effects that leave less than `most` [standard deviations] of a direction -> share left, least first."""
    left: dict[str, float] = {}
    for probe in probes:
        if probe.effect == effect:
            continue
        low, high = (probe.low, probe.high) if probe.scaled else (np.array([STRETCH[0]]), np.array([STRETCH[1]]))
        _, gain = bounded(gram[np.ix_(probe.rows, probe.rows)], -gram[probe.rows, row], low, high)
        rest = float(np.sqrt(max(gram[row, row] + 2.0 * gain, 0.0)))
        if rest < most:
            left[probe.effect] = min(left.get(probe.effect, 1.0), rest / float(np.sqrt(gram[row, row])))
    return dict(sorted(left.items(), key=lambda item: item[1]))
