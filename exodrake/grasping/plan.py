"""Plans: mode and object size -> posture -> tensions, and the part of the posture that the tendons cannot hold.

Postures that hold a round object of radius R are a closed form. Given a posture the statics are linear in the tensions,
P(q)^T T = tau_p(q): the paper's Eq. 22 corrected, with rest posture and end stops. T must also lie in F_min .. F_max,
the equilibrium be stable, which tension softens as arms grow with the angle, and the ramp lead to it: the nominal
robot, simulated without noise, must stand there at the hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import KDTree

from exodrake.core.errors import InputError, argument, nearest, short_repr
from exodrake.data.log import Log
from exodrake.data.plot import STYLE, add_legends, draw_panel, new_figure
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.display import choose_colour, find_display
from exodrake.model.robot import Robot
from exodrake.physics.finger import end_stop
from exodrake.physics.finger_statics import arms, follow, posture, read_parameters
from exodrake.physics.tendon_finger import Parameters
from exodrake.simulation.protocols import grasp, smooth
from exodrake.simulation.simulate import record, run, write_log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.estimator.gp import Estimator
    from exodrake.systems.posture_controller import PostureController

RAMP = 40  # postures along the approach
Confirm = Callable[[np.ndarray, np.ndarray], bool]
"""Whether these tensions (3,) [N] do lead to this posture (3,) [rad]."""

SAME = 2e-3  # rad, postures closer than this are one
STIFF = 0.4  # share of its passive stiffness that a joint keeps under tension, or it is too close to snapping
LEAD = 0.15  # share of the ramp by which extensors may run ahead of flexors or behind: tendons do not arrive together
EFFORT = 0.02  # rad2, what full tension of a tendon counts against a posture: no more co-contraction than it takes
NUDGE = 1e-5  # rad, of difference quotients
SINGULAR = 1e-12  # m3, |det P| below which tensions do not exist (`physics.md` 1.21: q2 = q3 with equal routers)
APART = 0.01  # rad between postures tried one after the other
STEPS, STARTS = 13, 4  # tensions per tendon tried, and starts of the least squares
REST, APPROACH, HOLD = 0.5, 1.0, 2.5  # s
LAST = 0.5  # s at the end of the hold, over which a posture is read
CLOSE = 0.03  # rad between plan and simulation
TOLERANCE = 0.02  # rad, a shortfall below this still counts as the posture: the estimator's error is larger
GAP = 0.01  # m off the thumb that count in a cage like 1 rad
KI = 0.5  # 1/s: a quarter of the tension loop's bandwidth, which settles in 1.8 s; assumed

GRID = 81  # points along each free direction
OFF = 0.9  # rad, how far a cage may stay off the thumb
DEPTH = 0.02  # m of penetration or of an open cage that count like 1 rad beyond a limit
REACH = 1.2  # rad beyond rest that the PIP bends at most in a pinch


@dataclass(frozen=True)
class Hand:
    """The thumb in the finger's plane, and how soft skin is; all values are assumed.

    The splint holds the thumb (paper, Section 2.1), but the paper does not say where. Here the nominal finger, which
    the tendons bend by some 0.7 rad at the MCP, meets objects of 20 to 90 mm.
    """

    thumb: tuple[float, float] = (0.030, 0.090)  # centre of its round tip (x, y palmar) [m]
    thumb_radius: float = 0.009  # of the tip [m]
    pad: float = 0.75  # where the distal phalanx touches in a pinch, as a fraction of its length
    soft: float = 0.0025  # how deep an object sinks into a pad [m]
    tissue: float = 0.15  # how far joints go beyond the onset of their end stops [rad]


@dataclass(frozen=True)
class Mode:
    """A way to grasp, with limits of the joint angles less the rest posture [rad].

    `weight` is the cost of each joint's departure from rest; `wraps` whether all phalanges touch, or the distal alone.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    weight: tuple[float, float, float]
    wraps: bool = False


