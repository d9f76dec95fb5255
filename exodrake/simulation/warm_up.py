"""Compiles all entry points of the nominal machine by using each once, in processes side by side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, Reference, input_rows, prepare_values
from exodrake.core.machine import signal_count, state_size
from exodrake.core.parallel import each
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.simulate import record

SHORT = Reference(np.tile([5.0, 3.0, 1.0], (3, 1)), "warm-up")
JOBS = {"the compiled simulator": "compiled", "the Drake leaves": "drake"}  # and the engine that uses them


def use_engine(engine: str) -> None:
    """Uses all that an engine compiles once."""
    robot = load_robot()
    machine, frames = robot.machine, len(SHORT.values)
    record(robot, SHORT, engine=engine)
    if engine == "compiled":
        given = input_rows(machine, SHORT.values, NoiseInputs.draw(frames, 0, machine)).values()
        records = np.zeros((1, frames, signal_count(machine)))
        batch = compile_machine(machine).batch
        batch(prepare_values(robot)[None], state_size(machine), *given, machine.slot, 1, records, NOTHING)


def warm_up(tell: Callable[[str, list[str]], object] = lambda done, left: None) -> None:
    """Compiles everything; `tell` hears what is done and what is left. Raises RuntimeError if a process fails."""
    compile_machine(load_robot().machine)  # writes the module, once for all processes
    left = dict(enumerate(JOBS))
    for outcome in each(use_engine, ((engine,) for engine in JOBS.values()), jobs=len(JOBS)):
        name = left.pop(outcome.number)
        if outcome.reason:
            raise RuntimeError(f"compiling {name} failed: {outcome.reason}\n{outcome.trace}")
        tell(name, list(left.values()))
