"""The whole sampled-data loop as one map over a frame: x_{n+1} = f(x_n, r_n, e_n), w_n = g(x_n, r_n, e_n).

x holds the states of all parts at the frame's start, r the loop's references, e the sensors' standard normal noise, w
all signals at the frame's end. Further references of the machine are 0. The map is the compiled simulator, run for one
frame without noise and without rounding. Drake's `Linearize` refuses multi-rate diagrams; this map has one rate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows, prepared, reference_width
from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Loop, Machine, full_name, signal_count, state_size
from exodrake.core.part import NORMAL
from exodrake.core.robot import Robot


@dataclass(frozen=True)
class StateName:
    """An element of the flat state: the `owner.state` that it belongs to, its full name with channel, its unit."""

    group: str
    name: str
    unit: str


def name_states(machine: Machine) -> tuple[StateName, ...]:
    """Names of all states in the order of the flat state: each part's own, then those of the effects on it."""
    found: list[StateName] = []
    for block in machine.parts:
        owners = [(block.name, block.states), *((e.id, e.states) for e in machine.effects_on(block))]
        for owner, states in owners:
            for state in states:
                for channel in machine.axes.of(state.axis):
                    for k in range(state.width):
                        parts = (owner, state.name, channel, str(k) if state.width > 1 else "")
                        found.append(StateName(f"{owner}.{state.name}", full_name(*parts), state.unit))
    return tuple(found)


