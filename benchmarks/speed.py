"""How fast this machine simulates: rows of name, value, unit and, where there is one, the target."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from time import perf_counter

import numpy as np

from benchmarks import diagnosis, estimator
from benchmarks.diagram import diagram_speed, multibody_speed
from exodrake.core.parallel import side_by_side
from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import ALONE, NoiseInputs, Reference, input_rows, prepare_values
from exodrake.machines.robot_file import load_robot
from exodrake.model.machine import signal_count, state_size
from exodrake.model.robot import Robot
from exodrake.simulation.simulate import simulate

SPEED = "simulated s / s"


@dataclass(frozen=True)
class Row:
    """One measured figure. `least`, `most`: its target, None where there is none."""

    name: str
    value: float
    unit: str
    least: float | None = None
    most: float | None = None

    @property
    def target(self) -> str:
        """The target in words."""
        if self.least is not None:
            return f"≥ {self.least:g}"
        return f"≤ {self.most:g}" if self.most is not None else ""

    @property
    def met(self) -> bool:
        """Whether the figure meets its target."""
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)


def best(function: Callable[[], object], repeats: int) -> float:
    """Least wall time of some calls [s], after one that is not counted."""
    function()
    least = math.inf
    for _ in range(repeats):
        start = perf_counter()
        function()
        least = min(least, perf_counter() - start)
    return least


def wavy(seconds: float) -> Reference:
    """Tension references that keep all wires busy."""
    time = 0.02 * np.arange(round(seconds / 0.02))[:, None]
    centre, swing, rate = np.array([5.0, 3.5, 2.0]), np.array([4.0, 3.0, 1.7]), np.array([0.11, 0.17, 0.23])
    return Reference(centre + swing * np.sin(2 * np.pi * rate * time), "bench")


def compiled_speed(robot: Robot, reference: Reference, rows: int, batch: bool) -> float:
    """Simulated seconds per wall second of the compiled simulator: rows of numbers one after another, or on all
    cores.
    """
    machine, module = robot.machine, compile_machine(robot.machine)
    noise_inputs = NoiseInputs.draw(len(reference.values), 1, machine)
    given = input_rows(machine, reference.values, noise_inputs).values()
    parameters = np.tile(prepare_values(robot), (rows, 1))
    records = np.zeros((rows, len(reference.values), signal_count(machine)))

    def run(k: int) -> None:
        state, wires = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        module.begin(parameters[k], state)
        module.run(parameters[k], state, wires, *given, machine.slot, 1, records[k], *ALONE)

    runs = [partial(run, k) for k in range(rows)]
    seconds = best(lambda: side_by_side(runs) if batch else [one() for one in runs], 4)
    return rows * machine.frame * len(reference.values) / seconds


def engine_rows(robot: Robot, seconds: float, tell: Callable[[str], object]) -> list[Row]:
    """Speeds of the engines, of MultibodyPlant's and MuJoCo's finger in the same run, and their ratios."""
    reference, rows = wavy(1.1 * seconds), 4 * (os.cpu_count() or 1)
    diagram = diagram_speed(robot, reference, seconds)
    compiled = compiled_speed(robot, reference, rows, batch=False)
    batch = compiled_speed(robot, reference, rows, batch=True)
    discrete, discrete_apart = multibody_speed(robot, reference, robot.machine.slot, seconds)
    continuous, continuous_apart = multibody_speed(robot, reference, 0.0, seconds / 4)
    return [
        Row("Diagram, a LeafSystem in Python per part", diagram, SPEED, least=25),
        Row("compiled simulator, one core", compiled, SPEED),
        Row(f"compiled simulator, batch on {os.cpu_count()} cores", batch, SPEED),
        Row("MultibodyPlant finger alone, tendons in a Python leaf, 2 ms", discrete, SPEED),
        Row("  RMS of its angles from ours", discrete_apart, "rad"),
        Row("MultibodyPlant finger alone, tendons in a Python leaf, continuous", continuous, SPEED),
        Row("  RMS of its angles from ours", continuous_apart, "rad"),
        *mujoco_rows(robot, reference, seconds, tell),
        Row("compiled / Diagram", compiled / diagram, "-"),
        Row("batch / compiled", batch / compiled, "-", least=1.7),
        Row("Diagram / MultibodyPlant finger alone, 2 ms", diagram / discrete, "-"),
        Row("Diagram / MultibodyPlant finger alone, continuous", diagram / continuous, "-"),
    ]


def mujoco_rows(robot: Robot, reference: Reference, seconds: float, tell: Callable[[str], object]) -> list[Row]:
    """MuJoCo's finger under a Python loop, if the package is there; measured in turns with the Diagram."""
    if find_spec("mujoco") is None:
        tell("no package mujoco (dependency group bench): its rows are left out")
        return []
    from benchmarks.mujoco_finger import mujoco_speed

    turns = [
        (diagram_speed(robot, reference, seconds / 4), mujoco_speed(robot, reference, seconds / 4)[0]) for _ in range(4)
    ]
    diagram, loop = (max(speeds) for speeds in zip(*turns, strict=True))
    return [
        Row("MuJoCo finger alone, 2 ms, controller in Python every 20 ms", loop, SPEED),
        Row("Diagram / MuJoCo finger under a Python loop", diagram / loop, "-"),
    ]


def wall(*command: str) -> float:
    """Wall time of a command of a new process [s]."""
    start = perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return perf_counter() - start


def session_rows(robot: Robot) -> list[Row]:
    """What a user waits for."""
    call = "import exodrake as exo; exo.simulate(exo.load_robot(), exo.Reference([[5, 3, 1]] * 500))"
    reference = Reference(np.tile([5.0, 3.0, 1.0], (500, 1)))
    return [
        Row("first simulate (10 s) in a new session, imports included", wall(sys.executable, "-c", call), "s"),
        Row("later simulate (10 s)", best(lambda: simulate(robot, reference), 5), "s"),
        Row("exodrake --help", min(wall(sys.executable, "-m", "exodrake", "--help") for _ in range(4)), "s", most=0.4),
    ]


def bench(seconds: float = 20.0, others: bool = True, tell: Callable[[str], object] = lambda text: None) -> list[Row]:
    """All rows, of runs of so many seconds; `others`: also those of other modules."""
    robot = load_robot()
    tell("engines")
    rows = engine_rows(robot, seconds, tell)
    tell("sessions")
    rows += session_rows(robot)
    if others:
        tell("other modules")
        rows += [Row(*row) for module in (estimator, diagnosis) for row in module.rows()]
    return rows
