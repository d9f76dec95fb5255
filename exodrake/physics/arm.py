"""Rigid serial arm: recursive Newton-Euler and composite rigid bodies; its inverse and its forward dynamics as parts.

    v_j = v_(j-1) + S_j q'_j          a_j = a_(j-1) + S_j q''_j + v_j x S_j q'_j          a_0 = -g
    f_j = I_j a_j + v_j x* I_j v_j    tau_j = S_j . sum_(k >= j) f_k
    M_ij = S_i . (sum_(k >= j) I_k) S_j   for i <= j

Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5 and 6, in the base's axes and about its origin: one frame for
all links needs no transforms between them. `w`, the first values of the state x, is the memory, WIDTH values a link:
rotation, origin, S, inertia (mass, first moment, second moment), v, a, f.

The friction family (`sliding.*`) acts on each joint. Link frames, axes and inertias are those of the URDF.
"""

import sys
from math import cos, sin
from typing import Any

from exodrake.model.part import JOINTS, SCALAR, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import add, brake_dry, cross, dot, multiply

ROTATION, ORIGIN, SCREW, INERTIA, MOTION, CHANGE, WRENCH, WIDTH = 0, 9, 12, 18, 28, 34, 40, 46
EYE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
ZERO = (0.0, 0.0, 0.0)
SWEEPS = 10  # over the joints; the coupling through the mass matrix leaves next to nothing after that many
ANGLE, SPEED, ROTOR, ROTOR_SPEED, PUSH, IMPULSE, STATES = 0, 1, 2, 3, 4, 5, 6


def three(w, i):
    """Three values from i on."""
    return w[i], w[i + 1], w[i + 2]


def nine(w, i):
    """Nine values from i on, a matrix by rows."""
    return w[i], w[i + 1], w[i + 2], w[i + 3], w[i + 4], w[i + 5], w[i + 6], w[i + 7], w[i + 8]


def put(w, i, values):
    """Writes a tuple from i on."""
    for k in range(len(values)):
        w[i + k] = values[k]


def rotate(r, a):
    """R a."""
    return dot((r[0], r[1], r[2]), a), dot((r[3], r[4], r[5]), a), dot((r[6], r[7], r[8]), a)


def times(r, s):
    """R S, matrices by rows."""
    x, y, z = rotate(r, (s[0], s[3], s[6])), rotate(r, (s[1], s[4], s[7])), rotate(r, (s[2], s[5], s[8]))
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


def roll_pitch_yaw(roll, pitch, yaw):
    """Rotation matrix of fixed-axis angles [rad], as URDF has them."""
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    first = (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr)
    second = (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr)
    return first[0], first[1], first[2], second[0], second[1], second[2], -sp, cp * sr, cp * cr


def about(axis, angle):
    """Rotation matrix about a unit axis by an angle [rad]."""
    c, s, x, y, z = cos(angle), sin(angle), axis[0], axis[1], axis[2]
    u = 1.0 - c
    return (
        c + u * x * x, u * x * y - s * z, u * x * z + s * y,
        u * x * y + s * z, c + u * y * y, u * y * z - s * x,
        u * x * z - s * y, u * y * z + s * x, c + u * z * z,
    )  # fmt: skip


def place(w, j, origin, angles, axis, sliding, q):
    """Rotation, origin and S of link j from those of the link before it.

    origin [m], angles [rad]: of the joint in the link before; axis: unit vector in the joint's frame; sliding: 1 for a
    prismatic joint, else 0; q [rad] or [m].
    """
    at, up = WIDTH * j, WIDTH * (j - 1)
    upper, point = EYE, ZERO
    if j > 0:
        upper, point = nine(w, up + ROTATION), three(w, up + ORIGIN)
    rotation = times(upper, roll_pitch_yaw(angles[0], angles[1], angles[2]))
    point, line = add(point, rotate(upper, origin)), rotate(rotation, axis)
    if sliding > 0.0:
        point = add(point, multiply(q, line))
        put(w, at + SCREW, ZERO)
        put(w, at + SCREW + 3, line)
    else:
        rotation = times(rotation, about(axis, q))
        put(w, at + SCREW, line)
        put(w, at + SCREW + 3, cross(point, line))
    put(w, at + ROTATION, rotation)
    put(w, at + ORIGIN, point)


