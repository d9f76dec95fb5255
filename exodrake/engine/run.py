"""Runs of the compiled simulator: of a whole machine, and replays between measured signals."""

from collections.abc import Iterable

import numpy as np

from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import NOTHING, UNIMPOSED, NoiseInputs, Reference, input_rows, reference_width
from exodrake.model.machine import Machine, signal_count, state_size


def run_compiled(
    machine: Machine, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int
) -> np.ndarray:
    """All signals (frames, channels) at each frame's end, by the compiled simulator."""
    module = compile_machine(machine)
    rows = np.zeros((len(reference.values), signal_count(machine)))
    state, w = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
    module.begin(values, state)
    given = input_rows(machine, reference.values, noise_inputs).values()
    module.run(values, state, w, *given, machine.slot / substeps, substeps, rows, NOTHING, NOTHING, *UNIMPOSED)
    return rows


class Replay:
    """A machine stepped frame by frame, whose fixed segments take what was measured; logs may come in parts."""

    def __init__(self, machine: Machine, values: np.ndarray, fixed: Iterable[str] = ()) -> None:
        self.machine, names, module = machine, set(fixed), compile_machine(machine)
        self.fixed = np.array([s.name in names for s in machine.segments], dtype=bool)
        self.run = module.run
        self.state, self.signals = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        module.begin(values, self.state)
        none = input_rows(machine, np.zeros((0, reference_width(machine))), NoiseInputs.draw(0, None, machine))
        nothing = np.zeros((0, len(self.signals)))
        rows = (*none.values(), machine.slot, 1, nothing, NOTHING, NOTHING)
        self.run(values, self.state, self.signals, *rows, *UNIMPOSED)
        self.values = values.copy()
        for segment in machine.segments:
            for name, value in segment.parameters.items() if segment.name in names else ():
                self.values[machine.indices(name)] = value

    def step(
        self, inputs: Iterable[np.ndarray], feed: np.ndarray = NOTHING, rate: np.ndarray = NOTHING,
        readings: np.ndarray = NOTHING, targets: np.ndarray = NOTHING, gains: np.ndarray = NOTHING,
    ) -> np.ndarray:  # fmt: skip
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
        if len(record):
            self.run(
                self.values, self.state, self.signals, *given, self.machine.slot, 1, record, NOTHING, NOTHING,
                feed, rate, self.fixed, readings, targets, gains,
            )  # fmt: skip
        return record
