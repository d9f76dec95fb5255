"""One run of the compiled simulator."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, Chance, Reference, given_rows
from exodrake.core.machine import Machine, state_size, wire_count


def run_compiled(
    machine: Machine, values: np.ndarray, reference: Reference, chance: Chance, substeps: int
) -> np.ndarray:
    """All wires (frames, wires) at each frame's end, by the compiled twin."""
    module = compile_machine(machine)
    rows = np.zeros((len(reference.tension), wire_count(machine)))
    state, w = np.zeros(state_size(machine)), np.zeros(wire_count(machine))
    module.begin(values, state)
    given = given_rows(machine, reference.tension, chance).values()
    module.run(values, state, w, *given, machine.slot / substeps, substeps, rows, NOTHING, NOTHING)
    return rows
