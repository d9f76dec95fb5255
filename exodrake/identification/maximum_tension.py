"""Maximum tension of each tendon, from slow ramps: the first step of the paper's experiment (Section 2.3).

The paper measures first "the maximum tension magnitude that maximizes the finger movement", and then sweeps each tendon
against 0, 33, 66 and 100 % of it. While one tendon ramps up, the movement is the sum over the joints of |q - q_start|.
Its gain per newton falls where joints come to their end stops. The maximum tension is the one from which on the gain
stays below `SHARE` of the largest gain.

    log = exo.simulate(robot, exo.maximum_tension(robot))
    for one in exo.find_maximum_tension(log, robot):
        print(one.tendon, one.tension, one.saturated)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError, argument
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.machines.robot_file import robot_or_default

SHARE = 0.2  # of the largest gain of movement per newton, below which joints count as at their stops: assumed
BINS = 25  # of tension, over which readings are averaged: 0.5 N each for a ramp of 12 N
ROWS = 4 * BINS  # fewest rows of a ramp


@dataclass(frozen=True)
class MaximumTension:
    """The tension of a tendon that maximises the movement.

    Attributes:
        tendon: its name.
        tension: at which the joints have all but stopped [N]; the largest one held where they have not.
        saturated: whether they have.
        travel: joint -> its angle at that tension less the one at the start of the ramp [rad].
    """

    tendon: str
    tension: float
    saturated: bool
    travel: dict[str, float]


def find_maximum_tension(log: Log, robot: Robot | None = None) -> tuple[MaximumTension, ...]:
    """The maximum tension of each tendon.

    Args:
        log: of the protocol `maximum-tension`, or another in which each tendon ramps up while the others stand at their
            lowest reference; columns tension_ref, tension [N] and angle [rad].
        robot: whose tendons and joints those are; the built-in one if None.

    Raises:
        InputError: a column is missing, or a tendon does not ramp up alone.
    """
    log, axes = argument("log", log, Log), robot_or_default(robot).machine.axes
    reference, tension = log.array("tension_ref", axes.tendons), log.array("tension", axes.tendons)
    angle = log.array("angle", axes.joints)
    steps = np.diff(reference, axis=0, prepend=reference[:1])
    lowest, found = np.nanmin(reference, axis=0), []
    for i, tendon in enumerate(axes.tendons):
        others = np.delete(np.arange(len(axes.tendons)), i)
        alone = (reference[:, others] <= lowest[others]).all(axis=1)
        whole = np.isfinite(tension[:, i]) & np.isfinite(angle).all(axis=1)
        up = (steps[:, i] >= 0.0) & (reference[:, i] > lowest[i])
        rows = np.flatnonzero(up & alone & whole)
        if len(rows) < ROWS:
            raise InputError(
                f"{log.label}: {tendon} ramps up alone in {len(rows)} complete rows, wanted {ROWS}; "
                "see the protocol maximum-tension"
            )
        at, saturated, moved = saturation(tension[rows, i], angle[rows])
        found.append(MaximumTension(tendon, at, saturated, dict(zip(axes.joints, moved.tolist(), strict=True))))
    return tuple(found)


def saturation(tension: np.ndarray, angle: np.ndarray) -> tuple[float, bool, np.ndarray]:
    """Where the movement along a ramp ends.

    Args:
        tension: (n,) of the ramping tendon [N].
        angle: (n, joints) [rad].

    Returns:
        The tension [N], whether the movement ends within the ramp, and the travel (joints,) there [rad].
    """
    edges = np.linspace(tension.min(), tension.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, tension, side="right") - 1, 0, BINS - 1)
    kept = np.unique(place)
    level = np.array([tension[place == k].mean() for k in kept])
    posture = np.array([angle[place == k].mean(axis=0) for k in kept])
    travel = posture - posture[0]
    gain = np.gradient(np.abs(travel).sum(axis=1), level)
    moving = np.flatnonzero(gain >= SHARE * gain.max())
    first = int(moving[-1]) + 1
    saturated = first < len(level)
    at = first if saturated else len(level) - 1
    return float(level[at]), saturated, travel[at]
