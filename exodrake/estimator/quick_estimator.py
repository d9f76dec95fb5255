"""A small estimator of a robot, trained on some simulated sweeps."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.estimator.dataset import sweeps_from_logs
from exodrake.estimator.file import load
from exodrake.estimator.gp import Estimator, fit
from exodrake.simulation.protocols import sweeps
from exodrake.simulation.simulate import simulate

POINTS = 250  # training points: some s of training


def signature(robot: Robot) -> str:
    """Hash of a robot's parameter values: an estimator trained on others is not its own."""
    return sha256(np.ascontiguousarray(robot.values).tobytes()).hexdigest()


def quick_estimator(robot: Robot, cache: Path | None = None) -> Estimator:
    """An estimator trained on simulated sweeps, or the one kept in a file.

    Args:
        robot: to be simulated; it should have no effects.
        cache: file of an estimator. It is used if it belongs to the same parameter values; it is never written.
    """
    if cache is not None and cache.is_file():
        try:
            return load(cache, signature(robot))
        except InputError:
            pass
    training = sweeps_from_logs([simulate(robot, sweeps(robot), seed=0)])
    return replace(fit(training, POINTS), robot=signature(robot))
