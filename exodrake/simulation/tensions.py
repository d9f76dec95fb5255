"""What all protocols share: the wires' limits, the clock of frames, checked numbers and seeded chance."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot


def smooth(share: np.ndarray) -> np.ndarray:
    """Minimum-jerk step from 0 to 1 while `share` goes from 0 to 1; same shape."""
    x = np.clip(share, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def clock(robot: Robot, **durations: float) -> np.ndarray:
    """Starts of the frames (frames,) [s] in the sum of these durations [s]; InputError naming a bad or too long one."""
    for name, value in durations.items():
        if not 0.0 <= value <= 86400.0:
            raise InputError(f"{name} is {value} s, wanted 0 to a day")
    frames = round(sum(durations.values()) / robot.machine.frame)
    if frames < 1:
        raise InputError(f"{' + '.join(durations)} is {sum(durations.values())} s, shorter than a frame")
    return robot.machine.frame * np.arange(frames)


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """InputError naming a number outside low .. high, or not a number."""
    if not low <= value <= high:
        raise InputError(f"{name} is {value} {unit}, wanted {low:g} to {high:g}")


def whole(name: str, value: float, high: int, unit: str) -> int:
    """A number of things from 1 to `high`; InputError naming one that is outside, or no whole number."""
    check_range(name, value, 1, high, unit)
    if value != int(value):
        raise InputError(f"{name} is {value} {unit}, wanted a whole number")
    return int(value)


def above_minimum(robot: Robot, tension: np.ndarray, name: str) -> Reference:
    """The reference of these tensions (frames, wires) [N], raised to the lower limit where they are below."""
    return Reference(np.maximum(tension, robot.reference_limits()[0]), name)


def generator(seed: int) -> np.random.Generator:
    """Seeded chance; InputError for a seed that is no whole number from 0."""
    if seed != int(seed) or seed < 0:
        raise InputError(f"seed is {seed}, wanted a whole number from 0")
    return np.random.default_rng(int(seed))
