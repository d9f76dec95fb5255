"""A control task and its cost, and how a controller is tuned for it on a robot of the model.

    J^2 = mean over frames and tendons of  ((F_ref - F) / F_max)^2 + weight (dv / v_max)^2

A linear-quadratic cost, as in model predictive control. Error and change dv of the command from frame to frame are each
relative to the largest value (Bryson's rule). J = 0.05 reads as 5 % of full scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.engine.inputs import Reference
from exodrake.model.machine import Controller
from exodrake.model.robot import Robot
from exodrake.reference.cases import grasps, holds
from exodrake.reference.robot import NOMINAL, TENSION_MAX, WIRES
from exodrake.simulation.simulate import run, write_log

WEIGHT = 1.0  # of the commands' changes beside the error [assumed]
SHARES = 0.5, 0.6  # of the usual durations of grasps and holds: 20 s and 24 s [assumed]
STRUCTURE = "PD"  # law of the reference simulator's controller
GRID = 6  # gains on a side of the first search; the simplex search that follows takes any
EVALUATIONS = 60  # of the simplex search
Gains = dict[str, float]  # parameter -> value [SI]
Tuner = Callable[[Robot, Reference, int], Gains]


def motion(seed: int, purpose: int) -> Reference:
    """Grasps, then steps between random levels; another draw for each purpose."""
    rng = np.random.default_rng([seed, purpose])
    return Reference(np.vstack([draw(rng, share).values for draw, share in zip((grasps, holds), SHARES)]), "task")


def cost(columns: Mapping[str, np.ndarray], reference: np.ndarray) -> float:
    """Cost of a run: column -> (n,) values [SI] of its log, and tension references (n, 3) [N]."""
    tension, command = (np.column_stack([columns[f"{kind}_{w}"] for w in WIRES]) for kind in ("tension", "speed_cmd"))
    error = (reference - tension) / TENSION_MAX
    change = np.diff(command, axis=0) / NOMINAL["speed_max"]["value"]
    squared = np.mean(error**2) + WEIGHT * np.mean(change**2)
    return float(np.sqrt(squared)) if np.isfinite(squared) else np.inf


def predicted(robot: Robot, gains: Mapping[str, float], task: Reference, seed: int) -> float:
    """Cost of a task on a robot of the model with these gains."""
    log = write_log(run(robot.with_parameters(gains), task, seed))
    return cost(log.signals, task.values)


def structure_of(robot: Robot) -> Controller:
    """The controller structure that both simulators know. InputError for another machine."""
    found = [c for c in robot.machine.loop.controllers if c.name == STRUCTURE] if robot.machine.loop else []
    if robot.machine.name != "exo_index" or not found:
        raise InputError(f"{robot.machine.name}: the reference simulator has the controller of exo_index only")
    return found[0]


def own_gains(robot: Robot) -> Gains:
    """The gains that a robot has."""
    return {gain.parameter: float(robot[gain.parameter]) for gain in structure_of(robot).gains}


def by_cost(robot: Robot, task: Reference, seed: int) -> Gains:
    """Gains of least cost: a grid over their logarithms, then a simplex search; never worse than the robot's own."""
    from scipy.optimize import minimize

    structure = structure_of(robot)
    bounds = np.log([(gain.low, gain.high) for gain in structure.gains])

    def gains_of(logs: Any) -> Gains:
        return {gain.parameter: float(value) for gain, value in zip(structure.gains, np.exp(logs))}

    def loss(logs: Any) -> float:
        return predicted(robot, gains_of(logs), task, seed)

    start = min(product(*(np.linspace(low, high, GRID) for low, high in bounds)), key=loss)
    options = {"maxfev": EVALUATIONS, "xatol": 1e-2, "fatol": 1e-5}
    found = minimize(loss, start, method="Nelder-Mead", bounds=bounds, options=options)
    own = own_gains(robot)
    return gains_of(found.x) if found.fun < predicted(robot, own, task, seed) else own


def by_requirements(robot: Robot, task: Reference, seed: int) -> Gains:
    """Gains as `exodrake tune` chooses them; the robot's own where it finds none that hold the requirements."""
    from exodrake.analysis.tuning import tune

    try:
        best = tune(robot, only=(STRUCTURE,)).best
    except InputError:  # no state of rest, as with a tremor
        best = None
    return best.gains if best else own_gains(robot)


TUNERS: dict[str, Tuner] = {"cost": by_cost, "requirements": by_requirements}