def add_point(w, j, mass, centre):
    """Adds a point mass [kg] at `centre` [m], in the base's axes, to the inertia of link j."""
    at, x, y, z = WIDTH * j + INERTIA, centre[0], centre[1], centre[2]
    w[at] += mass
    w[at + 1] += mass * x
    w[at + 2] += mass * y
    w[at + 3] += mass * z
    w[at + 4] += mass * (y * y + z * z)
    w[at + 5] -= mass * x * y
    w[at + 6] -= mass * x * z
    w[at + 7] += mass * (x * x + z * z)
    w[at + 8] -= mass * y * z
    w[at + 9] += mass * (x * x + y * y)


def in_base(w, j, point):
    """A point of link j's frame in the base's axes [m]."""
    return add(three(w, WIDTH * j + ORIGIN), rotate(nine(w, WIDTH * j + ROTATION), point))


def load(w, j, mass, centre, inertia):
    """Inertia of link j: mass [kg], centre of mass [m], (xx, xy, xz, yy, yz, zz) about it [kg m2], all in its axes."""
    at, rotation = WIDTH * j, nine(w, WIDTH * j + ROTATION)
    xx, xy, xz, yy, yz, zz = inertia
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation
    own = times(times(rotation, (xx, xy, xz, xy, yy, yz, xz, yz, zz)), (r0, r3, r6, r1, r4, r7, r2, r5, r8))
    put(w, at + INERTIA, ZERO)
    put(w, at + INERTIA + 3, (0.0, own[0], own[1], own[2], own[4], own[5], own[8]))
    add_point(w, j, mass, in_base(w, j, centre))


def momentum(w, j, spin, shift):
    """I v of link j for a motion (spin, shift): moment, then force."""
    at = WIDTH * j + INERTIA
    mass, first = w[at], three(w, at + 1)
    second = (w[at + 4], w[at + 5], w[at + 6], w[at + 5], w[at + 7], w[at + 8], w[at + 6], w[at + 8], w[at + 9])
    moment = add(rotate(second, spin), cross(first, shift))
    return moment, add(multiply(mass, shift), cross(spin, first))


def move(w, j, rate, acceleration, gravity):
    """Motion of link j from that of the link before it, and the wrench that it needs; gravity [m/s2] as a vector."""
    at, up = WIDTH * j, WIDTH * (j - 1)
    spin, shift, turn, push = ZERO, ZERO, ZERO, multiply(-1.0, gravity)
    if j > 0:
        spin, shift = three(w, up + MOTION), three(w, up + MOTION + 3)
        turn, push = three(w, up + CHANGE), three(w, up + CHANGE + 3)
    about_axis, along = three(w, at + SCREW), three(w, at + SCREW + 3)
    spin, shift = add(spin, multiply(rate, about_axis)), add(shift, multiply(rate, along))
    carried = add(cross(spin, along), cross(shift, about_axis))
    turn = add(turn, add(multiply(acceleration, about_axis), multiply(rate, cross(spin, about_axis))))
    push = add(push, add(multiply(acceleration, along), multiply(rate, carried)))
    moment, force = momentum(w, j, turn, push)
    swing, drift = momentum(w, j, spin, shift)
    put(w, at + MOTION, spin)
    put(w, at + MOTION + 3, shift)
    put(w, at + CHANGE, turn)
    put(w, at + CHANGE + 3, push)
    put(w, at + WRENCH, add(moment, add(cross(spin, swing), cross(shift, drift))))
    put(w, at + WRENCH + 3, add(force, cross(spin, drift)))


