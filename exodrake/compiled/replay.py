"""Replay of a machine between measured signals: fixed segments take what was measured, the others are simulated.

The generated function `replay` runs frames as `run` does, with the same arithmetic (`compiled.leaf_functions`). While a
segment is fixed, the signals that it declares (`core.segment`) carry its measured output, so that no error of that
segment reaches the others. The function goes on from the state that it is given, so that a log may come in parts.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType

import numpy as np

from exodrake.compiled.compose import compile_machine, load_text
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows, reference_width
from exodrake.compiled.replay_code import print_replay
from exodrake.core.machine import Machine, signal_count, state_size
from exodrake.core.once import once


class Replay:
    """A machine stepped frame by frame with some of its segments fixed.

    Attributes:
        state: flat state; `step` advances it in place.
        signals: flat vector of all signals after the last frame.
    """

    def __init__(self, machine: Machine, values: np.ndarray, fixed: Iterable[str] = ()) -> None:
        self.machine, names = machine, set(fixed)
        self.fixed = np.array([s.name in names for s in machine.segments], dtype=bool)
        self.replay = compile_replay(machine).replay
        self.state, self.signals = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        module = compile_machine(machine)
        module.begin(values, self.state)
        none = input_rows(machine, np.zeros((0, reference_width(machine))), NoiseInputs.draw(0, None, machine))
        nothing = np.zeros((0, len(self.signals)))
        module.run(values, self.state, self.signals, *none.values(), machine.slot, 1, nothing, NOTHING, NOTHING)
        self.values = values.copy()
        for segment in machine.segments:
            for name, value in segment.parameters.items() if segment.name in names else ():
                self.values[machine.indices(name)] = value

    def step(
        self,
        inputs: Iterable[np.ndarray],
        feed: np.ndarray = NOTHING,
        rate: np.ndarray = NOTHING,
        readings: np.ndarray = NOTHING,
        targets: np.ndarray = NOTHING,
        gains: np.ndarray = NOTHING,
    ) -> np.ndarray:
        """Signals (n, signals) at the end of each of the next n frames [SI].

        Args:
            inputs: exogenous inputs in the machine's order, (n, channels) each [SI].
            feed: (n, feeds) measured outputs of all segments side by side (`feed_places`) [SI]; needed if any is fixed.
            rate: (n, feeds) their rates [SI/s].
            readings: (n, channels of all compared columns) readings put in place of simulated ones, NaN: none [SI].
            targets: (n, channels) measured output of the machine's observer, NaN: none [SI].
            gains: (n, channels) share of the difference by which the observer's state moves at a frame's end.
        """
        rows = [np.ascontiguousarray(x, dtype=float) for x in (*inputs, feed, rate, readings, targets, gains)]
        given, (feed, rate, readings, targets, gains) = rows[:-5], rows[-5:]
        record = np.empty((len(given[0]), len(self.signals)))
        self.replay(
            self.values, self.state, self.signals, *given,
            self.machine.slot, feed, rate, self.fixed, readings, targets, gains, record,
        )  # fmt: skip
        return record


def compile_replay(machine: Machine) -> ModuleType:
    """The module with the function `replay` of a machine; machine code comes from numba's cache when it can."""

    def made() -> ModuleType:
        return load_text(f"{machine.name}_replay", print_replay(machine, compile_machine(machine).__name__))

    return once(machine, "replay", made)
