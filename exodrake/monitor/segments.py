"""The four segments between measured wires, each replayed from what was measured before it.

    controller   reference, tension -> speed command        motor    speed command, tension -> stroke
    tendon       stroke, angle -> tension                   finger   tension -> angle

Bus, drive and encoder are in `motor`, wire and cell in `tendon`, sheath, joints and motion capture in `finger`: the
segments of `diagnosis.replay`, as a stream.
"""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.leaf_functions import held_signals
from exodrake.core.part import Part
from exodrake.core.robot import Robot
from exodrake.diagnosis.loop import SOFT
from exodrake.diagnosis.replay import READING
from exodrake.monitor.compiled import compile_kernels
from exodrake.monitor.simulator import Pictures, silent

ANCHOR = 10.0  # s, with which a replayed spool is drawn to the measured one
ARMS = tuple(f"router.{letter}_{side}" for side in "fe" for letter in "abmn")


class Parts:
    """States, numbers and wires of a robot's parts, at the start."""

    def __init__(self, robot: Robot) -> None:
        machine, values = robot.machine, silent(robot)
        module, state = compile_machine(machine), np.zeros(sum(sum(machine.part_size(b)) for b in machine.parts))
        module.begin(values, state)
        self.machine, self.kernels = machine, compile_kernels(machine)
        self.clock = (machine.slot, machine.slots, READING)
        self.wires = {w.name: np.zeros(machine.width(w.axis)) for w in machine.signals}
        self.states: dict[str, np.ndarray] = {}
        self.parameters: dict[str, np.ndarray] = {}
        at = p_at = 0
        for part in machine.parts:
            size, count = sum(machine.part_size(part)), sum(e.part == part.name for e in machine.parameters)
            self.states[part.name] = state[at : at + size].copy()
            self.parameters[part.name] = values[p_at : p_at + count].copy()
            at, p_at = at + size, p_at + count
            held = [self.wires[n] for n in held_signals(part)]
            getattr(module, f"{part.name}__leaf__hold")(self.states[part.name], *held, self.parameters[part.name])

    def part(self, name: str) -> Part:
        """A part by name."""
        return next(b for b in self.machine.parts if b.name == name)

    def slots(self, name: str, task: str) -> np.ndarray:
        """Slots in which a part's task runs."""
        return np.array(next(t.slots for t in self.part(name).tasks if t.function == task))

    def pick(self, *names: str) -> tuple[np.ndarray, ...]:
        """Wires by name."""
        return tuple(self.wires[n] for n in names)


class ControllerReplay:
    """Speed commands from references and readings."""

    def __init__(self, robot: Robot) -> None:
        self.parts = Parts(robot)

    def push(self, reference: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """Rows (n, 3) [N] -> speed commands (n, 3) [m/s]."""
        p, out = self.parts, np.empty_like(reference)
        p.kernels.controller_frames(
            p.states["controller"], p.wires["speed_cmd"], p.parameters["controller"], reference, tension, out
        )
        return out


class MotorReplay:
    """Strokes from speed commands and tensions; set to the first measured stroke, then drawn to it with the time
    constant `ANCHOR`."""

    def __init__(self, robot: Robot, anchor: float = ANCHOR) -> None:
        self.parts, self.pull, self.share = Parts(robot), np.ones(3), robot.machine.frame / anchor

    def push(self, command: np.ndarray, tension: np.ndarray, rate: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Commands [m/s], tensions [N] and their rates, measured strokes [m] (n, 3) -> strokes (n, 3) [m]."""
        p, out = self.parts, np.empty_like(command)
        names = ("motor", "encoder", "bus")
        p.kernels.motor_frames(
            tuple(p.states[n] for n in names),
            p.pick("stroke", "wire_speed", "spool_angle", "stroke_read", "speed_applied", "tension"),
            tuple(p.parameters[n] for n in names),
            (p.slots("encoder", "read"), p.slots("bus", "write")),
            p.clock, command, tension, rate, np.ones(3), measured, self.pull, self.share, out,
        )  # fmt: skip
        return out


class TendonReplay:
    """Readings of the cells from strokes and angles: the finger is held in the measured posture."""

    def __init__(self, robot: Robot) -> None:
        self.parts, self.now = Parts(robot), np.zeros(3)
        self.arms = np.array([robot.channels(name) for name in ARMS])

    def push(
        self, stroke: np.ndarray, stroke_rate: np.ndarray, angle: np.ndarray, angle_rate: np.ndarray
    ) -> np.ndarray:
        """Strokes [m], angles [rad] and their rates (n, 3) -> readings (n, 3) [N]."""
        p, out = self.parts, np.empty_like(stroke)
        wires = p.pick("angle", "rate", "tension_finger", "stroke", "wire_speed", "tension", "cell", "tension_read")
        p.kernels.tendon_frames(
            (p.states["finger"], p.states["sensor"]),
            (*wires, p.wires["noise_tension"], self.now),
            (p.parameters["finger"], p.parameters["sensor"]),
            p.slots("sensor", "read"), p.clock, stroke, stroke_rate, angle, angle_rate, self.arms, out,
        )  # fmt: skip
        return out


class FingerReplay:
    """Angles from tensions: the wires are made so soft that a stroke is a force. Angles lag as `Pictures` say."""

    def __init__(self, robot: Robot, ahead: int) -> None:
        self.parts, self.pictures = Parts(robot), Pictures(robot.machine.frame, ahead)
        for place, parameter in enumerate(e for e in robot.machine.parameters if e.part == "finger"):
            if parameter.name.startswith("tendon.k."):
                self.parts.parameters["finger"][place] = SOFT

    def push(self, tension: np.ndarray, rate: np.ndarray, last: bool = False) -> np.ndarray:
        """Tensions (n, 3) [N] and their rates -> angles (m, 3) [rad]."""
        p, out = self.parts, np.empty((len(tension), 4))
        wires = p.pick("angle", "rate", "tension_finger", "stroke", "wire_speed", "angle_read", "mocap_delay")
        p.kernels.finger_frames(
            (p.states["finger"], p.states["mocap"]),
            (*wires, p.wires["noise_angle"]),
            (p.parameters["finger"], p.parameters["mocap"]),
            int(p.slots("mocap", "sample")[0]), p.clock, tension, rate, SOFT, out,
        )  # fmt: skip
        return self.pictures.push(out[:, :3], out[:, 3], last)
