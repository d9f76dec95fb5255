"""Plans: mode and object size -> posture -> tensions, and the part of the posture that the tendons cannot hold.

plan = plan_grasp("caging", 0.06)
plan.tensions, plan.planned, plan.feasible, plan.reason
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.core.text import short_repr
from exodrake.grasping.hand import Hand, Mode, check_size, mode_of
from exodrake.grasping.inverse_kinematics import Candidates, bounds, candidates, joints
from exodrake.grasping.inverse_statics import holdable, project, ramped, reachable
from exodrake.grasping.trial import confirmed
from exodrake.machines.robot_file import robot_or_default
from exodrake.physics.finger_statics import parameters_of
from exodrake.physics.tendon_finger import Parameters
from exodrake.simulation.protocols import grasp

TOLERANCE = 0.02  # rad, a shortfall below this still counts as the posture: the estimator's error is larger
GAP = 0.01  # m off the thumb that count in a cage like 1 rad


@short_repr
@dataclass(frozen=True)
class Plan:
    """A planned grasp.

    Attributes:
        mode: its name.
        size: diameter of the object [m].
        target, centre: fingertip, and centre of the object, as (x, y palmar) [m], MCP in the origin.
        wanted: joint angles by inverse kinematics [rad].
        tensions: [N] per tendon.
        planned: joint angles that the tensions hold, from rest along the ramp [rad].
        shortfall: wanted less planned, the infeasible part [rad].
        feasible: whether no joint falls short by more than TOLERANCE.
        reason: why, in a sentence.
        tendons, joints: names.
        hand: thumb and skin.
    """

    mode: str
    size: float
    target: tuple[float, float]
    centre: tuple[float, float]
    wanted: tuple[float, ...]
    tensions: tuple[float, ...]
    planned: tuple[float, ...]
    shortfall: tuple[float, ...]
    feasible: bool
    reason: str
    tendons: tuple[str, ...]
    joints: tuple[str, ...]
    hand: Hand

    def reference(self, robot: Robot | None = None, **durations: float) -> Reference:
        """Tension references for the Diagram: rest, approach, hold, release; durations as in `exo.grasp` [s]."""
        return grasp(self.mode, robot_or_default(robot), dict(zip(self.tendons, self.tensions)), **durations)


def plan_grasp(mode: str, size: float, robot: Robot | None = None, hand: Hand | None = None) -> Plan:
    """Plan a grasp of a round object.

    Args:
        mode: caging, narrow-pinch or wide-pinch.
        size: diameter of the object [m].
        robot: the built-in one by default.
        hand: thumb and skin.

    Raises:
        InputError: an unknown mode, a size that is not a length, or beyond the span of finger and thumb.
    """
    robot, hand = robot_or_default(robot), hand or Hand()
    way, n, (low, high) = mode_of(mode), parameters_of(robot), robot.reference_limits()
    size = check_size(size, hand, n)
    found = candidates(way, size, hand, n)
    allowed = np.flatnonzero(found.miss <= 0.0)
    cost, confirm = cost_of(way, found, n), partial(confirmed, robot.without_effects())
    best = holdable(found.angles[allowed], cost[allowed], low, high, n, confirm) if len(allowed) else None
    if best is not None:
        place, tension = int(allowed[best[0]]), np.clip(best[1], low, high)
        wanted, planned = found.angles[place], ramped(tension, low, n)
    else:
        cloud = reachable(low, high, n)
        place = nearest_candidate(found, allowed, cloud[1])
        wanted = np.clip(found.angles[place], *bounds(way, hand, n))
        tension, planned = project(wanted, cloud, low, high, n, confirm)
    shortfall = wanted - planned
    touched = len(allowed) > 0
    feasible = bool(touched and np.abs(shortfall).max() <= TOLERANCE)
    reason = words(robot, way, size, touched, feasible, shortfall, tension)
    return Plan(
        way.name, size, pair(joints(wanted, n)[3]), pair(found.centre[place]), values(wanted), values(tension),
        values(planned), values(shortfall), feasible, reason, robot.machine.axes.tendons, robot.machine.axes.joints,
        hand,
    )  # fmt: skip


def cost_of(mode: Mode, found: Candidates, n: Parameters) -> np.ndarray:
    """Cost of each posture (k,) [-]: weighted departure from rest, and distance of a caged object from the thumb."""
    away = (found.angles - np.array(n.q0)) ** 2 @ np.array(mode.weight)
    return away + (np.maximum(found.gap, 0.0) / GAP) ** 2


def nearest_candidate(found: Candidates, allowed: np.ndarray, held: np.ndarray) -> int:
    """Index of the admissible posture nearest those that the tendons hold (k, 3) [rad]; else of the least miss."""
    from scipy.spatial import KDTree

    if not len(allowed):
        return int(found.miss.argmin())
    return int(allowed[KDTree(held).query(found.angles[allowed])[0].argmin()])


def words(
    robot: Robot, mode: Mode, size: float, touched: bool, feasible: bool, shortfall: np.ndarray, tension: np.ndarray
) -> str:
    """Say why a grasp is feasible or not; shortfall (3,) [N] and tension (3,) [N]."""
    axes, (low, high) = robot.machine.axes, robot.reference_limits()
    if feasible:
        return "the tendons hold it within F_min .. F_max, and the ramp leads to it"
    what = f"{mode.name.replace('-', ' ')} of {1e3 * size:g} mm"
    if not touched:
        does = "closes round it" if mode.wraps else "brings it against the thumb"
        return f"{what} is out of reach: no posture within the limits of joints and mode {does}"
    short = ", ".join(f"{j} {v:+.3f} rad" for j, v in zip(axes.joints, shortfall) if abs(v) > TOLERANCE)
    at = [f"{w} at F_min" for w, t, a in zip(axes.tendons, tension, low) if t < a + 0.01]
    at += [f"{w} at F_max" for w, t, b in zip(axes.tendons, tension, high) if t > b - 0.01]
    cause = (
        f"; the nearest they hold has {' and '.join(at)}" if at else "; nearer ones are not stable or not on the ramp"
    )
    return f"{what} is out of the tendons' reach: no tensions hold the posture, which falls short by {short}{cause}"


def pair(point: complex) -> tuple[float, float]:
    """A point as (x, y) [m]."""
    return float(point.real), float(point.imag)


def values(array: np.ndarray) -> tuple[float, ...]:
    """Convert an array (n,) [SI] to floats."""
    return tuple(float(v) for v in array)