def gather(w, count, first, size):
    """Adds `size` values from `first` on of each link to those of the link before it, from the tip to the base."""
    for j in range(count - 1, 0, -1):
        for k in range(first, first + size):
            w[WIDTH * (j - 1) + k] += w[WIDTH * j + k]


def effort(w, j):
    """tau_j [N m] or [N], once the wrenches are gathered."""
    at = WIDTH * j
    turn = dot(three(w, at + SCREW), three(w, at + WRENCH))
    return turn + dot(three(w, at + SCREW + 3), three(w, at + WRENCH + 3))


def mass_matrix(w, count, at):
    """M (count, count) by rows into w from `at` on; the links' inertias become composite ones."""
    gather(w, count, INERTIA, MOTION - INERTIA)
    for j in range(count):
        moment, force = momentum(w, j, three(w, WIDTH * j + SCREW), three(w, WIDTH * j + SCREW + 3))
        for i in range(j + 1):
            entry = dot(three(w, WIDTH * i + SCREW), moment) + dot(three(w, WIDTH * i + SCREW + 3), force)
            w[at + count * i + j] = entry
            w[at + count * j + i] = entry


def invert(w, count, at):
    """The inverse of a positive definite matrix (count, count), by rows from `at` on, in its place (Gauss, Jordan)."""
    for k in range(count):
        pivot = 1.0 / w[at + count * k + k]
        w[at + count * k + k] = 1.0
        for c in range(count):
            w[at + count * k + c] *= pivot
        for i in range(count):
            if i != k:
                factor = w[at + count * i + k]
                w[at + count * i + k] = 0.0
                for c in range(count):
                    w[at + count * i + c] -= factor * w[at + count * k + c]


def downwards(gravity, roll, pitch):
    """Gravity [m/s2] as a vector in the axes of a base that is tilted by roll and pitch [rad]."""
    return gravity * sin(pitch), -gravity * cos(pitch) * sin(roll), -gravity * cos(pitch) * cos(roll)


link_mass = Point("weighed", JOINTS, "mass", "mass of link j [kg]")
tip_mass = Point("carried", SCALAR, "mass", "mass at the tip [kg]")
rotor_inertia = Point("geared", JOINTS, "inertia", "inertia of the rotor of joint j as the joint feels it [kg m2]")
joint_position = Point("seen", JOINTS, "position", "position of joint j [rad], from the measured one")
joint_compliance = Point("sprung", JOINTS, "compliance", "compliance of joint j [rad/(N m)]: forward dynamics")
effort_delay = Point("late", JOINTS, "delay", "how late the effort of joint j is logged [s]; < 0: its motion is: "
                     "inverse dynamics")  # fmt: skip
push_joint = Point("pushed", JOINTS, "effort, speed", "effort on joint j [N m], from that of the drive; speed [rad/s]",
                   standard="sliding.pushed")  # fmt: skip
brake_joint = Point("braked", JOINTS, "speed, mobility, load",
                    "speed of joint j [rad/s] after dry friction; mobility: speed per effort; load: |effort| [N m]",
                    standard="sliding.braked")  # fmt: skip
settle = Point("settle", JOINTS, "dt, travel", "states of the effects on joint j after dt [s]; travel [rad]",
               standard="sliding.settle")  # fmt: skip


def link(x, z, n, e, j, count, q):
    """Place and inertia of link j at q; the last one holds the payload."""
    body(x, n, j, count, q, link_mass(e, z, j, n.mass[j]), tip_mass(e, z, n.tip_mass))


