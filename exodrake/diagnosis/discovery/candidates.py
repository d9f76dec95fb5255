"""Candidates for the missing law: a form at a point with its knots, its basis and its plausible size.

Where the variable of a law goes is measured by watches, effects that count in the simulated robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows
from exodrake.core.machine import Machine, signal_count, state_size
from exodrake.core.parallel import side_by_side
from exodrake.core.part import HYSTERESIS, RELAXATION, FreeLaw
from exodrake.diagnosis.discovery.law_code import COUNTS, KNOTS, SIZE, WATCHED, WEIGHTS, LawPoint
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.problem import Problem, Trial

LENGTH = 0.4  # correlation length of a curve in its range: assumed
FINE = 40.0  # range over the width near 0 in which knots lie close: assumed
REACHES = (0.01, 0.6)  # of hysteresis, smallest and largest in ranges of the variable: assumed
MODEST = 0.05  # size of a law in the range of its point's value: small against curvature, large against rounding
FRAMES = 2.0  # shortest memory
WIDE = 1e6  # bound of a coordinate: none


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate for the missing law: a form at a point.

    Attributes:
        law: its point.
        number: of the form, from 1.
        channels: names.
        knots: (channels, 8) of the curve, reaches of hysteresis [unit of u] or time constants [s].
        size: (channels,) plausible weight.
        basis: (8, 8) weights of the modes in units of size, largest prior variance first.
        low, high: (channels,) range of its variable in the simulated logs [unit of u].
    """

    law: LawPoint
    number: int
    channels: tuple[str, ...]
    knots: np.ndarray
    size: np.ndarray
    basis: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def form(self) -> FreeLaw:
        """Its form."""
        return self.law.forms[self.number - 1]

    @property
    def name(self) -> str:
        """Id of the effect and its form in words."""
        return f"{self.law.learned}: {self.form.words}"

    def put(self, machine: Machine, values: np.ndarray, channels: Sequence[int]) -> np.ndarray:
        """Flat parameter vector with the law switched on in some channels, its weights as they were."""
        out = values.copy()
        out[np.array(indices(machine, self.law.identity, "form"))[list(channels)]] = float(self.number)
        for i, name in enumerate(KNOTS):
            out[indices(machine, self.law.identity, name)] = self.knots[:, i]
        return out

    def parameters(self, machine: Machine, scales: np.ndarray, modes: int = SIZE) -> tuple[Parameter, ...]:
        """Coordinates of the first modes in each channel; scales: (channels,) prior deviations, 0 without it."""
        places = np.array([indices(machine, self.law.identity, name) for name in WEIGHTS])
        found = []
        for c in np.flatnonzero(scales):
            along = self.size[c] * self.basis
            for m in range(modes):
                name, index, ends = f"mode{m + 1}.{self.channels[c]}", tuple(map(int, places[:, c])), (-WIDE, WIDE)
                move, std = tuple(map(float, along[:, m])), float(scales[c])
                found.append(Parameter(name, index, "along", 0.0, std, ends, "", (self.channels[c],), along=move))
        return tuple(found)

    def shape(self) -> tuple[np.ndarray, np.ndarray]:
        """Curves of the law: abscissas (channels, points), and values per weight (channels, points, 8).

        A curve at its knots; hysteresis as the first loading from rest; relaxation as the answer to a step.
        """
        if self.form.is_curve:
            return self.knots, np.tile(np.eye(SIZE), (len(self.knots), 1, 1))
        at = np.concatenate([np.zeros((len(self.knots), 1)), self.knots], axis=1)
        ratio = at[:, :, None] / self.knots[:, None, :]
        return at, np.minimum(ratio, 1.0) if self.form.kind == HYSTERESIS else np.exp(-ratio)


def candidates(problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]) -> list[Candidate]:
    """All laws that may be missing at some points of a machine.

    Args:
        problem: the case, its robot on a machine with laws and watches.
        values: (parameters,) flat vector of the robot that runs.
        laws: points.
    """
    machine, seen = problem.robot.machine, watched(problem, values, laws)
    longest, found = max(len(trial.reference) for trial in problem.fit) * machine.frame, []
    for law in laws:
        for k, form in enumerate(law.forms, 1):
            here, value = seen.get((law.identity, k)), seen.get((law.identity, len(law.forms) + 1))
            if here is not None and value is not None:
                knots, size = knots_of(form, *here, machine.frame, longest), sizes(form, here, value)
                channels = machine.axes.of(law.point.axis)
                found.append(Candidate(law, k, channels, knots, MODEST * size, basis_of(form), *here))
    return found


