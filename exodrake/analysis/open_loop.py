"""The loop opened at its commands: x' = A x + B u, v = C x, with u what the plant gets and v what the controller sends.

A reference enters the controller only, and the command answers within the frame: dv/dr = D. So u acts on the plant like
a reference D^-1 u, and does not act on the controller's own states. No second simulation is needed:

    B = B_r D^-1, 0 in the controller's states         A = A_closed - B C         L(z) = -C (z - A)^-1 B
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import floor

import numpy as np

from exodrake.analysis.frame_map import FrameMap, state_names
from exodrake.analysis.linear_model import OUTSIDE, FrameModel
from exodrake.core.errors import InputError

TURN = 0.5  # rad: largest step of phase when encirclements are counted


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """The loop opened at its commands; closed by u = v.

    Attributes:
        A (n, n), B (n, channels), C (channels, n), Y (channels, n): of the readings, y = Y x. SI.
        R (n, channels), D (channels, channels): x' = ... + R r in the controller's states, v = C x + D r.
        period: [s].
        channels: their names.
        states: theirs.
        controller: (n,) whether a state is the controller's.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Y: np.ndarray
    R: np.ndarray
    D: np.ndarray
    period: float
    channels: tuple[str, ...]
    states: tuple[str, ...]
    controller: np.ndarray

    @cached_property
    def frequency(self) -> np.ndarray:
        """Grid (f,) [Hz] up to the Nyquist frequency, dense where margins are read."""
        top = 0.5 / self.period
        return np.concatenate([np.geomspace(4e-5 * top, 0.04 * top, 300), np.linspace(0.04, 1.0, 1500)[1:] * top])

    def circle(self, frequency: np.ndarray) -> np.ndarray:
        """Points z (f,) on the unit circle at frequencies [Hz]."""
        return np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * self.period)

    def response(self, z: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Outputs (f, k, channels) [SI] of rows (k, n): rows (z - A)^-1 B at points z (f,) [-]."""
        n = len(self.A)
        parts = np.array_split(z, max(1, len(z) // 200))
        return np.concatenate([rows @ np.linalg.solve(p[:, None, None] * np.eye(n) - self.A, self.B) for p in parts])

    def ratio(self, frequency: np.ndarray) -> np.ndarray:
        """Return ratio L (f, channels, channels) at frequencies [Hz]."""
        return -self.response(self.circle(frequency), self.C)

    def plant(self, frequency: np.ndarray) -> np.ndarray:
        """Response of the readings to the commands (f, channels, channels) at frequencies [Hz]."""
        return self.response(self.circle(frequency), self.Y)

    def closed(self, gain: np.ndarray | float = 1.0) -> np.ndarray:
        """A (n, n) [SI] of the loop closed with factors (channels,) [-] on the commands."""
        return self.A + self.B @ (np.broadcast_to(gain, (len(self.channels),))[:, None] * self.C)

    def single(self, channel: int) -> OpenLoop:
        """The loop of one channel opened, the others closed."""
        shut = np.ones(len(self.channels))
        shut[channel] = 0.0
        one = slice(channel, channel + 1)
        return OpenLoop(
            self.closed(shut), self.B[:, one], self.C[one], self.Y[one], self.R[:, one], self.D[one, one], self.period,
            self.channels[one], self.states, self.controller,
        )  # fmt: skip

    def delayed(self, frames: float) -> np.ndarray:
        """A (m, m) [SI] of the loop closed by commands late by `frames`, with a straight line between two commands."""
        whole, n, m = floor(frames), len(self.A), len(self.channels)
        depth = whole + 1  # commands of 1 .. depth frames ago
        a = np.zeros((n + depth * m, n + depth * m))
        a[:n, :n] = self.A
        a[n : n + m, :n] = self.C
        a[n + m :, n:-m] = np.eye((depth - 1) * m)
        for age, share in ((whole, 1.0 - frames + whole), (whole + 1, frames - whole)):
            if age == 0:
                a[:n, :n] += share * self.B @ self.C
            else:
                a[:n, n + (age - 1) * m : n + age * m] += share * self.B
        return a

    def encirclements(self) -> int:
        """Number of counter-clockwise encirclements of 0 by det(I + L), z on a circle just outside |z| = 1."""
        eye = np.eye(len(self.channels))

        def determinant(angle: np.ndarray) -> np.ndarray:
            return np.linalg.det(eye - self.response((1.0 + OUTSIDE) * np.exp(1j * angle), self.C))

        return round(2.0 * turned(determinant, np.geomspace(1e-9, np.pi, 400)) / (2.0 * np.pi))

    def outside(self, matrix: np.ndarray) -> int:
        """Number of eigenvalues [-] of a matrix (n, n) outside the circle that `encirclements` follows."""
        return int((np.abs(np.linalg.eigvals(matrix)) > 1.0 + OUTSIDE).sum())


def turned(function: Callable[[np.ndarray], np.ndarray], angle: np.ndarray) -> float:
    """Change of phase of a complex function along its angles (k,) [rad]; refined where the phase changes fast."""
    value = function(angle)
    for _ in range(40):
        step = np.angle(value[1:] / value[:-1])
        wide = np.flatnonzero(np.abs(step) > TURN)
        if not len(wide):
            break
        middle = np.sqrt(angle[wide] * angle[wide + 1])
        angle, value = np.insert(angle, wide + 1, middle), np.insert(value, wide + 1, function(middle))
    return float(np.angle(value[1:] / value[:-1]).sum())


def opened(loop: FrameMap, model: FrameModel) -> OpenLoop:
    """A loop opened at its commands. InputError where a command ignores its reference (a gain of 0)."""
    kinds, names = loop.loop, [name.name for name in state_names(loop.robot.machine)]
    own = loop.own[[names.index(name) for name in model.states]]
    return cut(model, own, loop.column(kinds.command), loop.column(kinds.measured), loop.channels)


def cut(model: FrameModel, controller: np.ndarray, command: str, measured: str, channels: tuple[str, ...]) -> OpenLoop:
    """The linear model opened at its commands.

    Args:
        model: of the closed loop.
        controller: (n,) mask of the controller's states [-].
        command: kind of the commands' columns.
        measured: kind of the readings' columns.
        channels: names.
    """
    v = [model.outputs.index(f"{command}_{c}") for c in channels]
    y = [model.outputs.index(f"{measured}_{c}") for c in channels]
    direct = model.D[v]
    if (np.abs(direct).max(axis=1) == 0.0).any() or np.linalg.cond(direct) > 1e12:
        raise InputError(f"the {command} does not answer to its reference (kp = 0): there is no loop to break")
    b = model.B @ np.linalg.inv(direct)
    b[controller] = 0.0
    c = model.C[v]
    r = np.where(controller[:, None], model.B, 0.0)
    return OpenLoop(model.A - b @ c, b, c, model.C[y], r, direct, model.period, channels, model.states, controller)