# Paper, Section 2.2.2: "wide pinch, which only bends the PIP joint", narrow pinch by MCP flexion, caging by all joints.
# The others stay within STILL of rest, in flexion and in extension.
STILL = 0.1  # rad, assumed
NARROW = Mode("narrow-pinch", (-inf, -STILL, -STILL), (inf, STILL, STILL), (0.0, 1.0, 1.0))
WIDE = Mode("wide-pinch", (-STILL, 0.0, -STILL), (STILL, inf, STILL), (1.0, 0.0, 1.0))
CAGING = Mode("caging", (-inf, -inf, -inf), (inf, inf, inf), (0.0, 0.0, 0.0), wraps=True)
MODES = {mode.name: mode for mode in (CAGING, NARROW, WIDE)}


def find_mode(name: str) -> Mode:
    """The mode of that name, spaces or underscores allowed; InputError with the nearest one otherwise."""
    plain = "-".join(name.lower().replace("_", " ").replace("-", " ").split())
    if plain not in MODES:
        raise InputError(f"unknown grasp mode {name!r}{nearest(plain, list(MODES))}; there are {', '.join(MODES)}")
    return MODES[plain]


def check_size(size: float, hand: Hand, n: Parameters) -> float:
    """The size of an object [m]. InputError if it is not a length, or wider than finger and thumb can span."""
    span = abs(complex(*hand.thumb)) + sum(n.length) - hand.thumb_radius - n.radius[2]
    number = isinstance(size, (int, float, np.number)) and not isinstance(size, bool)
    if not (number and 0.0 < size <= span):
        wanted = f"wanted more than 0 and at most {span:.3f} m: finger and thumb span that"
        raise InputError(f"object size is {f'{size:g} m' if number else repr(size)}, {wanted}")
    return float(size)