def body(x, n, j, count, q, mass, payload):
    """Place and inertia of link j with this mass, and payload at the tip [kg].

    Its centre stays and its inertia about that grows with the mass, as of a body of another density.
    For any part whose parameters begin with those of `parameters_with`, such as a controller with a model of the arm.
    """
    origin, angles = (n.x[j], n.y[j], n.z[j]), (n.roll[j], n.pitch[j], n.yaw[j])
    place(x, j, origin, angles, (n.axis_x[j], n.axis_y[j], n.axis_z[j]), n.sliding[j], q)
    centre = (n.com_x[j], n.com_y[j], n.com_z[j])
    s = mass / n.mass[j] if n.mass[j] > 0.0 else 1.0
    inertia = (s * n.xx[j], s * n.xy[j], s * n.xz[j], s * n.yy[j], s * n.yz[j], s * n.zz[j])
    load(x, j, mass, centre, inertia)
    if j == count - 1:
        add_point(x, j, payload, in_base(x, j, (n.tip_x, n.tip_y, n.tip_z)))


def compute_efforts(x, z, n, e, dt, position, velocity, acceleration):
    """Inverse dynamics: efforts of one tick; signals [rad], [rad/s], [rad/s2].

    x: memory of the links, efforts [N m] and by how much they are logged late [s].

        tau = M(q) q'' + c(q, q') + g(q) + (rotor inertia) q'' + friction(q')

    Dry friction at a speed below `mobility` times its level grows in proportion to the speed, as noise makes the sign
    of a smaller one uncertain.
    """
    count = position.shape[0]
    gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
    for j in range(count):
        link(x, z, n, e, j, count, joint_position(e, z, j, position[j]))
        move(x, j, velocity[j], acceleration[j], gravity)
    gather(x, count, WRENCH, WIDTH - WRENCH)
    for j in range(count):
        speed = velocity[j]
        torque = effort(x, j) + rotor_inertia(e, z, j, n.rotor_inertia[j]) * acceleration[j] + n.damping[j] * speed
        rest = brake_joint(e, z, j, brake_dry(speed, n.dry_friction[j] * n.mobility), n.mobility, abs(torque))
        drag = torque - push_joint(e, z, j, torque, speed)
        x[WIDTH * count + j] = torque + drag + (speed - rest) / n.mobility
        x[(WIDTH + 1) * count + j] = effort_delay(e, z, j, 0.0)
        settle(e, z, j, dt, dt * speed)


def find_place(count, state, j):
    """Index of a state of joint j in forward dynamics, behind the memory of the links and the matrix."""
    return (WIDTH + count + state) * count + j


def update(x, z, n, e, dt, effort_true):
    """Forward dynamics: one tick under the efforts of the drives [N m], elastic joints where a compliance is stated.

        (M(q) + B) q'' = tau - c(q, q') - g(q)                                rigid joint, B: inertia of its rotor
        M(q) q'' = k (theta - q) - c(q, q') - g(q),   B theta'' = tau - k (theta - q)     elastic, k = 1 / compliance

    Euler's rule for the speeds, then for the positions with the new speeds. Dry friction sits at the drive: it takes
    speed away after the push, at most all of it, on all rigid joints at once (projected Gauss-Seidel). Positions are
    measured at the drives and counted from the zeros of their encoders. Beyond its limits a link meets a spring and a
    damper, which push it back and never pull.
    """
    count = effort_true.shape[0]
    if x[(WIDTH + count + STATES) * count] > 0.0:
        matrix = WIDTH * count
        gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
        for j in range(count):
            link(x, z, n, e, j, count, joint_position(e, z, j, x[find_place(count, ANGLE, j)]))
            move(x, j, x[find_place(count, SPEED, j)], 0.0, gravity)
        gather(x, count, WRENCH, WIDTH - WRENCH)
        mass_matrix(x, count, matrix)
        for j in range(count):
            drive(x, z, n, e, j, count, dt, effort_true[j])
        invert(x, count, matrix)
        for j in range(count):
            for k in range(count):
                x[find_place(count, SPEED, j)] += dt * x[matrix + count * j + k] * x[find_place(count, PUSH, k)]
            x[find_place(count, IMPULSE, j)] = 0.0
        brake(x, z, n, e, count, dt, effort_true)
        for j in range(count):
            at, rotor, speed = find_place(count, ANGLE, j), find_place(count, ROTOR, j), x[find_place(count, SPEED, j)]
            x[at] += dt * speed
            if joint_compliance(e, z, j, n.compliance[j]) > 0.0:
                speed = x[find_place(count, ROTOR_SPEED, j)]
                x[rotor] += dt * speed
            else:
                x[rotor], x[find_place(count, ROTOR_SPEED, j)] = x[at], speed
            settle(e, z, j, dt, dt * speed)


