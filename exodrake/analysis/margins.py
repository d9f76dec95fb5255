"""Gain and delay margins of each tendon's loop, broken at its speed command, the other loops closed.

A disturbance d added to the command of tendon j acts as a reference step d / D, where D = dv_j/dr_j is direct. So the
command's response to its own reference gives sensitivity and loop without opening anything:

    S_j = G(r_j -> v_j) / D        L_j = 1 / S_j - 1        A_j(g) = A + (g - 1) B_j C_j / D

A_j(g) is the loop with the gain of tendon j times g. The g at which its spectral radius passes 1 is
found without L_j, as a check; `grows` finds it by the nonlinear simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import floor

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear import FrameModel, spectral_radius
from exodrake.analysis.operating import OperatingPoint
from exodrake.core.errors import InputError

MOST_GAIN, MOST_FRAMES = 1e3, 40.0  # where the searches end
POKE = 1e-4  # step of a reference that starts a small motion [N]


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of one tendon's loop.

    Attributes:
        channel: name of the tendon. frequency: (n,) [Hz] and loop: (n,) complex, the open loop L.
        gain_margin: factor on the loop gain at the limit of stability, from L; gain_limit: the same from the poles.
        phase_margin: [rad] and crossover: [Hz], at the crossover with the least delay margin.
        delay_margin: extra delay at the limit [s], from L. delay_limit: the same [s] from the poles, the command of a
            fractional number of frames ago taken by a straight line between two; nan if none below 40 frames.
        peak_sensitivity: largest |S|; its inverse is the distance of L from -1.
    """

    channel: str
    frequency: np.ndarray
    loop: np.ndarray
    gain_margin: float
    gain_limit: float
    phase_margin: float
    crossover: float
    delay_margin: float
    delay_limit: float
    peak_sensitivity: float


def command_of(model: FrameModel, channel: str) -> tuple[int, int]:
    """Indices of a tendon's speed command and reference. InputError where the command ignores the reference."""
    row, column = model.outputs.index(f"speed_cmd_{channel}"), model.inputs.index(f"tension_ref_{channel}")
    if model.D[row, column] == 0.0:
        raise InputError(
            f"the speed command of {channel} does not answer to its reference (kp = 0): there is no loop to break"
        )
    return row, column


def open_loop(model: FrameModel, channel: str, frequency: np.ndarray) -> np.ndarray:
    """L (n,) of a tendon's loop at frequencies [Hz], the other loops closed."""
    row, column = command_of(model, channel)
    return model.D[row, column] / model.response(frequency)[:, row, column] - 1.0


def scaled_loop(model: FrameModel, channel: str, factor: float) -> np.ndarray:
    """A (n, n) with the loop gain of a tendon times a factor."""
    row, column = command_of(model, channel)
    return model.A + (factor - 1.0) * np.outer(model.B[:, column], model.C[row]) / model.D[row, column]


def delayed_loop(model: FrameModel, channel: str, frames: float) -> np.ndarray:
    """A of the loop with a tendon's command late by `frames` (fractional: a straight line between two commands)."""
    row, column = command_of(model, channel)
    whole, n = floor(frames), len(model.A)
    depth = whole + 1  # commands of 1 .. depth frames ago
    push, command = model.B[:, column] / model.D[row, column], model.C[row]
    a = np.zeros((n + depth, n + depth))
    a[:n, :n] = model.A - np.outer(push, command)
    a[n, :n] = command
    a[n + 1 :, n:-1] = np.eye(depth - 1)
    for age, share in ((whole, 1.0 - frames + whole), (whole + 1, frames - whole)):
        if age == 0:
            a[:n, :n] += share * np.outer(push, command)
        else:
            a[:n, n + age - 1] += share * push
    return a


