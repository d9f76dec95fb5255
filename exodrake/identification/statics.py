"""The maximum tension of each tendon from logs (Section 2.3 of the paper): `docs/explain/identification.md`."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binned_statistic

from exodrake.core.errors import InputError, argument
from exodrake.data.log import Log
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.robot import Robot

SHARE = 0.2  # of the largest gain of movement per newton, below which joints count as at their stops: assumed
BINS = 25  # of tension, over which readings are averaged: 0.5 N each for a ramp of 12 N
RAMP_ROWS = 4 * BINS  # fewest rows of a ramp


@dataclass(frozen=True)
class MaximumTension:
    """The tension of a tendon that maximises the movement."""

    tendon: str
    tension: float  # at which the joints hardly move any more, or the largest one held [N]
    saturated: bool  # whether they hardly move any more
    travel: dict[str, float]  # by joint its angle at that tension less the one at the start of the ramp [rad]


def find_maximum_tension(log: Log, robot: Robot | None = None) -> tuple[MaximumTension, ...]:
    """The maximum tension of each tendon.

    Args:
        log: of the protocol `maximum-tension`, or another in which each tendon ramps up while the others stand at their
            lowest reference; columns tension_ref, tension [N] and angle [rad].
        robot: whose tendons and joints those are; the built-in one if None.

    Raises:
        InputError: a column is missing, or a tendon does not ramp up alone.

    Examples:
        >>> import exodrake as exo
        >>> log = exo.simulate(exo.load_robot(), exo.maximum_tension(exo.load_robot()))
        >>> [(found.tendon, round(found.tension, 1)) for found in find_maximum_tension(log)]
        [('AF', 11.9), ('MF', 8.0), ('AE', 8.0)]
    """
    log, axes = argument("log", log, Log), robot_or_default(robot).machine.axes
    reference, tension = log.array("tension_ref", axes.tendons), log.array("tension", axes.tendons)
    angle = log.array("angle", axes.joints)
    steps = np.diff(reference, axis=0, prepend=reference[:1])
    lowest, found = np.nanmin(reference, axis=0), []
    for i, tendon in enumerate(axes.tendons):
        alone = (np.delete(reference - lowest, i, axis=1) <= 0.0).all(axis=1)
        whole = np.isfinite(tension[:, i]) & np.isfinite(angle).all(axis=1)
        rows = np.flatnonzero((steps[:, i] >= 0.0) & (reference[:, i] > lowest[i]) & alone & whole)
        if len(rows) < RAMP_ROWS:
            raise InputError(
                f"{log.label}: {tendon} ramps up alone in {len(rows)} complete rows, wanted {RAMP_ROWS}; "
                "see the protocol maximum-tension"
            )
        pull = tension[rows, i]
        averages = binned_statistic(pull, [pull, *angle[rows].T], bins=BINS).statistic
        level, *posture = averages[:, np.isfinite(averages[0])]
        travel = np.transpose(posture) - np.transpose(posture)[0]
        gain = np.gradient(np.abs(travel).sum(axis=1), level)
        first = int(np.flatnonzero(gain >= SHARE * gain.max())[-1]) + 1
        at = min(first, len(level) - 1)
        moved = dict(zip(axes.joints, travel[at].tolist(), strict=True))
        found.append(MaximumTension(tendon, float(level[at]), first < len(level), moved))
    return tuple(found)
