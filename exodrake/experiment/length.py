"""Length of an experiment."""

from __future__ import annotations

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.experiment.stage import check_limits

SHORTEST, LONGEST, DEFAULT = 20.0, 60.0, 60.0  # s of an experiment
FEWEST, MOST = 60, 200  # frames of one, for a machine whose frames are long: assumed


def check_length(robot: Robot, duration: float | None) -> None:
    """InputError for a length [s] out of range, and for a machine whose references have no limits."""
    check_limits(robot)
    if duration is not None:
        frames_of(duration, robot.machine.frame)


def frames_of(duration: float, frame: float) -> int:
    """Frames of an experiment; InputError for a length out of range."""
    low, high = max(SHORTEST, FEWEST * frame), max(LONGEST, MOST * frame)
    if not low <= duration <= high:
        raise InputError(f"--duration {duration:g}: wanted {low:g} to {high:g} s for this machine")
    return round(duration / frame)


def default_duration(frame: float) -> float:
    """Default length [s] of an experiment."""
    return max(DEFAULT, 2.0 * FEWEST * frame)