def list_postures(
    mode: Mode, size: float, hand: Hand, n: Parameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All postures (k, 3) [rad] of a mode that touch an object of a size [m], admissible or not.

    With each go the object's complex centre (k,) [m], its gap (k,) to the thumb [m], and by how much (k,) the posture
    violates limits of joints or mode, penetrates a phalanx or lets the object out [rad, or m / DEPTH].

    The contacts fix the object's centre C in a frame of the straight proximal phalanx. In a pinch the pad touches at s
    along the distal phalanx; in a cage all phalanges do (`wrap_postures`). The MCP then turns C against the thumb's tip
    T of radius r_T by the law of cosines, in front of it. What is left free is a grid.

        C = L1 + L2 e^{i q2} + (s + i (R + r3)) e^{i (q2 + q3)}
        q1 = arg T - acos((|C|^2 + |T|^2 - (R + r_T)^2) / (2 |C| |T|)) - arg C
    """
    radius, thumb = size / 2.0, complex(*hand.thumb)
    low, high = bounds(mode, hand, n)
    if mode.wraps:
        bend, held, off = wrap_postures(radius, n)
    else:  # the pad touches, whatever PIP and DIP
        spans = [np.linspace(low[i], min(high[i], n.q0[i] + REACH), GRID) for i in (1, 2)]
        pip, dip = (axis.ravel() for axis in np.meshgrid(*spans))
        pad = hand.pad * n.length[2] + 1j * (radius + n.radius[2])
        held = n.length[0] + n.length[1] * np.exp(1j * pip) + pad * np.exp(1j * (pip + dip))
        bend, off = np.column_stack([pip, dip]), np.zeros(len(pip))
    touch = radius + hand.thumb_radius
    cosine = (np.abs(held) ** 2 + abs(thumb) ** 2 - touch**2) / (2.0 * np.abs(held) * abs(thumb))
    beyond = np.maximum(np.abs(cosine) - 1.0, 0.0)
    mcp = np.angle(thumb) - np.arccos(np.clip(cosine, -1.0, 1.0)) - np.angle(held) - off
    angles = np.column_stack([mcp, bend])
    centre = held * np.exp(1j * mcp)
    gap = np.abs(centre - thumb) - touch
    miss = np.maximum(np.maximum(low - angles, angles - high), 0.0).sum(axis=1)
    ends = joints(angles, n)
    bones = np.diff(ends, axis=1)
    along = (centre[:, None] - ends[:, :3]) * bones.conj() / np.abs(bones)
    away = np.abs(along - np.clip(along.real, 0.0, np.abs(bones)))
    pierced = (radius + np.array(n.radius) - away).max(axis=1)  # m, by which the object enters a phalanx
    miss += np.maximum(pierced - hand.soft, 0.0) / DEPTH
    if mode.wraps:
        opening = np.abs(ends[:, 3] - thumb) - n.radius[2] - hand.thumb_radius  # m, between fingertip and thumb
        miss += np.where(cosine < 0.0, beyond, 0.0) + np.maximum(opening - size, 0.0) / DEPTH
    else:
        miss += beyond
    return angles, centre, gap, miss


def bounds(mode: Mode, hand: Hand, n: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest joint angles (3,) [rad] of a mode."""
    rest = np.array(n.q0)
    low, high = np.array(n.q_e) - hand.tissue, np.array(n.q_f) + hand.tissue
    return np.maximum(low, rest + mode.low), np.minimum(high, rest + mode.high)


def wrap_postures(radius: float, n: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """PIP and DIP (k, 2) [rad], centre (k,) [m] and how far off the thumb (k,) [rad], all phalanges tangent.

    With contact at s along the middle phalanx and rho_i = R + r_i: h^2 = s^2 + rho_2^2, h'^2 = (L2 - s)^2 + rho_2^2,

        q2 = pi - atan2(rho_2, s) - asin(rho_1 / h)        q3 = pi - atan2(rho_2, L2 - s) - asin(rho_3 / h')
    """
    first, second, third = radius + np.array(n.radius)
    shortest = np.sqrt(max(first**2 - second**2, 0.0))
    along = np.linspace(min(shortest, n.length[1]), n.length[1], 2 * GRID)
    far = np.maximum(np.hypot(along, second), first)
    rest = n.length[1] - along
    beyond = np.maximum(np.hypot(rest, second), third)
    pip = np.pi - np.arctan2(second, along) - np.arcsin(first / far)
    dip = np.pi - np.arctan2(second, rest) - np.arcsin(third / beyond)
    near, end = np.sqrt(far**2 - first**2), np.sqrt(beyond**2 - third**2)
    on = (near <= n.length[0]) & (end <= n.length[2])
    on = on if on.any() else np.ones_like(on)
    held, bend = n.length[0] - near[on] + 1j * first, np.column_stack([pip, dip])[on]
    off = np.linspace(0.0, OFF, GRID // 2)
    return np.repeat(bend, len(off), axis=0), np.repeat(held, len(off)), np.tile(off, len(bend))


def joints(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """MCP, PIP, DIP and fingertip (..., 4) complex [m]; angles (..., 3) [rad]."""
    bones = np.array(n.length) * np.exp(1j * np.cumsum(angles, axis=-1))
    return np.concatenate([np.zeros_like(bones[..., :1]), np.cumsum(bones, axis=-1)], axis=-1)


def passive(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """Passive torque (k, 3) [N m] at angles (k, 3) [rad]."""
    ends = [np.array(values) for values in (n.q_f, n.q_e, n.beta, n.A)]
    stop = np.vectorize(end_stop, otypes=[float])(angles, *ends)
    return np.array(n.kappa) * (angles - np.array(n.q0)) + stop


def tensions_for(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """Tensions (k, 3) [N] in balance at postures (k, 3) [rad], of any sign and size; NaN where there are none."""
    transposed = np.swapaxes(arms(angles, n), 1, 2)
    exists = np.abs(np.linalg.det(transposed)) > SINGULAR
    found = np.full_like(angles, np.nan)
    found[exists] = np.linalg.solve(transposed[exists], passive(angles[exists], n)[..., None])[..., 0]
    return found


def stiffness(angles: np.ndarray, tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Stiffness of each joint under tension (k, 3) [N m/rad]: below 0 it snaps."""
    up, down = angles + NUDGE, angles - NUDGE
    pull = np.einsum("kji,kj->ki", arms(up, n) - arms(down, n), tension)
    return (passive(up, n) - passive(down, n) - pull) / (2.0 * NUDGE)


def ramp_posture(tension: np.ndarray, low: np.ndarray, n: Parameters, lead: float = 0.0) -> np.ndarray:
    """Posture (3,) [rad] at the end of a minimum-jerk ramp from `low` (3,), F_min, to tension (3,) [N].

    lead: share of the ramp by which the extensor runs ahead of the flexors.
    """
    ahead = np.array([-0.5, -0.5, 0.5]) * lead
    share = smooth(np.linspace(0.0, 1.0 + abs(lead), RAMP)[:, None] + ahead - 0.5 * abs(lead))
    return follow(low + share * (tension - low), n)[-1]


def steady(angles: np.ndarray, tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Whether postures (k, 3) [rad] stand safely under tensions (k, 3) [N], and are where a slow finger ends up."""
    firm = (stiffness(angles, tension, n) >= STIFF * np.array(n.kappa)).all(axis=1)
    firm[firm] = (np.abs(posture(tension[firm], n) - angles[firm]) < SAME).all(axis=1)
    return firm


def arrives(angles: np.ndarray, tension: np.ndarray, low: np.ndarray, n: Parameters) -> bool:
    """Whether the ramp leads to this posture (3,) [rad], also when flexors or extensor run ahead."""
    return all(np.abs(ramp_posture(tension, low, n, lead) - angles).max() < SAME for lead in (0.0, LEAD, -LEAD))


def holdable(
    angles: np.ndarray, cost: np.ndarray, low: np.ndarray, high: np.ndarray, n: Parameters, confirm: Confirm
) -> tuple[int, np.ndarray] | None:
    """Index and tensions (3,) [N] of the cheapest posture (k, 3) [rad] that is held and reached, or None.

    Tensions lie within low and high (3,) [N]; neighbours of a posture that fails are not tried.
    """
    tension = tensions_for(angles, n)
    inside = np.flatnonzero(((tension >= low) & (tension <= high)).all(axis=1))
    inside = inside[steady(angles[inside], tension[inside], n)]
    total = cost[inside] + EFFORT * ((tension[inside] - low) / (high - low)).sum(axis=1)
    left = inside[np.argsort(total, kind="stable")]
    while len(left):
        first = left[0]
        if arrives(angles[first], tension[first], low, n) and confirm(tension[first], angles[first]):
            return int(first), tension[first]
        left = left[np.abs(angles[left] - angles[first]).max(axis=1) > APART]
    return None


def project(
    wanted: np.ndarray, tension: np.ndarray, angles: np.ndarray, limits: tuple[np.ndarray, np.ndarray], n: Parameters,
    confirm: Confirm,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Tensions (3,) [N] within limits whose posture (3,) [rad], from rest along the ramp, is nearest `wanted`."""
    low, high = limits

    def miss(x: np.ndarray) -> np.ndarray:
        return np.nan_to_num(ramp_posture(x, low, n) - wanted, nan=1.0)

    best = inf, low, ramp_posture(low, low, n)
    for place in np.argsort(np.linalg.norm(angles - wanted, axis=1))[:STARTS]:
        start = np.clip(tension[place], low + 1e-3, high - 1e-3)
        found = least_squares(miss, start, bounds=(low, high), x_scale=high - low, diff_step=1e-4).x
        for x in (found, tension[place]):
            here = ramp_posture(x, low, n)
            error = float(np.linalg.norm(here - wanted))
            safe = error < best[0] and steady(here[None], x[None], n)[0] and arrives(here, x, low, n)
            if safe and confirm(x, here):
                best = error, x, here
    return best[1:]


def at_hold(log: Log, kind: str, names: tuple[str, ...]) -> np.ndarray:
    """Means (n,) [SI] of columns over the last half second of the hold of a grasp."""
    during = (log.time >= REST + APPROACH + HOLD - LAST) & (log.time < REST + APPROACH + HOLD)
    return log.array(kind, names)[during].mean(axis=0)


@short_repr
@dataclass(frozen=True)
class Plan:
    """A planned grasp of an object."""

    mode: str
    size: float  # of the object [m]
    target: tuple[float, float]  # fingertip, as (x, y palmar) [m], MCP in the origin
    centre: tuple[float, float]  # of the object, likewise
    wanted: tuple[float, ...]  # joint angles by inverse kinematics [rad]
    tensions: tuple[float, ...]  # [N]
    planned: tuple[float, ...]  # joint angles that the tensions hold, from rest along the ramp [rad]
    shortfall: tuple[float, ...]  # wanted less planned, the infeasible part [rad]
    feasible: bool  # whether no joint falls short by more than TOLERANCE
    reason: str  # why, in a sentence
    tendons: tuple[str, ...]
    joints: tuple[str, ...]
    hand: Hand

    def reference(self, robot: Robot | None = None, **durations: float) -> Reference:
        """Tension references for the Diagram: rest, approach, hold, release; durations as in `exo.grasp` [s]."""
        return grasp(self.mode, robot_or_default(robot), dict(zip(self.tendons, self.tensions)), **durations)


def plan_grasp(mode: str, size: float, robot: Robot | None = None, hand: Hand | None = None) -> Plan:
    """Plan a grasp of a round object: caging, narrow-pinch or wide-pinch of a diameter [m].

    Raises:
        InputError: an unknown mode, a size that is not a length, or beyond the span of finger and thumb.

    Examples:
        >>> plan = plan_grasp("caging", 0.06)
        >>> [round(tension, 1) for tension in plan.tensions]  # N
        [5.5, 1.4, 2.9]
    """
    robot, hand = robot_or_default(robot), hand or Hand()
    way, n, (low, high) = find_mode(mode), read_parameters(robot), robot.reference_limits()
    size = check_size(size, hand, n)
    angles, centres, gap, miss = list_postures(way, size, hand, n)
    allowed = np.flatnonzero(miss <= 0.0)
    # weighted departure from rest, and distance of a caged object from the thumb
    cost = (angles - np.array(n.q0)) ** 2 @ np.array(way.weight) + (np.maximum(gap, 0.0) / GAP) ** 2
    nominal, axes = robot.without_effects(), robot.machine.axes

    def confirm(tension: np.ndarray, planned: np.ndarray) -> bool:
        reference = grasp("trial", nominal, dict(zip(axes.tendons, tension)), rest=REST, approach=APPROACH, hold=HOLD)
        log = write_log(run(nominal, reference, seed=None))
        return bool(np.abs(at_hold(log, "angle", axes.joints) - planned).max() <= CLOSE)

    best = holdable(angles[allowed], cost[allowed], low, high, n, confirm) if len(allowed) else None
    if best is not None:
        place, tension = int(allowed[best[0]]), np.clip(best[1], low, high)
        wanted, planned = angles[place], ramp_posture(tension, low, n)
    else:
        levels = [np.linspace(a, b, STEPS) for a, b in zip(low, high)]
        tension = np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, 3)
        held = posture(tension, n)
        kept = np.isfinite(held).all(axis=1)
        kept[kept] = steady(held[kept], tension[kept], n)
        tension, held = tension[kept], held[kept]
        # the admissible posture nearest those that the tendons hold; else the least miss
        place = int(miss.argmin())
        if len(allowed):
            place = int(allowed[KDTree(held).query(angles[allowed])[0].argmin()])
        wanted = np.clip(angles[place], *bounds(way, hand, n))
        tension, planned = project(wanted, tension, held, (low, high), n, confirm)
    shortfall = wanted - planned
    feasible = bool(len(allowed) and np.abs(shortfall).max() <= TOLERANCE)
    what = f"{way.name.replace('-', ' ')} of {1e3 * size:g} mm"
    if feasible:
        reason = "the tendons hold it within F_min .. F_max, and the ramp leads to it"
    elif not len(allowed):
        does = "closes round it" if way.wraps else "brings it against the thumb"
        reason = f"{what} is out of reach: no posture within the limits of joints and mode {does}"
    else:
        short = ", ".join(f"{j} {v:+.3f} rad" for j, v in zip(axes.joints, shortfall) if abs(v) > TOLERANCE)
        at = [f"{w} at F_min" for w, t, a in zip(axes.tendons, tension, low) if t < a + 0.01]
        at += [f"{w} at F_max" for w, t, b in zip(axes.tendons, tension, high) if t > b - 0.01]
        reason = f"{what} is out of the tendons' reach: no tensions hold the posture, which falls short by {short}; "
        edge = f"the nearest they hold has {' and '.join(at)}"
        reason += edge if at else "nearer ones are not stable or not on the ramp"
    target, centre = ((float(point.real), float(point.imag)) for point in (joints(wanted, n)[3], centres[place]))
    return Plan(
        way.name, size, target, centre, tuple(wanted.tolist()), tuple(tension.tolist()), tuple(planned.tolist()),
        tuple(shortfall.tolist()), feasible, reason, axes.tendons, axes.joints, hand,
    )  # fmt: skip


def posture_controller(plan: Plan, robot: Robot, ki: float = KI, **durations: float) -> PostureController:
    """The posture controller of a planned grasp, for a robot as its robot file describes it; the wearer may differ.

    Its integral gain ki [1/s] of 0 leaves the planned tensions as they are; durations as in `exo.grasp` [s].

    Examples:
        >>> import exodrake as exo
        >>> posture_controller(exo.plan_grasp("caging", 0.06), exo.load_robot()).get_name()
        'posture'
    """
    from exodrake.systems.posture_controller import PostureController, PosturePlan, damped_inverse

    reference = argument("plan", plan, Plan).reference(argument("robot", robot, Robot), **durations)
    angle = record(robot.without_effects(), reference, seed=None, quantisation=False).signals["angle"]
    low, high = robot.reference_limits()
    n, planned, tension = read_parameters(robot), np.array([plan.planned]), np.array([plan.tensions])
    compliance = arms(planned, n)[0].T / stiffness(planned, tension, n)[0][:, None]  # dq/dF [rad/N]
    gain = damped_inverse(compliance)
    return PostureController(PosturePlan(reference.values, angle, gain, low, high, ki), robot.machine)


def run_plan(
    plan: Plan, robot: Robot, estimator: Estimator, seed: int | None = 0, controller: PostureController | None = None,
    **durations: float,
) -> Log:  # fmt: skip
    """Log of a robot in the Drake Diagram that follows a plan, with the estimator's angles.

    A `posture_controller` gives the tension references, if there is one; durations as in `exo.grasp` [s].
    """
    from exodrake.diagrams.diagram import Simulator, build_diagram, logged_signals
    from exodrake.simulation.simulate import diagram_log
    from exodrake.systems.gp_estimator import GPEstimator

    axes = robot.machine.axes
    if (estimator.wires, estimator.joints) != (axes.tendons, axes.joints):
        raise InputError(f"estimator of tendons {', '.join(estimator.wires)}, joints {', '.join(estimator.joints)}")
    reference = plan.reference(robot, **durations)
    systems = [GPEstimator(estimator.weights, robot.machine), *([controller] if controller else [])]
    diagram = build_diagram(robot, reference, seed, systems=systems)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(robot.machine.frame * len(reference.values))
    signals = logged_signals(diagram, simulator.get_context())
    log = diagram_log(diagram, simulator.get_context(), signals)
    for kind in ("angle_est", "angle_std", *(["angle_ref"] if controller else [])):
        log = log.with_array(kind, estimator.joints, signals[kind])
    return log


SKIN, THUMB, OBJECT = "#e7c3b0", "#d8d2cc", "#a9c7e3"
THUMB_BONE = complex(-0.030, 0.012)  # from the thumb's tip backwards, for the drawing only [m]


def grasp_figure(plan: Plan, log: Log, robot: Robot) -> Figure:
    """The figure of a plan and of its run (`run_plan`)."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.4, 5.4)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.1), height_ratios=(1.5, 1.0))
        draw_posture(figure.add_subplot(grid[:, 0]), plan, log, robot)
        angle, factor = figure.add_subplot(grid[0, 1]), find_display("angle", robot.machine).factor
        draw_panel(angle, log, "angle", robot.machine)
        for i, name in enumerate(plan.joints):
            colour = choose_colour(name, i, robot.machine)
            angle.axhline(factor * plan.planned[i], color=colour, lw=0.9, ls=(0, (4, 2)))
        angle.set_title("dashed: planned", loc="right", fontsize=7.5)
        tension = figure.add_subplot(grid[1, 1], sharex=angle)
        draw_panel(tension, log, "tension", robot.machine)
        add_legends({"angle": angle, "tension": tension}, log, {})
        tension.set(xlabel="Time [s]", xlim=(log.time[0], log.time[-1]))
        angle.tick_params(labelbottom=False)
        figure.align_ylabels([angle, tension])
        state = "" if plan.feasible else ": not feasible, nearest shown"
        title = f"{plan.mode.replace('-', ' ').capitalize()}, {1e3 * plan.size:g} mm{state}"
        figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def draw_posture(axes: Any, plan: Plan, log: Log, robot: Robot) -> None:
    """Object, thumb and the finger's three postures at the hold, in its plane [mm]."""
    n = read_parameters(robot)
    thumb, centre = complex(*plan.hand.thumb), complex(*plan.centre)
    fill(axes, [thumb, thumb + THUMB_BONE], [plan.hand.thumb_radius], THUMB, 0.9)
    where = mm(thumb + THUMB_BONE / 2 + 0.002j)
    axes.annotate("thumb (place assumed)", where, ha="center", va="bottom", fontsize=7.5, color="#555")
    fill(axes, [centre, centre], [plan.size / 2.0], OBJECT, 0.75)
    axes.annotate(f"{1e3 * plan.size:g} mm", mm(centre), ha="center", va="center", color="#2b4d6e")
    planned = np.array(plan.planned)
    fill(axes, list(joints(planned, n)), list(n.radius), SKIN, 0.55)
    if not plan.feasible:
        x, y = mm(joints(np.array(plan.wanted), n))
        axes.plot(x, y, color="#999999", lw=1.2, ls=(0, (1, 1.2)), label="wanted")
    for name, angle, colour, dash, width, size in (
        ("planned", planned, "#222222", "-", 3.2, 4),
        ("reached", at_hold(log, "angle", plan.joints), "#0072b2", (0, (5, 2)), 1.8, 0),
        ("estimated", at_hold(log, "angle_est", plan.joints), "#d55e00", (0, (1, 1.5)), 1.8, 0),
    ):
        x, y = mm(joints(angle, n))
        axes.plot(x, y, color=colour, ls=dash, lw=width, label=name, marker="o", ms=size)
    axes.plot(*mm(complex(*plan.target)), "x", color="#cc79a7", ms=8, mew=1.8, label="target")
    axes.set(aspect="equal", xlabel="distal [mm]", ylabel="palmar [mm]")
    axes.invert_yaxis()
    axes.margins(0.06)
    axes.legend(loc="lower left", ncols=3, handlelength=2.2, columnspacing=1.0, bbox_to_anchor=(0.0, 1.0))


def fill(axes: Any, points: list[complex], radii: list[float], colour: str, alpha: float) -> None:
    """Rounded bones between points [m], one radius [m] each, as one filled shape."""
    import shapely

    bones = zip(points[:-1], points[1:], radii)
    shapes = [shapely.LineString([mm(a), mm(b + 1e-9 * (a == b))]).buffer(1e3 * r) for a, b, r in bones]
    x, y = np.array(shapely.union_all(shapes).exterior.coords).T  # pyright: ignore
    axes.fill(x, y, color=colour, alpha=alpha, lw=0)


def mm(points: Any) -> tuple[Any, Any]:
    """Complex points [m] as x and y [mm]."""
    return 1e3 * np.real(points), 1e3 * np.imag(points)
