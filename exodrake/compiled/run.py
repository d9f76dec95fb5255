"""One run of the compiled simulator."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, Reference, input_rows
from exodrake.core.machine import Machine, signal_count, state_size


def run_compiled(
    machine: Machine, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int
) -> np.ndarray:
    """All signals (frames, channels) at each frame's end, by the compiled simulator."""
    module = compile_machine(machine)
    rows = np.zeros((len(reference.values), signal_count(machine)))
    state, w = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
    module.begin(values, state)
    given = input_rows(machine, reference.values, noise_inputs).values()
    module.run(values, state, w, *given, machine.slot / substeps, substeps, rows, NOTHING, NOTHING)
    return rows