def drive(x, z, n, e, j, count, dt, given):
    """Effort on link j without its bias; an elastic joint's rotor moves on, a rigid one's inertia joins the link's."""
    rotor, speed = find_place(count, ROTOR, j), x[find_place(count, ROTOR_SPEED, j)]
    inertia, compliance = rotor_inertia(e, z, j, n.rotor_inertia[j]), joint_compliance(e, z, j, n.compliance[j])
    push = push_joint(e, z, j, given, speed) - n.damping[j] * speed
    if compliance > 0.0:
        spring = (x[rotor] - x[find_place(count, ANGLE, j)]) / compliance
        free, mobility = speed + dt * (push - spring) / inertia, dt / inertia
        free = brake_dry(free, n.dry_friction[j] * mobility)
        x[find_place(count, ROTOR_SPEED, j)] = brake_joint(e, z, j, free, mobility, abs(given))
        push = spring
    else:
        x[WIDTH * count + count * j + j] += inertia
    x[find_place(count, PUSH, j)] = push + push_from_stops(x, n, j, count) - effort(x, j)


def push_from_stops(x, n, j, count):
    """Effort of the end stops on link j [N m]: spring and damper, which push and do not pull."""
    place, speed = x[find_place(count, ANGLE, j)], x[find_place(count, SPEED, j)]
    above, below = place - n.stop_high[j], n.stop_low[j] - place
    if above > 0.0:
        return -max(0.0, n.stop_stiffness[j] * above + n.stop_damping[j] * speed)
    if below > 0.0:
        return max(0.0, n.stop_stiffness[j] * below - n.stop_damping[j] * speed)
    return 0.0


def brake(x, z, n, e, count, dt, efforts):
    """Dry friction of the rigid joints: impulses that agree with all speeds."""
    for _ in range(SWEEPS):
        change = 0.0
        for j in range(count):
            if joint_compliance(e, z, j, n.compliance[j]) > 0.0:
                continue
            own, at = x[WIDTH * count + count * j + j], find_place(count, IMPULSE, j)
            free = x[find_place(count, SPEED, j)] - own * x[at]
            after = brake_dry(free, n.dry_friction[j] * dt * own)
            after = brake_joint(e, z, j, after, dt * own, abs(efforts[j]))
            more = (after - free) / own - x[at]
            x[at] += more
            change = max(change, abs(more))
            for i in range(count):
                x[find_place(count, SPEED, i)] += x[WIDTH * count + count * i + j] * more
        if change == 0.0:
            break


def stand(x, z, n, e, position_start):
    """Where the arm stands at the start of the log [rad], taken in the first frame; it rests there.

    The springs of elastic joints hold its weight: theta - q = compliance g(q), found by fixed-point iteration.
    """
    count = position_start.shape[0]
    if x[(WIDTH + count + STATES) * count] == 0.0:
        gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
        for j in range(count):
            x[find_place(count, ANGLE, j)] = position_start[j]
            x[find_place(count, ROTOR, j)] = position_start[j]
        for _ in range(SWEEPS):
            change = 0.0
            for j in range(count):
                link(x, z, n, e, j, count, joint_position(e, z, j, x[find_place(count, ANGLE, j)]))
                move(x, j, 0.0, 0.0, gravity)
            gather(x, count, WRENCH, WIDTH - WRENCH)
            for j in range(count):
                at = find_place(count, ANGLE, j)
                after = position_start[j] - joint_compliance(e, z, j, n.compliance[j]) * effort(x, j)
                change, x[at] = max(change, abs(after - x[at])), after
            if change == 0.0:
                break
        x[(WIDTH + count + STATES) * count] = 1.0


