"""The cheapest further experiment, found by simulation, that would tell inseparable effects apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.simulation.references import protocol

DISCRIMINATES = 1.0  # noise standard deviations: a difference of this size is seen within seconds


def menu(problem: Problem) -> dict[str, Reference]:
    """Experiments that the machine declares, cheapest first, or its own motion at other sizes and speeds."""
    robot = problem.robot
    if robot.machine.experiments:
        return {name: protocol(text, robot) for name, text in robot.machine.experiments.items()}
    own = problem.fit[0].reference
    rest = own[0]
    return {
        "the same motion, twice as fast": Reference(own[::2], "faster"),
        "the same motion at half size": Reference(rest + 0.5 * (own - rest), "smaller"),
        "the same motion, half as fast": Reference(np.repeat(own, 2, axis=0), "slower"),
    }


def next_experiment(problem: Problem, rows: np.ndarray, names: list[str]) -> dict[str, Any]:
    """The experiment with the largest simulated difference between the rivals.

    Args: rows: flat numbers of the rivals (rivals, numbers). Returns protocol, duration [s] and difference [noise_std]
    between the closest pair.
    """
    best: dict[str, Any] = {}
    for name, reference in menu(problem).items():
        trial = Trial(
            name, "holdout", reference.tension, np.full((len(reference.tension), len(problem.columns)), np.nan)
        )
        logs = problem.predict(rows, trial) / problem.noise_std
        apart = min(
            float(np.sqrt(np.mean((logs[i] - logs[k]) ** 2))) for i in range(len(rows)) for k in range(i + 1, len(rows))
        )
        seconds = len(reference.tension) * problem.robot.machine.frame
        if not best or apart > best["difference_in_floors"]:
            best = {"protocol": name, "seconds": seconds, "difference_in_floors": apart, "between": names}
    best["enough"] = best["difference_in_floors"] >= DISCRIMINATES
    if not best["enough"]:
        best["advice"] = "no motion of the free robot separates them: " + ADVICE
    return best


ADVICE = (
    "measure at a known state instead (mechanical stop for the encoder's zero, dead weights on a wire, clamped finger)"
)
