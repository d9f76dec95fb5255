"""The whole robot in closed loop, frame by frame beside a log, and pictures that motion capture takes late."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, prepared
from exodrake.core.machine import offsets, signal_count, state_size
from exodrake.core.robot import Robot
from exodrake.simulation.delayed_samples import cubic

MEMORY = 1000  # frames that late pictures may look back
KINDS = ("tension", "stroke", "speed_cmd", "angle")


def silent(robot: Robot) -> np.ndarray:
    """The robot's flat numbers without noise and rounding."""
    values = prepared(robot, quantisation=False)
    for name in robot.machine.noise:
        values[robot.machine.index[name]] = 0.0
    return values


class Pictures:
    """Angles taken late: those of frame n come out `ahead` frames later, since interpolation looks ahead."""

    def __init__(self, frame: float, ahead: int) -> None:
        self.frame, self.ahead, self.first = frame, ahead, 0
        self.angle, self.late, self.done = np.zeros((0, 3)), np.zeros(0), 0

    def push(self, angle: np.ndarray, late: np.ndarray, last: bool = False) -> np.ndarray:
        """Angles (n, 3) [rad] and lateness (n,) [s] of the next frames; returns the angles seen (m, 3)."""
        self.angle, self.late = np.concatenate([self.angle, angle]), np.concatenate([self.late, late])
        end = self.first + len(self.angle) - (0 if last else self.ahead)
        here = np.arange(self.done, max(end, self.done))
        delay = self.late[here - self.first]
        seen = self.angle[here - self.first]
        if delay.any():
            seen = cubic(self.angle, (here - delay / self.frame) - self.first)
        self.done += len(here)
        drop = max(len(self.angle) - MEMORY, 0)
        self.angle, self.late, self.first = self.angle[drop:], self.late[drop:], self.first + drop
        return seen


class ClosedLoop:
    """The compiled simulator, stepped: what the robot of these numbers would have logged, without noise and rounding.

    Rows of frame n come out `ahead` frames later. The same bits as `record(robot, reference, seed=None,
    quantisation=False)`.
    """

    def __init__(self, robot: Robot, ahead: int) -> None:
        self.machine, self.values, self.module = robot.machine, silent(robot), compile_machine(robot.machine)
        self.state, self.w = np.zeros(state_size(self.machine)), np.zeros(signal_count(self.machine))
        self.module.begin(self.values, self.state)
        at = offsets(self.machine)
        shown = {c.kind: c.signal for c in self.machine.columns}
        self.plain = np.concatenate([np.arange(len(self.w))[at[shown[kind]]] for kind in KINDS[:3]])
        self.angles, self.lateness = at[shown["angle"]], at["mocap_delay"].start
        self.pictures, self.ahead = Pictures(self.machine.frame, ahead), ahead
        self.waiting = np.zeros((0, len(self.plain)))

    def push(self, reference: np.ndarray, last: bool = False) -> np.ndarray:
        """References (n, 3) [N] of the next frames; returns (m, 12): tension, stroke, speed_cmd, angle. `last`: no more
        will come."""
        count = len(reference)
        rows, still, never = np.zeros((count, len(self.w))), np.zeros((count, 3)), np.ones((count, 3))
        if count:
            self.module.run(
                self.values, self.state, self.w, np.ascontiguousarray(reference), still, still, never,
                self.machine.slot, 1, rows, NOTHING, NOTHING,
            )  # fmt: skip
        seen = self.pictures.push(rows[:, self.angles], rows[:, self.lateness], last)
        self.waiting = np.concatenate([self.waiting, rows[:, self.plain]])
        out = np.concatenate([self.waiting[: len(seen)], seen], axis=1)
        self.waiting = self.waiting[len(seen) :]
        return out