def bisected(passes, low: float, high: float) -> float:
    """Where `passes` turns from False at low to True, on a fine grid and then by bisection; nan if not before high."""
    grid = np.linspace(low, high, 80) if low <= 0.0 else np.geomspace(low, high, 80)
    above = next((k for k, value in enumerate(grid) if passes(value)), None)
    if above is None:
        return float("nan")
    if above == 0:
        return float(grid[0])
    low, high = grid[above - 1], grid[above]
    while high - low > 1e-7 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if passes(middle) else (middle, high)
    return float(high)


def gain_limit(model: FrameModel, channel: str) -> float:
    """Factor > 1 on a tendon's loop gain at which the spectral radius passes 1; nan if none below 1000."""
    return bisected(lambda g: spectral_radius(scaled_loop(model, channel, g)) >= 1.0, 1.0, MOST_GAIN)


def delay_limit(model: FrameModel, channel: str) -> float:
    """Extra frames of delay in a tendon's loop at which the spectral radius passes 1; nan if none below 40."""
    return bisected(lambda d: spectral_radius(delayed_loop(model, channel, d)) >= 1.0, 0.0, MOST_FRAMES)


def gain_margin(loop: np.ndarray) -> float:
    """Smallest factor > 1 that puts the open loop L (n,), sampled up to Nyquist (real there), on -1; inf if none."""
    reals = [float(loop[-1].real)]
    for a, b in pairwise(loop):
        if a.imag * b.imag <= 0.0 and a.imag != b.imag:
            reals.append(float(a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)))
    return min((-1.0 / real for real in reals if -1.0 < real < 0.0), default=float("inf"))


def phase_margin(frequency: np.ndarray, loop: np.ndarray) -> tuple[float, float, float]:
    """Phase margin [rad], crossover [Hz] and delay margin [s] at the crossover |L| = 1 with the least delay margin."""
    best = (float("inf"), float("nan"), float("inf"))
    size = np.log(np.abs(loop))
    for k in np.flatnonzero(size[:-1] * size[1:] <= 0.0):
        share = size[k] / (size[k] - size[k + 1])
        here = frequency[k] + share * (frequency[k + 1] - frequency[k])
        margin = float(np.angle(-(loop[k] + share * (loop[k + 1] - loop[k])))) % (2.0 * np.pi)
        if margin / (2.0 * np.pi * here) < best[2]:
            best = (margin, float(here), margin / (2.0 * np.pi * here))
    return best


def margins(model: FrameModel, channel: str) -> Margins:
    """Margins of a tendon's loop at an operating point. InputError where its command ignores the reference."""
    frequency = np.concatenate([np.geomspace(1e-3, 1.0, 300), np.linspace(1.0, 0.5 / model.period, 1500)[1:]])
    response = open_loop(model, channel, frequency)
    margin, crossover, delay = phase_margin(frequency, response)
    return Margins(
        channel, frequency, response, gain_margin(response), gain_limit(model, channel), margin, crossover, delay,
        delay_limit(model, channel) * model.period, float(np.abs(1.0 / (1.0 + response)).max()),
    )  # fmt: skip


def grows(loop: FrameMap, point: OperatingPoint, channel: int, factor: float, frames: int = 400) -> bool:
    """Whether a small motion grows in the nonlinear simulation with the loop gain of a tendon times a factor.

    The reference is moved each frame so that the command becomes `factor` times what the controller would have sent.
    """
    step, rows = loop.stepper(), loop.signals["speed_cmd"].start + channel
    x, r = point.state.copy(), point.references.copy()
    r[channel] += POKE
    direct = (step(x, r)[1][rows] - step(x, point.references)[1][rows]) / POKE
    size = np.zeros(frames)
    for n in range(frames):
        reference = point.references.copy()
        reference[channel] += POKE if n == 0 else 0.0
        reference[channel] += (factor - 1.0) * step(x, reference)[1][rows] / direct
        x, signals = step(x, reference)
        size[n] = np.abs(signals[loop.signals["tension"]] - point.tension).max()
    quarter = frames // 4
    return bool(size[-quarter:].max() > size[quarter : 2 * quarter].max())
