"""The whole sampled-data loop as one map over a 20 ms frame: x_{n+1} = f(x_n, r_n), w_n = g(x_n, r_n).

x holds the states of all parts at the frame's start, r the tension references [N], w all signals at the frame's end.
The map is the compiled simulator, run for one frame without noise and without rounding. Drake's `Linearize` refuses
multi-rate diagrams; this map has one rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows, prepared
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine, offsets, signal_count, state_size
from exodrake.core.robot import Robot

LOOP_SIGNALS = ("tension_ref", "tension", "tension_read", "speed_cmd", "angle")
GAINS = ("controller.kp", "controller.kd")


def has(machine: Machine, name: str) -> bool:
    """Whether a machine has a signal or a parameter of that name."""
    return name in machine.signal or any(p == name or p.startswith(f"{name}.") for p in machine.index)


@dataclass(frozen=True)
class StateName:
    """An element of the flat state: the `owner.state` that it belongs to, its full name with channel, its unit."""

    group: str
    name: str
    unit: str


def state_names(machine: Machine) -> tuple[StateName, ...]:
    """Names of all states in the order of the flat state: each part's own, then those of the effects on it."""
    found: list[StateName] = []
    for block in machine.parts:
        owners = [(block.name, block.states), *((e.id, e.states) for e in machine.effects_on(block))]
        for owner, states in owners:
            for state in states:
                for channel in machine.axes.of(state.axis):
                    for k in range(state.width):
                        parts = (owner, state.name, channel, str(k) if state.width > 1 else "")
                        found.append(StateName(f"{owner}.{state.name}", ".".join(p for p in parts if p), state.unit))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class FrameMap:
    """The frame map of a robot, unquantised and free of noise.

    Attributes:
        robot: whose machine this is.
        parameters: (n,) flat vector in use [SI].
        module: the compiled simulator.
    """

    robot: Robot
    parameters: np.ndarray
    module: ModuleType

    @staticmethod
    def of(robot: Robot) -> FrameMap:
        """The frame map of a robot. InputError if a parameter is missing, or the machine has no tension loop."""
        missing = [name for name in (*LOOP_SIGNALS, *GAINS) if not has(robot.machine, name)]
        if missing:
            raise InputError(f"{robot.machine.name}: no tension loop to analyse (it lacks {', '.join(missing)})")
        return FrameMap(robot, prepared(robot, quantisation=False), compile_machine(robot.machine))

    @cached_property
    def signals(self) -> dict[str, slice]:
        """Where each signal lies in w."""
        return offsets(self.robot.machine)

    def start(self) -> np.ndarray:
        """State at the start of a run, (states,)."""
        x = np.zeros(state_size(self.robot.machine))
        self.module.begin(self.parameters, x)
        return x

    def run(self, state: np.ndarray, references: np.ndarray, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Runs some frames; `state` is left as it is.

        Args:
            state: (states,) array at the first frame's start.
            references: (frames, tendons) array of tensions [N].
            seed: of the sensors' noise; None runs without.

        Returns:
            The state (states,) after the frames, and all signals (frames, w) at the end of each.
        """
        x, rows, _ = self._run(state, references, seed, NOTHING)
        return x, rows

    def ticks(self, state: np.ndarray, references: np.ndarray) -> np.ndarray:
        """All signals at the end of each slot, (slots, w); arguments as in `run`."""
        machine = self.robot.machine
        fine = np.zeros((len(references) * machine.slots, signal_count(machine)))
        return self._run(state, references, None, fine)[2]

    def _run(self, state: np.ndarray, references: np.ndarray, seed: int | None, fine: np.ndarray):
        machine, frames = self.robot.machine, len(references)
        x, w, rows = state.copy(), np.zeros(signal_count(machine)), np.zeros((frames, signal_count(machine)))
        noise_inputs = NoiseInputs.draw(frames, seed, machine)
        self.module.run(
            self.parameters, x, w, *input_rows(machine, references, noise_inputs).values(), machine.slot, 1, rows, fine,
            NOTHING,
        )  # fmt: skip
        return x, rows, fine

    def stepper(self):
        """A function (x, r) -> (x', w) of one frame, with its buffers made once; x and r are left as they are."""
        machine = self.robot.machine
        calm, row = NoiseInputs.draw(1, None, machine), np.zeros((1, signal_count(machine)))
        run, parameters, slot = self.module.run, self.parameters, machine.slot
        w = np.zeros(signal_count(machine))

        def step(x: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            x = x.copy()
            run(
                parameters,
                x,
                w,
                *input_rows(machine, r[None, :], calm).values(),
                slot,
                1,
                row,
                NOTHING,
                NOTHING,
            )
            return x, row[0].copy()

        return step

    def with_values(self, values: Mapping[str, float]) -> FrameMap:
        """The same loop with other parameters: name -> value [SI]; a name without its channel sets all channels."""
        parameters = self.parameters.copy()
        for name, value in values.items():
            parameters[self.robot.indices(name)] = value
        return replace(self, parameters=parameters)


def references_of(robot: Robot, at: Mapping[str, float] | None) -> np.ndarray:
    """Tension references (tendons,) [N] of an operating point; the machine's own without `at`.

    Raises:
        InputError: an unknown tendon, a missing one, or a tension outside 0 .. F_max.
    """
    tendons = robot.machine.axes.tendons
    at = robot.machine.operating_point if at is None else at
    for name in at:
        if name not in tendons:
            raise InputError(f"operating point names tendon {name!r}; the robot has {', '.join(tendons)}")
    for name in tendons:
        if name not in at:
            raise InputError(f"operating point lacks tendon {name}; wanted {', '.join(tendons)}")
        top = robot.limits.get("F_max", {}).get(name, np.inf)
        if not 0.0 <= at[name] <= top:
            raise InputError(f"operating point {name} = {at[name]:g} N is outside 0 .. {top:g} N")
    return np.array([float(at[name]) for name in tendons])
