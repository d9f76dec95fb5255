"""Runs of the compiled simulator: of a whole machine, and replays between measured signals."""

from collections.abc import Iterable

import numpy as np

from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import ALONE, NoiseInputs, Reference, RunOptions, input_rows, reference_width
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
    module.run(values, state, w, *given, machine.slot / substeps, substeps, rows, *ALONE)
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
        rows = np.zeros((0, len(self.signals)))
        self.run(values, self.state, self.signals, *none.values(), machine.slot, 1, rows, *ALONE)
        self.values = values.copy()
        for segment in machine.segments:
            for name, value in segment.parameters.items() if segment.name in names else ():
                self.values[machine.indices(name)] = value

    def step(self, inputs: Iterable[np.ndarray], options: RunOptions = ALONE) -> np.ndarray:
        """Signals (n, signals) at the end of each of the next n frames [SI].

        Args:
            inputs: exogenous inputs in the machine's order, (n, channels) each [SI].
            options: what was measured; `feed` and `rate` are needed if a segment is fixed.
        """
        given = [np.ascontiguousarray(x, dtype=float) for x in inputs]
        options = RunOptions(*map(np.ascontiguousarray, options._replace(fixed=self.fixed)))
        record = np.empty((len(given[0]), len(self.signals)))
        if len(record):
            self.run(self.values, self.state, self.signals, *given, self.machine.slot, 1, record, *options)
        return record
