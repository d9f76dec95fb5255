"""Directions: how an effect of typical size changes the logs, and which effects could be taken for it.

An effect of typical size changes the logs by a direction d, in noise standard deviations and with the nominal
parameters free within their tolerances. It is seen where |d| exceeds `SEEN`. Another effect can be taken for it where
its own directions D, scaled within their ranges, leave less than the noise or the error rho of a law does (`LAW`):

    left = min_f | d - D f |          taken for it: left < max(SEEN, rho |d|)

As in a diagnosis, samples within the correlation time of a model's error count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from exodrake.core.effect import EffectParameter
from exodrake.core.machine import Machine
from exodrake.diagnosis.fit import bounded
from exodrake.diagnosis.likelihood import CORRELATION
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.search import LAW

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


def model_of(lin: Linearisation, machine: Machine, samples: Sequence[np.ndarray], times: float = 1.0) -> LinearModel:
    """The linear model of nominal parameters and, last, directions, about logs of the nominal robot.

    Args:
        lin: derivatives and directions.
        machine: whose frame says how many samples count as one.
        samples: masks (samples,) of the blocks.
        times: how often a log of this kind is there.
    """
    rows = np.concatenate([lin.jacobian, lin.directions, np.zeros((1, lin.directions.shape[1]))], dtype=np.float32)
    ends = np.cumsum([0, *(mask.sum() for mask in samples)])
    blocks = [(0, 0, slice(int(a), int(b))) for a, b in pairwise(ends)]
    width, free = len(lin.directions), np.full(len(rows) - 1, np.inf)
    precision = np.r_[[p.prior_std**-2.0 for p in lin.nominal], np.zeros(width)]
    memory = max(CORRELATION / machine.frame, 1.0) / times
    order = np.concatenate([np.flatnonzero(mask) for mask in samples])
    return LinearModel.of_rows(rows[:, order], blocks, (np.zeros(len(free)), precision, -free, free), memory)


def directions(
    lin: Linearisation, machine: Machine, model: LinearModel, blocks: np.ndarray, every: bool = True
) -> tuple[Direction, ...]:
    """All effects of typical size on each channel.

    Args:
        lin: derivatives and directions.
        machine: with its effects.
        model: their linear model.
        blocks: mask of the blocks that count.
        every: whether all effects that could be taken for one are sought; else the first.
    """
    some = replace(model, products=model.products * blocks[:, None, None])
    gram = some.eliminated(len(lin.nominal)).normal
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    shown = []
    least = np.array([least_left(gram, probe.rows) for probe in lin.probes])
    for effect in dict.fromkeys(p.effect for p in lin.probes):
        info = machine.effect(effect)
        others = np.array([p.effect != effect for p in lin.probes])
        for typical in typical_rows([p for p in lin.probes if p.effect == effect]):
            row, lead = typical.row, info.parameters[0]
            seen, most = float(size[row]), max(SEEN, LAW * float(size[row]))
            near = np.flatnonzero(others & (least[:, row] < most)) if seen >= SEEN else []
            rivals = [lin.probes[k] for k in sorted(near, key=lambda k: least[k, row])]
            taken = mistaken_for(gram, row, rivals, most, every)
            weakest = smallest(typical, lead, seen)
            shown.append(Direction(effect, typical.channel, lead.unit, typical.value, seen, weakest, taken))
    return tuple(shown)


def least_left(gram: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """What any sizes of some directions leave of each (directions,) [standard deviations]; 0 if rounding hides it."""
    size = np.sqrt(np.maximum(np.diag(gram)[rows], 1e-12))
    normal = gram[np.ix_(rows, rows)] / np.outer(size, size) + 1e-8 * np.eye(len(rows))
    if np.linalg.eigvalsh(normal)[0] <= 0.0:
        return np.zeros(len(gram))
    cross = gram[rows] / size[:, None]
    return np.sqrt(np.maximum(np.diag(gram) - np.sum(cross * np.linalg.solve(normal, cross), axis=0), 0.0))


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
