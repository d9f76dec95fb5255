"""Gain, phase, delay and disk margins of each channel's loop, opened at its command, the other loops closed.

Margins of an unstable loop mean nothing and are NaN. Where a loop is stable, they are found twice: from the open loop
L, and from the poles with the command of the channel scaled or late. The encirclements of -1 count the unstable poles
once more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from exodrake.analysis.disk_margin import disk_margin
from exodrake.analysis.linear_model import OUTSIDE, spectral_radius
from exodrake.analysis.open_loop import OpenLoop

MOST_GAIN, LEAST_GAIN, MOST_FRAMES = 1e3, 1e-3, 40.0  # where the searches end
ALMOST_REAL = 0.02
NAN = float("nan")


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of one channel's loop; NaN where the closed loop is unstable.

    Attributes:
        channel: its name.
        frequency: (n,) [Hz] and loop: (n,) complex, the open loop L.
        gain_margin: factor > 1 on the loop gain at the limit of stability, from L.
        gain_limit: the same from the poles.
        gain_low: factor < 1 at which a conditionally stable loop loses stability, from L; 0 where it does not.
        gain_low_limit: the same from the poles.
        phase_margin: [rad] and crossover: [Hz], at the crossover with the least delay margin.
        delay_margin: extra delay at the limit [s], from L.
        delay_limit: the same [s] from the poles, the command of a fractional number of frames ago taken by a straight
            line between two; nan if none below 40 frames.
        disk_margin: gain and phase at once, balanced (`disk_margin`).
        peak_sensitivity: largest |S|; its inverse is the distance of L from -1.
        encirclements: of -1 by L, counter-clockwise.
        open_unstable, closed_unstable: poles outside the unit circle.
    """

    channel: str
    frequency: np.ndarray
    loop: np.ndarray
    gain_margin: float
    gain_limit: float
    gain_low: float
    gain_low_limit: float
    phase_margin: float
    crossover: float
    delay_margin: float
    delay_limit: float
    disk_margin: float
    peak_sensitivity: float
    encirclements: int
    open_unstable: int
    closed_unstable: int

    @property
    def consistent(self) -> bool:
        """Whether the encirclements count as many unstable poles as the eigenvalues (Nyquist)."""
        return self.closed_unstable == self.open_unstable - self.encirclements


def limit_of(radius: Callable[[float], float], low: float, high: float) -> float:
    """Value at which a spectral radius passes 1 from low towards high (grid, then Brent's method); nan if none."""
    from scipy.optimize import brentq

    def beyond(x: float) -> float:
        return radius(x) - 1.0 - OUTSIDE

    grid = np.linspace(low, high, 80) if low == 0.0 else np.geomspace(low, high, 80)
    above = next((k for k, x in enumerate(grid) if beyond(x) > 0.0), None)
    if above is None:
        return NAN
    return float(brentq(beyond, grid[above - 1], grid[above], rtol=1e-7)) if above else low  # pyright: ignore


def gain_limit(one: OpenLoop, far: float = MOST_GAIN) -> float:
    """Factor on the gain of a single loop, from 1 towards `far`, at which the spectral radius passes 1; nan if none."""
    return limit_of(lambda g: spectral_radius(one.closed(g)), 1.0, far)


def delay_limit(one: OpenLoop) -> float:
    """Frames of delay in a single loop at which the spectral radius passes 1; nan if none below 40."""
    return limit_of(lambda d: spectral_radius(one.delayed(d)), 0.0, MOST_FRAMES)


def gain_margins(loop: np.ndarray) -> tuple[float, float]:
    """Largest factor < 1 and smallest > 1 that put L (n,) [-], sampled up to Nyquist (real there), on -1; 0 and inf."""
    reals = [float(loop[-1].real)]
    if abs(loop[0].imag) < ALMOST_REAL * abs(loop[0].real):  # a loop without integrator begins on the real axis
        reals.append(float(loop[0].real))
    for a, b in pairwise(loop):
        if a.imag * b.imag <= 0.0 and a.imag != b.imag:
            reals.append(float(a.real - a.imag * (b.real - a.real) / (b.imag - a.imag)))
    factors = [-1.0 / real for real in reals if real < 0.0]
    return max((g for g in factors if LEAST_GAIN < g < 1.0), default=0.0), min(
        (g for g in factors if g > 1.0), default=np.inf
    )


def phase_margin(frequency: np.ndarray, loop: np.ndarray) -> tuple[float, float, float]:
    """Phase margin [rad], crossover [Hz] and delay margin [s] of L (n,) at the crossover of least delay margin."""
    best = (float("inf"), NAN, float("inf"))
    size = np.log(np.maximum(np.abs(loop), np.finfo(float).tiny))
    for k in np.flatnonzero(size[:-1] * size[1:] <= 0.0):
        share = size[k] / (size[k] - size[k + 1]) if size[k] != size[k + 1] else 0.0
        here = frequency[k] + share * (frequency[k + 1] - frequency[k])
        margin = float(np.angle(-(loop[k] + share * (loop[k + 1] - loop[k])))) % (2.0 * np.pi)
        if margin / (2.0 * np.pi * here) < best[2]:
            best = (margin, float(here), float(margin / (2.0 * np.pi * here)))
    return best


def margins(whole: OpenLoop, channel: int) -> Margins:
    """Margins of a channel's loop (its index); NaN where the closed loop is unstable, or the two counts disagree."""
    one, frequency = whole.single(channel), whole.frequency
    response = one.ratio(frequency)[:, 0, 0]
    counts = one.encirclements(), one.outside(one.A), one.outside(one.closed())
    name = whole.channels[channel]
    if counts[2] or counts[2] != counts[1] - counts[0] or not np.abs(response).max() > 0.0:
        return Margins(name, frequency, response, *(NAN,) * 10, *counts)  # pyright: ignore
    low, high = gain_margins(response)
    margin, crossover, delay = phase_margin(frequency, response)
    sensitivity = 1.0 / (1.0 + response)
    low_limit = gain_limit(one, LEAST_GAIN)
    return Margins(
        name, frequency, response, high, gain_limit(one), low, 0.0 if np.isnan(low_limit) else low_limit, margin,
        crossover, delay, delay_limit(one) * whole.period, float(disk_margin(sensitivity[:, None, None]).min()),
        float(np.abs(sensitivity).max()), *counts,
    )  # fmt: skip
