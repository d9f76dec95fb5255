"""Populations of robots: drawn within the tolerances of the robot file, or within the intervals of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.special import ndtri

from exodrake.core.confidence import NORMAL_90
from exodrake.core.draws import drawn_robot
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot


def within_tolerances(robot: Robot, draws: int, seed: int = 0) -> Iterator[tuple[str, Robot]]:
    """Robots within the tolerances, with labels."""
    for k in range(draws):
        yield f"draw {k + 1}", drawn_robot(robot, np.random.default_rng([seed, k]))


def within_intervals(robot: Robot, answer: Mapping[str, Any], draws: int, seed: int = 0) -> Iterator[tuple[str, Robot]]:
    """Robots within the 90 % intervals of the effects that a diagnosis named, with labels.

    Args:
        robot: the improved robot of that diagnosis, or the nominal one.
        answer: the diagnosis as `exodrake diagnose --json` writes it.
        draws: number of robots.
        seed: of the draws; each parameter is normal on either side of its value, and inside its interval.

    Raises:
        InputError: the answer has no effects, or names parameters that the robot lacks.
    """
    effects = answer.get("effects") if isinstance(answer, Mapping) else None
    if not isinstance(effects, list):
        raise InputError("the diagnosis holds no list of effects: not an answer of exodrake diagnose --json")
    if not effects:
        raise InputError("the diagnosis names no effect, so there are no intervals to draw from")
    for k in range(draws):
        rng, drawn = np.random.default_rng([seed, k]), robot
        for effect in effects:
            try:
                values: dict[str, Any] = {n: within(i, rng) for n, i in effect["parameters"].items()}
                values |= {n: {c: within(i, rng) for c, i in at.items()} for n, at in effect["channels"].items()}
                channels = [*effect["wires"], *effect["joints"]]
                drawn = drawn.splice(effect["id"], values, channels)
            except (KeyError, TypeError, AttributeError):
                raise InputError("the diagnosis states an effect without id, parameters and intervals") from None
        yield f"draw {k + 1}", drawn


def within(interval: Mapping[str, float], rng: np.random.Generator) -> float:
    """A value inside a 90 % interval, normal on either side of the estimate: tails could leave what a robot can be."""
    value, x = interval["value"], float(ndtri(rng.uniform(0.05, 0.95)))
    return value + x * ((interval["high"] - value) if x > 0.0 else (value - interval["low"])) / NORMAL_90
