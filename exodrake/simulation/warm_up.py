"""Compiles all entry points of the nominal machine by using each once, in processes side by side."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, Reference, input_rows, prepared
from exodrake.core.machine import signal_count, state_size
from exodrake.core.processes import end_with, python_command, python_environment
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.simulate import record

SHORT = Reference(np.tile([5.0, 3.0, 1.0], (3, 1)), "warm-up")


JOBS = {"the compiled simulator": "compiled", "the Drake leaves": "drake"}  # and the engine that uses them


def use_engine(engine: str, parent: int) -> None:
    """Uses all that an engine compiles once, in a process that ends with the one of that id."""
    end_with(parent)
    robot = load_robot()
    machine, frames = robot.machine, len(SHORT.values)
    record(robot, SHORT, engine=engine)
    if engine == "compiled":
        given = input_rows(machine, SHORT.values, NoiseInputs.draw(frames, 0, machine)).values()
        records = np.zeros((1, frames, signal_count(machine)))
        batch = compile_machine(machine).batch
        batch(prepared(robot)[None], state_size(machine), *given, machine.slot, 1, records, NOTHING)


def warm_up(tell: Callable[[str, list[str]], object] = lambda done, left: None) -> None:
    """Compiles everything; `tell` hears what is done and what is left. Raises RuntimeError if a process fails."""
    compile_machine(load_robot().machine)  # writes the module, once for all processes
    call = "from exodrake.simulation.warm_up import use_engine; use_engine({!r}, {})"
    options: dict[str, Any] = {"env": python_environment(), "stderr": subprocess.PIPE, "text": True}
    with ThreadPoolExecutor(len(JOBS)) as pool:
        running = {
            pool.submit(subprocess.run, python_command("-c", call.format(engine, os.getpid())), **options): name
            for name, engine in JOBS.items()
        }
        for future in as_completed(running):
            name, process = running.pop(future), future.result()
            if process.returncode:
                raise RuntimeError(f"compiling {name} failed: {process.stderr}")
            tell(name, list(running.values()))
