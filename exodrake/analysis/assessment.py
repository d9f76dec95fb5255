"""Assessment of a controller on a robot: nonlinear steps and linear margins, the worst over points and tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.operating_point import operating_point
from exodrake.analysis.populations import within_tolerances
from exodrake.analysis.robustness import Band, band, points_band
from exodrake.analysis.step_response import StepResponse, step_response
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

SEED = 2  # of the robots within the tolerances: others than the search sees
NOISE_FACTOR = 2.0  # noise of the commands that is allowed by default, in units of what the robot has: assumed


@short_repr
@dataclass(frozen=True)
class Requirements:
    """Requirements on a closed loop; among controllers that hold them the fastest to settle is the best.

    Attributes:
        settling: longest settling time to 2 % of a step [s]; None: as short as possible.
        overshoot: largest overshoot as a fraction of a step.
        disk_margin: least disk margin of all commands at once.
        noise: largest standard deviation of a command [SI]; None: that of the robot as it is, times `NOISE_FACTOR`.
    """

    settling: float | None = None
    overshoot: float = 0.05
    disk_margin: float = 0.6
    noise: float | None = None

    def __post_init__(self) -> None:
        """Raise InputError for a requirement that is negative or no number."""
        for name, value in vars(self).items():
            if value is not None and not value >= 0.0:
                raise InputError(f"{name.replace('_', ' ')} is {value:g}, wanted a number from 0")


@short_repr
@dataclass(frozen=True, eq=False)
class Tuned:
    """A tuned controller with its assessment on the robot.

    Attributes:
        name: of its structure.
        robot: with it.
        gains: parameter -> value [SI] that was searched.
        steps: nonlinear, of the robot itself at its own operating point.
        bands: over tolerances and operating points.
        settling [s], overshoot, disk_margin, noise [SI]: the worst of these; nan where one is unstable.
        missed: requirements that it does not hold, a phrase each.
    """

    name: str
    robot: Robot
    gains: dict[str, float]
    steps: tuple[StepResponse, ...]
    bands: tuple[Band, ...]
    settling: float
    overshoot: float
    disk_margin: float
    noise: float
    missed: tuple[str, ...]


def assessed(name: str, robot: Robot, gains: dict[str, float], wanted: Requirements, draws: int) -> Tuned:
    """Assessment of a loop by nonlinear steps and linear margins, over operating points and tolerances."""
    loop = FrameMap.of(robot)
    point = operating_point(loop)
    steps = tuple(step_response(loop, point, j) for j in range(len(loop.channels)))
    bands = (points_band(robot), band("tolerances", within_tolerances(robot, draws, SEED)))
    members = list(chain.from_iterable(b.members for b in bands))
    kind, unit = loop.column(loop.loop.command), robot.machine.signal[loop.loop.command].unit

    def worst(prefix: str, suffix: str, most: bool = True) -> float:
        names = [f"{prefix} {c}{suffix}" if prefix else suffix for c in loop.channels]
        found = [m.numbers.get(n, np.nan) for m in members for n in names]
        return float(np.max(found) if most else np.min(found))

    settling, overshoot = worst("settling", " [s]"), worst("overshoot", "")
    disk, noise = worst("", "disk margin", most=False), worst(f"noise of {kind}", f" [{unit}]")
    missed = missed_of(wanted, settling, overshoot, disk, noise, unit)
    if failures := sum(len(b.failures) for b in bands):
        missed = (*missed, f"{failures} robots without rest")
    return Tuned(name, robot, gains, steps, bands, settling, overshoot, disk, noise, missed)


def missed_of(
    wanted: Requirements, settling: float, overshoot: float, disk: float, noise: float, unit: str
) -> tuple[str, ...]:
    """The requirements that are not held, a phrase each; nan holds nothing."""
    missed = []
    if not np.isfinite(settling):
        missed.append("does not settle")
    elif wanted.settling is not None and settling > wanted.settling:
        missed.append(f"settles in {settling:.3g} s")
    if not overshoot <= wanted.overshoot:
        missed.append(f"overshoots {100.0 * overshoot:.2g} %")
    if not disk >= wanted.disk_margin:
        missed.append(f"disk margin {disk:.2g}")
    if wanted.noise is not None and not noise <= wanted.noise:
        missed.append(f"command noise {noise:.2g} {unit}")
    return tuple(missed)