def knots_of(form: FreeLaw, low: np.ndarray, high: np.ndarray, frame: float, longest: float) -> np.ndarray:
    """Knots (channels, 8) of a law."""
    if form.kind == RELAXATION:
        return np.tile(np.geomspace(FRAMES * frame, 0.5 * longest, SIZE), (len(low), 1))
    span = np.maximum(high - low, 1e-6 * np.maximum(1.0, abs(low)))
    if form.kind == HYSTERESIS:
        return span[:, None] * np.geomspace(*REACHES, SIZE)
    if not form.fine:
        return np.linspace(low, low + span, SIZE).T
    near = span / FINE
    ends = np.arcsinh(low / near), np.arcsinh((low + span) / near)
    return (near * np.sinh(np.linspace(*ends, SIZE))).T


def sizes(form: FreeLaw, seen: tuple[np.ndarray, np.ndarray], value: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Scale of a law's weights (channels,): range of the value that passes, over that of the factor."""
    scale = np.maximum(value[1] - value[0], 0.5 * np.maximum(abs(value[0]), abs(value[1])))
    scale = np.maximum(scale, 0.1 * max(float(scale.max()), 1e-6))
    if form.kind == RELAXATION:
        return scale / np.maximum(seen[1] - seen[0], 1e-9)
    relative = form.factor not in ("", "-1.0") and form.factor.isidentifier()
    return np.ones(len(scale)) if relative else scale


def basis_of(form: FreeLaw) -> np.ndarray:
    """Modes (8, 8) of the prior of the weights: smooth curves (a Gaussian process), or independent elements."""
    if not form.is_curve:
        return np.eye(SIZE)[:, [1, 3, 5, 7, 0, 2, 4, 6]]
    apart = abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE))) / (SIZE - 1) / LENGTH
    covariance = 1.0 + (1.0 + np.sqrt(3.0) * apart) * np.exp(-np.sqrt(3.0) * apart)  # a constant, and Matern 3/2
    values, vectors = np.linalg.eigh(covariance)
    order = np.argsort(-values)
    return vectors[:, order] * np.sqrt(values[order])


def indices(machine: Machine, identity: str, name: str) -> list[int]:
    """Indices (channels,) of a parameter of an effect in the flat parameter vector."""
    return list(machine.effect_indices(identity, name).values())


def state_places(machine: Machine, identity: str) -> dict[str, np.ndarray]:
    """Indices (channels,) of each state of an effect in the flat state."""
    at = 0
    for part in machine.parts:
        at += machine.part_size(part)[0]
        for effect in machine.effects_on(part):
            found = {}
            for state in effect.states:
                width = machine.width(state.axis)
                found[state.name] = np.arange(at, at + width)
                at += width * state.width
            if effect.id == identity:
                return found
    raise KeyError(identity)


def end_states(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Flat states (trials, n) at the ends of all fitted trials, which a robot runs in closed loop without noise."""
    machine = problem.robot.machine
    module = compile_machine(machine)

    def end_state(trial: Trial) -> np.ndarray:
        n, state, w = len(trial.reference), np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        noise = NoiseInputs.draw(n, None, machine)
        noise |= {name: given[:n] for name, given in trial.latent.items()}
        module.begin(values, state)
        given = input_rows(machine, trial.reference, noise).values()
        module.run(values, state, w, *given, machine.slot, 1, np.zeros((n, len(w))), NOTHING, NOTHING)
        return state

    return np.array(side_by_side([partial(end_state, trial) for trial in problem.fit]))


def watched(
    problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]
) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """Range (channels,), (channels,) of the variable of each form of each law that is ever computed.

    One number above all forms stands for what is as large as the law. Arguments are those of `candidates`.
    """
    found, machine = {}, problem.robot.machine
    for k in range(1, max((len(law.forms) for law in laws), default=-1) + 2):
        here, row = [law for law in laws if k <= len(law.forms) + 1], values.copy()
        for law in here:
            row[indices(machine, f"{law.identity}_watch", "form")] = k
        states = end_states(problem, row)
        for law in here:
            at = state_places(machine, f"{law.identity}_watch")
            low, high = states[:, at["low_seen"]].min(axis=0), states[:, at["high_seen"]].max(axis=0)
            if np.any(states[:, at["started"]]):
                found[law.identity, k] = low, np.where(high > low, high, low + 1e-9)
    return found


def counted(problem: Problem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Histogram (channels, bins) of the variable of a law over its range; other arguments are those of `candidates`."""
    machine, row, watch = problem.robot.machine, values.copy(), f"{candidate.law.identity}_watch"
    each = zip(("form", *WATCHED), (candidate.number, candidate.low, candidate.high), strict=True)
    for name, value in each:
        row[indices(machine, watch, name)] = value
    at, states = state_places(machine, watch), end_states(problem, row)
    return np.array([states[:, at[c]].sum(axis=0) for c in COUNTS]).T
