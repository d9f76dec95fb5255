"""Rows of the exogenous signals of a run, one a frame: references as given, noise drawn without end."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from exodrake.compiled.inputs import NoiseInputs
from exodrake.core.machine import Machine

NO_NOISE = -1.0  # the seed of a run without noise


class Exogenous:
    """Exogenous signals that a Diagram makes itself.

    Attributes:
        signals: name -> place in a row.
        seed: of the noise; NO_NOISE without.
    """

    def __init__(self, machine: Machine, rows: Mapping[str, np.ndarray], drawn: tuple[str, ...], seed: int | None):
        """Takes rows of signals, (frames, channels) arrays [SI], of which the last stays; `drawn`: noise inputs."""
        self.machine, self.rows, self.seed = machine, rows, NO_NOISE if seed is None else float(seed)
        self.signals, at = {}, 0
        for name in (name for name in machine.inputs if name in rows or name in drawn):
            width = len(machine.channels(name))
            self.signals[name], at = slice(at, at + width), at + width
        self.width = at
        self._table = self.seed, np.zeros((0, at))

    def row(self, seed: float, frame: int) -> np.ndarray:
        """The row of a frame under a seed, (channels,) [SI]."""
        drawn, table = self._table
        if drawn != seed or frame >= len(table):
            given = max((len(rows) for rows in self.rows.values()), default=1)
            frames = max(given, 2 * len(table) if drawn == seed else 0, frame + 1)
            table = np.hstack([np.zeros((frames, 0)), *self._columns(seed, frames)])
            self._table = seed, table
        return table[frame]

    def _columns(self, seed: float, frames: int) -> list[np.ndarray]:
        """Rows of each signal, (frames, channels)."""
        noise = NoiseInputs.draw(frames, None if seed < 0.0 else int(seed), self.machine)
        at = np.arange(frames)
        return [
            self.rows[name][np.minimum(at, len(self.rows[name]) - 1)] if name in self.rows else noise[name]
            for name in self.signals
        ]