LINK = {
    "mass": "kg", **dict.fromkeys(("com_x", "com_y", "com_z"), "m"),
    **dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), "kg m2"),
    **dict.fromkeys(("x", "y", "z"), "m"), **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    **dict.fromkeys(("axis_x", "axis_y", "axis_z", "sliding"), "-"),
}  # fmt: skip
BODY = {
    "gravity": "m/s2", "base_roll": "rad", "base_pitch": "rad",
    "tip_mass": "kg", "tip_x": "m", "tip_y": "m", "tip_z": "m",
}  # fmt: skip


def parameters_with(joints: dict[str, str], scalars: dict[str, str] | None = None) -> Any:
    """A class of parameters with units: those of an arm first, then further ones of each joint, and scalars."""
    return parameter_class((JOINTS, LINK), (SCALAR, BODY), (JOINTS, joints), (SCALAR, scalars or {}))


def forward_part(count: int, slot: int, scales: dict[str, tuple[float, str]], unit: dict[str, str]) -> Part:
    """The arm as a part with forward dynamics.

    Args:
        count: of joints.
        slot: in which it learns where it stands.
        scales: of its friction.
        unit: of position, velocity, effort, inertia, effort/speed, effort/position and position/effort.
    """
    per_joint = {
        "rotor_inertia": unit["inertia"], "damping": unit["effort/speed"], "dry_friction": unit["effort"],
        "compliance": unit["position/effort"], "stop_low": unit["position"], "stop_high": unit["position"],
        "stop_stiffness": unit["effort/position"], "stop_damping": unit["effort/speed"],
    }  # fmt: skip
    angle, rate = unit["position"], unit["velocity"]
    own = ("angle", angle), ("speed", rate), ("rotor", angle), ("rotor_speed", rate), ("push", "-"), ("impulse", "-")
    return Part(
        name="arm", module=sys.modules[__name__], parameters=parameters_with(per_joint),
        states=(
            State("link", JOINTS, WIDTH), State("matrix", JOINTS, count),
            *(State(name, JOINTS, unit=u) for name, u in own), State("placed"),
        ),
        tasks=(Task("update", ("effort_true",)), Task("stand", ("position_start",), slots=(slot,))),
        outputs=(Output.of_states(rotor="position", angle="link_position"),), scales=scales,
        points=(link_mass, tip_mass, rotor_inertia, joint_position, joint_compliance, push_joint, brake_joint, settle),
    )  # fmt: skip


def inverse_part(scales: dict[str, tuple[float, str]], unit: dict[str, str]) -> Part:
    """The arm as a part with inverse dynamics; scales: of its friction; unit: of inertia, effort and effort/speed."""
    per_joint = {
        "rotor_inertia": unit["inertia"], "damping": unit["effort/speed"], "dry_friction": unit["effort"],
    }  # fmt: skip
    return Part(
        name="arm", module=sys.modules[__name__], parameters=parameters_with(per_joint, {"mobility": "-"}),
        states=(
            State("link", JOINTS, WIDTH), State("effort", JOINTS, unit=unit["effort"]),
            State("delay", JOINTS, unit="s"),
        ),
        tasks=(Task("compute_efforts", ("position", "velocity", "acceleration")),),
        outputs=(Output.of_states(effort="effort", delay="effort_delay"),), scales=scales,
        points=(
            link_mass, tip_mass, rotor_inertia, joint_position, effort_delay, push_joint, brake_joint, settle,
        ),
    )  # fmt: skip
