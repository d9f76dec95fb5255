"""Candidates for the missing law: a form at a point with its knots, its basis and its plausible size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.core.machine import Machine
from exodrake.diagnosis.discovery.effect_text import KNOTS, SIZE, WEIGHTS
from exodrake.diagnosis.discovery.forms import CURVE, HYSTERESIS, PLACE, RELAXATION, Form, LawPoint
from exodrake.diagnosis.discovery.watch import Seen, places
from exodrake.diagnosis.problem import Problem

MODES = 3  # of a law's basis with which it is screened
LENGTH = 0.4  # correlation length of a curve in its range: assumed
FINE = 40.0  # range over the width near 0 in which knots lie close: assumed
REACHES = (0.01, 0.6)  # of hysteresis, smallest and largest in ranges of the variable: assumed
MODEST = 0.05  # size of a law in the range of its point's value: small against curvature, large against rounding
FRAMES = 2.0  # shortest memory


@dataclass(frozen=True, eq=False)
class CandidateLaw:
    """A candidate for the missing law: a form at a point.

    Attributes:
        law: its point.
        number: of the form, from 1.
        channels: names.
        knots: (channels, 8) of the curve, reaches of hysteresis [unit of u] or time constants [s].
        size: (channels,) plausible weight.
        basis: (8, 8) weights of the modes in units of size, largest prior variance first.
        seen: where its variable goes.
    """

    law: LawPoint
    number: int
    channels: tuple[str, ...]
    knots: np.ndarray
    size: np.ndarray
    basis: np.ndarray
    seen: Seen

    @property
    def form(self) -> Form:
        """Its form."""
        return self.law.forms[self.number - 1]

    @property
    def name(self) -> str:
        """Id of the effect and its form in words."""
        return f"{self.law.learned}: {self.form.words}"

    def weights(self, modes: np.ndarray) -> np.ndarray:
        """Weights (channels, 8) for coordinates (channels, 8) of the modes."""
        return self.size[:, None] * (modes @ self.basis.T)

    def put(self, machine: Machine, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Flat parameter vector with the law in it; weights (channels, 8): a channel with zeros alone is without."""
        out, on = values.copy(), np.any(weights != 0.0, axis=1)
        out[places(machine, self.law.identity, "form")] = np.where(on, float(self.number), 0.0)
        for i in range(SIZE):
            out[places(machine, self.law.identity, KNOTS[i])] = self.knots[:, i]
            out[places(machine, self.law.identity, WEIGHTS[i])] = weights[:, i]
        return out

    def directions(self, channels: Sequence[int], modes: int) -> np.ndarray:
        """Coordinates (directions, channels, 8) of one mode of one channel each."""
        found = np.zeros((len(channels) * modes, len(self.channels), SIZE))
        for i, channel in enumerate(channels):
            for m in range(modes):
                found[i * modes + m, channel, m] = 1.0
        return found

    def shape(self) -> tuple[np.ndarray, np.ndarray]:
        """Curves of the law: abscissas (channels, points), and values per weight (channels, points, 8).

        A curve at its knots; hysteresis as the first loading from rest; relaxation as the answer to a step.
        """
        if self.form.kind in (CURVE, PLACE):
            return self.knots, np.tile(np.eye(SIZE), (len(self.knots), 1, 1))
        at = np.concatenate([np.zeros((len(self.knots), 1)), self.knots], axis=1)
        ratio = at[:, :, None] / self.knots[:, None, :]
        return at, np.minimum(ratio, 1.0) if self.form.kind == HYSTERESIS else np.exp(-ratio)


def candidates(problem: Problem, laws: Sequence[LawPoint], seen: dict[tuple[str, int], Seen]) -> list[CandidateLaw]:
    """All laws that may be missing on a machine."""
    machine = problem.robot.machine
    longest = max(len(trial.reference) for trial in problem.fit) * machine.frame
    found = []
    for law in laws:
        channels, value = machine.axes.of(law.point.axis), seen.get((law.identity, len(law.forms) + 1))
        for k, form in enumerate(law.forms, 1):
            here = seen.get((law.identity, k))
            if here is None or value is None:
                continue
            knots = knots_of(form, here, machine.frame, longest)
            size = MODEST * sizes(form, here, value)
            found.append(CandidateLaw(law, k, channels, knots, size, basis_of(form), here))
    return found


def knots_of(form: Form, seen: Seen, frame: float, longest: float) -> np.ndarray:
    """Knots (channels, 8) of a law."""
    if form.kind == RELAXATION:
        return np.tile(np.geomspace(FRAMES * frame, 0.5 * longest, SIZE), (len(seen.low), 1))
    span = np.maximum(seen.span, 1e-6 * np.maximum(1.0, abs(seen.low)))
    if form.kind == HYSTERESIS:
        return span[:, None] * np.geomspace(*REACHES, SIZE)
    if not form.fine:
        return np.linspace(seen.low, seen.low + span, SIZE).T
    near = span / FINE
    ends = np.arcsinh(seen.low / near), np.arcsinh((seen.low + span) / near)
    return (near * np.sinh(np.linspace(*ends, SIZE))).T


def sizes(form: Form, seen: Seen, value: Seen) -> np.ndarray:
    """Scale of a law's weights (channels,): range of the value that passes, over that of the factor."""
    scale = np.maximum(value.span, 0.5 * np.maximum(abs(value.low), abs(value.high)))
    scale = np.maximum(scale, 0.1 * max(float(scale.max()), 1e-6))
    if form.kind == RELAXATION:
        return scale / np.maximum(seen.span, 1e-9)
    relative = form.factor not in ("", "-1.0") and form.factor.isidentifier()
    return np.ones(len(scale)) if relative else scale


def basis_of(form: Form) -> np.ndarray:
    """Modes (8, 8) of the prior of the weights: smooth curves (a Gaussian process), or independent elements."""
    if form.kind not in (CURVE, PLACE):
        return np.eye(SIZE)[:, [1, 3, 5, 7, 0, 2, 4, 6]]
    apart = abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE))) / (SIZE - 1) / LENGTH
    covariance = 1.0 + (1.0 + np.sqrt(3.0) * apart) * np.exp(-np.sqrt(3.0) * apart)  # a constant, and Matern 3/2
    values, vectors = np.linalg.eigh(covariance)
    order = np.argsort(-values)
    return vectors[:, order] * np.sqrt(values[order])
