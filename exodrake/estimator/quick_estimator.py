"""A small estimator of a robot, trained on some simulated sweeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from exodrake.core.errors import InputError
from exodrake.core.provenance import robot_digest
from exodrake.core.robot import Robot
from exodrake.estimator.dataset import sweeps_from_logs
from exodrake.estimator.file import load
from exodrake.estimator.gp import Estimator, fit
from exodrake.simulation.protocols import sweeps
from exodrake.simulation.simulate import simulate

POINTS = 250  # training points: some s of training


def quick_estimator(robot: Robot, cache: Path | None = None) -> Estimator:
    """An estimator trained on simulated sweeps, or the one kept in a file.

    Args:
        robot: to be simulated; it should have no effects.
        cache: file of an estimator. It is used if it belongs to the same robot; it is never written.
    """
    if cache is not None and cache.is_file():
        try:
            return load(cache, robot_digest(robot))
        except InputError:
            pass
    training = sweeps_from_logs([simulate(robot, sweeps(robot), seed=0)])
    return replace(fit(training, POINTS), robot=robot_digest(robot))
