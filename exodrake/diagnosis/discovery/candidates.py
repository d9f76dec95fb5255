"""Candidates for the missing law: a form at a point with its knots, its basis and its plausible size.

Where the variable of a law goes is measured by watches, effects that count in the simulated robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows
from exodrake.core.machine import signal_count, stack, state_size
from exodrake.core.parallel import side_by_side
from exodrake.core.part import HYSTERESIS, RELAXATION, FreeLaw
from exodrake.diagnosis.discovery.law_code import SIZE, LawPoint
from exodrake.diagnosis.problem import Problem, Trial

LENGTH = 0.4  # correlation length of a curve in its range: assumed
FINE = 40.0  # range over the width near 0 in which knots lie close: assumed
REACHES = (0.01, 0.6)  # of hysteresis, smallest and largest in ranges of the variable: assumed
MODEST = 0.05  # size of a law in the range of its point's value: small against curvature, large against rounding
FRAMES = 2.0  # shortest memory


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate for the missing law: a form at a point."""

    law: LawPoint
    number: int  # of the form, from 1
    channels: tuple[str, ...]
    knots: np.ndarray  # (channels, 8) of the curve, reaches of hysteresis [unit of u] or time constants [s]
    size: np.ndarray  # (channels,) plausible weight
    basis: np.ndarray  # (8, 8) weights of the modes in units of size, largest prior variance first
    low: np.ndarray  # (channels,) lowest value of its variable in the simulated logs [unit of u]
    high: np.ndarray  # (channels,) highest value [unit of u]

    @property
    def form(self) -> FreeLaw:
        """Its form."""
        return self.law.forms[self.number - 1]

    @property
    def name(self) -> str:
        """Id of the effect and its form in words."""
        return f"{self.law.learned}: {self.form.words}"

    def shape(self) -> tuple[np.ndarray, np.ndarray]:
        """Curves of the law: abscissas (channels, points), and values per weight (channels, points, 8).

        A curve at its knots; hysteresis as the first loading from rest; relaxation as the answer to a step.
        """
        if self.form.is_curve:
            return self.knots, np.tile(np.eye(SIZE), (len(self.knots), 1, 1))
        at = np.concatenate([np.zeros((len(self.knots), 1)), self.knots], axis=1)
        ratio = at[:, :, None] / self.knots[:, None, :]
        return at, np.minimum(ratio, 1.0) if self.form.kind == HYSTERESIS else np.exp(-ratio)


def run_watches(
    problem: Problem, values: np.ndarray, settings: Mapping[str, Mapping[str, float | np.ndarray]]
) -> dict[str, dict[str, np.ndarray]]:
    """States of watches at the ends of all fitted trials, which a robot runs in closed loop without noise.

    Args:
        problem: the case.
        values: (parameters,) of the robot.
        settings: id of each law to be watched -> parameters of its watch.

    Returns:
        The same id -> name of a state -> (trials, channels).
    """
    machine, row = problem.robot.machine, values.copy()
    module = compile_machine(machine)
    for identity, given in settings.items():
        for name, value in given.items():
            row[[*machine.effect_indices(f"{identity}_watch", name).values()]] = value

    def end_state(trial: Trial) -> np.ndarray:
        n, state, w = len(trial.reference), np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        noise = NoiseInputs.draw(n, None, machine)
        noise |= {name: given[:n] for name, given in trial.latent.items()}
        module.begin(row, state)
        given = input_rows(machine, trial.reference, noise).values()
        module.run(row, state, w, *given, machine.slot, 1, np.zeros((n, len(w))), NOTHING, NOTHING)
        return state

    ends = np.array(side_by_side([partial(end_state, trial) for trial in problem.fit]))
    widths: dict[tuple[str, str], int] = {}
    for part in machine.parts:
        for owner, states in ((part.name, part.states), *((e.id, e.states) for e in machine.effects_on(part))):
            widths |= {(owner, s.name): machine.width(s.axis) * s.width for s in states}
    places = stack(widths).items()
    watches = {identity: f"{identity}_watch" for identity in settings}
    return {law: {n: ends[:, at] for (owner, n), at in places if owner == watch} for law, watch in watches.items()}


def list_candidates(problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]) -> list[Candidate]:
    """All laws that may be missing at some points, where a robot `values` (parameters,) with watches runs a case."""
    machine, found = problem.robot.machine, list[Candidate]()
    longest = max(len(trial.reference) for trial in problem.fit) * machine.frame
    # of the variable of each form that is computed (channels,)
    ranges: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
    for k in range(1, max((len(law.forms) for law in laws), default=-1) + 2):  # each form, and the law's scale
        settings = {law.identity: {"form": float(k)} for law in laws if k <= len(law.forms) + 1}
        for identity, states in run_watches(problem, values, settings).items():
            if states["started"].any():
                low, high = states["low_seen"].min(axis=0), states["high_seen"].max(axis=0)
                ranges[identity, k] = low, np.where(high > low, high, low + 1e-9)
    for law, k, form in ((one, k, form) for one in laws for k, form in enumerate(one.forms, 1)):
        if not {(law.identity, k), (law.identity, len(law.forms) + 1)} <= set(ranges):
            continue
        (low, high), (least, most) = ranges[law.identity, k], ranges[law.identity, len(law.forms) + 1]
        # plausible weights: the range of the value that passes, over that of the factor
        size = np.maximum(most - least, 0.5 * np.maximum(abs(least), abs(most)))
        size = np.maximum(size, 0.1 * max(float(size.max()), 1e-6))
        span = np.maximum(high - low, 1e-6 * np.maximum(1.0, abs(low)))
        if form.kind == RELAXATION:
            knots = np.tile(np.geomspace(FRAMES * machine.frame, 0.5 * longest, SIZE), (len(low), 1))
            size = size / np.maximum(high - low, 1e-9)
        elif form.kind == HYSTERESIS:
            knots = span[:, None] * np.geomspace(*REACHES, SIZE)
        elif form.fine:
            near = span / FINE
            knots = (near * np.sinh(np.linspace(np.arcsinh(low / near), np.arcsinh((low + span) / near), SIZE))).T
        else:
            knots = np.linspace(low, low + span, SIZE).T
        if form.kind != RELAXATION and form.factor not in ("", "-1.0") and form.factor.isidentifier():
            size = np.ones(len(size))
        # modes of the prior of the weights: smooth curves (a Gaussian process), or independent elements
        basis = np.eye(SIZE)[:, [1, 3, 5, 7, 0, 2, 4, 6]]
        if form.is_curve:
            apart = np.sqrt(3.0) * abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE))) / (SIZE - 1) / LENGTH
            variances, vectors = np.linalg.eigh(1.0 + (1.0 + apart) * np.exp(-apart))  # a constant, and Matern 3/2
            basis = (vectors * np.sqrt(variances))[:, ::-1]
        found.append(Candidate(law, k, machine.axes.of(law.point.axis), knots, MODEST * size, basis, low, high))
    return found
