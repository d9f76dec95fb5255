"""Directions: how an effect of typical size changes the logs, and which effects could be taken for it.

An effect of typical size changes the logs by a direction d, in noise standard deviations and with the nominal
parameters free within their tolerances. It is seen where |d| exceeds `SEEN`. Another effect can be taken for it where
its own directions D, scaled within their ranges, leave less than the noise or the error of a law (`calibration`) does:

    left = min_f | d - D f |          taken for it: left < max(SEEN, rho |d|)

As in a diagnosis, samples within the correlation time of a model's error count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.core.effect import EffectParameter
from exodrake.core.machine import Machine
from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.likelihood import CORRELATION
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.refine import bounded

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
class TypicalRow:
    """A direction of a linearisation at an effect's typical size.

    Attributes:
        row: position among the directions.
        parameter: that sets the size.
        x: its coordinate.
        channel: "" for an effect of the whole robot.
        scales: whether other sizes change the logs in proportion.
    """

    row: int
    parameter: Parameter
    x: float
    channel: str
    scales: bool

    @property
    def value(self) -> float:
        """Value of the parameter [its unit]."""
        return self.parameter.value(self.x)


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
        for typical in typical_rows([p for p in lin.probes if p.effect == effect]):
            row, lead = typical.row, info.parameters[0]
            seen = float(size[row])
            taken = {} if seen < SEEN else mistaken_for(gram, row, effect, lin.probes, max(SEEN, error * seen))
            least = smallest(typical, lead, seen)
            found.append(Direction(effect, typical.channel, lead.unit, typical.value, seen, least, taken))
    return tuple(found)


def smallest(typical: TypicalRow, info: EffectParameter, seen: float) -> float:
    """Value of the parameter of a row that could just be seen, no weaker than plausible; NaN where it does not scale.

    Args:
        typical: row with its size.
        info: the parameter in the library.
        seen: how far the row changes the logs [standard deviations].
    """
    parameter, x = typical.parameter, typical.x
    if not typical.scales or not seen > 0.0:
        return float("nan")
    ends = [parameter.coordinate(end) for end in (info.low, info.high)]
    weakest = min(map(abs, ends)) if ends[0] * ends[1] > 0.0 else 0.0
    return parameter.value(float(np.copysign(max(abs(x) * SEEN / seen, weakest), x)))


def typical_rows(probes: list[Probe]) -> list[TypicalRow]:
    """The directions of an effect at its modest amplitude."""
    scaled = next((probe for probe in probes if probe.scaled), None)
    if scaled is not None and scaled.parameters[scaled.scaled[0]].channels != ("",):
        return [
            TypicalRow(int(row), scaled.parameters[k], float(scaled.x[k]), scaled.parameters[k].channels[0], True)
            for row, k in zip(scaled.rows, scaled.scaled, strict=True)
        ]
    probe = min(probes, key=lambda p: abs(p.x[0] - p.parameters[0].start))
    return [TypicalRow(int(probe.rows[0]), probe.parameters[0], float(probe.x[0]), "", bool(probe.scaled))]


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