def add_controller(robot: Robot) -> Robot:
    """The robot with the outer controller of a machine that has none of its own. InputError if it can have no loop."""
    loop = robot.machine.loop
    if loop is None:
        raise InputError(
            f"{robot.machine.name}: no closed loop to analyse (its motion is measured, not commanded: "
            "no reference goes through a controller)"
        )
    return loop.outer(robot) if loop.outer else robot


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
        """The frame map of a robot. InputError if a parameter is missing, or the machine has no loop."""
        robot = add_controller(robot)
        return FrameMap(robot, prepared(robot, quantisation=False), compile_machine(robot.machine))

    @property
    def loop(self) -> Loop:
        """Closed loop that the machine declares: its signals and gains."""
        assert self.robot.machine.loop is not None  # `of` sees to it
        return self.robot.machine.loop

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the loop's channels, in the order of its references."""
        return self.robot.machine.channels(self.loop.reference)

    @property
    def noises(self) -> tuple[str, ...]:
        """Names of the elements of e: sensor noise."""
        machine = self.robot.machine
        signals = [machine.signal[n] for n in machine.inputs if machine.signal[n].distribution == NORMAL]
        return tuple(f"{s.name}_{channel}" for s in signals for channel in machine.axes.of(s.axis))

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Signal -> its name as an output: the kind of its log columns, else its own, with `_true` if taken."""
        machine = self.robot.machine
        shown = {c.signal: c.kind for c in machine.columns if c.signal not in machine.inputs}
        others = (s.name for s in machine.signals if s.name not in machine.inputs and s.name not in shown)
        return shown | {name: f"{name}_true" if name in shown.values() else name for name in others}

    @cached_property
    def outputs(self) -> dict[str, int]:
        """Name of an output, such as `tension_AF`, -> its index in w; those of the log first."""
        return {
            "_".join(filter(None, (kind, channel))): self.signals[signal].start + i
            for signal, kind in self.kinds.items()
            for i, channel in enumerate(self.robot.machine.channels(signal))
        }

    @cached_property
    def shown_rows(self) -> np.ndarray:
        """Indices in w (n,) [-] of the signals of the log and of the loop."""
        machine, loop = self.robot.machine, self.loop
        wanted = {c.signal for c in machine.columns} | {loop.command, loop.output, loop.measured}
        return np.concatenate(
            [np.arange(self.signals[s].start, self.signals[s].stop) for s in self.kinds if s in wanted]
        )

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the loop's references, such as `tension_ref_AF`."""
        return tuple(f"{self.loop.reference}_{channel}" for channel in self.channels)

    @cached_property
    def signals(self) -> dict[str, slice]:
        """Position of each signal in w."""
        return self.robot.machine.offsets

    def start(self) -> np.ndarray:
        """State (states,) [SI] at the start of a run."""
        x = np.zeros(state_size(self.robot.machine))
        self.module.begin(self.parameters, x)
        return x

    def run(self, state: np.ndarray, references: np.ndarray, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Runs some frames; `state` is left as it is.

        Args:
            state: (states,) array at the first frame's start.
            references: (frames, channels) array of the loop's references [SI].
            seed: of the sensors' noise; None runs without.

        Returns:
            The state (states,) after the frames, and all signals (frames, w) at the end of each.
        """
        x, rows, _ = self._run(state, references, seed, NOTHING)
        return x, rows

    def ticks(self, state: np.ndarray, references: np.ndarray) -> np.ndarray:
        """All signals (slots, w) [SI] at the end of each slot; arguments as in `run`."""
        machine = self.robot.machine
        fine = np.zeros((len(references) * machine.slots, signal_count(machine)))
        return self._run(state, references, None, fine)[2]

    def _run(self, state: np.ndarray, references: np.ndarray, seed: int | None, fine: np.ndarray):
        machine, frames = self.robot.machine, len(references)
        x, w, rows = state.copy(), np.zeros(signal_count(machine)), np.zeros((frames, signal_count(machine)))
        noise_inputs = NoiseInputs.draw(frames, seed, machine)
        self.module.run(
            self.parameters, x, w, *input_rows(machine, self.all_references(references), noise_inputs).values(),
            machine.slot, 1, rows, fine, NOTHING,
        )  # fmt: skip
        return x, rows, fine

    @cached_property
    def _place(self) -> tuple[int, slice]:
        """Width of all references of the machine, and where those of the loop lie among them."""
        machine, at = self.robot.machine, 0
        for column in machine.references:
            if column.signal == self.loop.reference:
                break
            at += len(machine.channels(column.signal))
        return reference_width(machine), slice(at, at + len(self.channels))

    def all_references(self, references: np.ndarray) -> np.ndarray:
        """References of the machine, (frames, all) [SI], from the loop's (frames, channels); the others are 0."""
        width, place = self._place
        whole = np.zeros((len(references), width))
        whole[:, place] = references
        return whole

    def stepper(self):
        """A function (x, r, e = 0) -> (x', w) of one frame, with its buffers made once; arguments are left alone."""
        machine = self.robot.machine
        noise, row = NoiseInputs.draw(1, None, machine), np.zeros((1, signal_count(machine)))
        normal = [n for n in noise if machine.signal[n].distribution == NORMAL]
        run, parameters, slot = self.module.run, self.parameters, machine.slot
        w = np.zeros(signal_count(machine))

        def step(x: np.ndarray, r: np.ndarray, e: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
            x, at = x.copy(), 0
            for name in normal:
                width = noise[name].shape[1]
                noise[name][0] = 0.0 if e is None else e[at : at + width]
                at += width
            rows = input_rows(machine, self.all_references(r[None, :]), noise).values()
            run(parameters, x, w, *rows, slot, 1, row, NOTHING, NOTHING)
            return x, row[0].copy()

        return step

    @cached_property
    def own(self) -> np.ndarray:
        """Whether a state (states,) is the controller's own: the plant does not see it; the held command it does."""
        machine, part = self.robot.machine, next(p for p in self.robot.machine.parts if p.name == self.loop.part)
        owners = tuple(f"{owner}." for owner in (part.name, *(e.id for e in machine.effects_on(part))))
        held = f"{part.name}.{self.loop.held}"
        return np.array([n.group.startswith(owners) and n.group != held for n in name_states(machine)])

    def with_values(self, values: Mapping[str, float]) -> FrameMap:
        """The frame map with other parameters: name -> value [SI]; a name without its channel sets all channels."""
        parameters = self.parameters.copy()
        for name, value in values.items():
            parameters[self.robot.indices(name)] = value
        return replace(self, parameters=parameters)


def resolve_references(loop: FrameMap, at: Mapping[str, float] | str | None) -> np.ndarray:
    """References (channels,) [SI] of an operating point, by its name or channel by channel; the machine's own without.

    Raises:
        InputError: an unknown point or channel, a missing one, or a reference outside its limits.
    """
    robot, channels = loop.robot, loop.channels
    at = next(iter(loop.loop.points)) if at is None else at
    lowest, highest = robot.reference_limits()
    values: Mapping[str, float]
    if isinstance(at, str):
        points = loop.loop.points
        if at not in points:
            raise InputError(f"no operating point {at!r}{nearest(at, list(points))}; there are {', '.join(points)}")
        values = {c: float(np.clip(points[at][c], *ends)) for c, *ends in zip(channels, lowest, highest)}
    else:
        values = at
    for name in values:
        if name not in channels:
            raise InputError(f"operating point names {name!r}; the loop has {', '.join(channels)}")
    if not robot.machine.reference_limits:
        lowest = -highest
    unit = robot.machine.signal[loop.loop.reference].unit
    for i, name in enumerate(channels):
        if name not in values:
            raise InputError(f"operating point lacks {name}; wanted {', '.join(channels)}")
        low = min(lowest[i], 0.0)
        if not math.isfinite(values[name]) or not low <= values[name] <= highest[i]:
            raise InputError(
                f"operating point {name} = {values[name]:g} {unit} is outside {low:g} .. {highest[i]:g} {unit}"
            )
    return np.array([float(values[name]) for name in channels])
