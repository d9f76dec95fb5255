"""Rigid serial arm: recursive Newton-Euler and composite rigid bodies, in the base's axes and about its origin.

    v_j = v_(j-1) + S_j q'_j          a_j = a_(j-1) + S_j q''_j + v_j x S_j q'_j          a_0 = -g
    f_j = I_j a_j + v_j x* I_j v_j    tau_j = S_j . sum_(k >= j) f_k
    M_ij = S_i . (sum_(k >= j) I_k) S_j   for i <= j

Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5 and 6. One frame for all links needs no transforms between
them. `w` is the memory, WIDTH values a link: rotation, origin, S, inertia (mass, first moment, second moment), v, a, f.
"""

from math import cos, sin

from exodrake.physics.triples import cross, dot, plus, scaled

ROTATION, ORIGIN, SCREW, INERTIA, MOTION, CHANGE, WRENCH, WIDTH = 0, 9, 12, 18, 28, 34, 40, 46
EYE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
ZERO = (0.0, 0.0, 0.0)


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


def turned(r, a):
    """R a."""
    return dot((r[0], r[1], r[2]), a), dot((r[3], r[4], r[5]), a), dot((r[6], r[7], r[8]), a)


def times(r, s):
    """R S, matrices by rows."""
    x, y, z = turned(r, (s[0], s[3], s[6])), turned(r, (s[1], s[4], s[7])), turned(r, (s[2], s[5], s[8]))
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


def transposed(r):
    """R'."""
    return r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]


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
    point, line = plus(point, turned(upper, origin)), turned(rotation, axis)
    if sliding > 0.0:
        point = plus(point, scaled(q, line))
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
    return plus(three(w, WIDTH * j + ORIGIN), turned(nine(w, WIDTH * j + ROTATION), point))


def load(w, j, mass, centre, inertia):
    """Inertia of link j: mass [kg], centre of mass [m], (xx, xy, xz, yy, yz, zz) about it [kg m2], all in its axes."""
    at, rotation = WIDTH * j, nine(w, WIDTH * j + ROTATION)
    xx, xy, xz, yy, yz, zz = inertia
    own = times(times(rotation, (xx, xy, xz, xy, yy, yz, xz, yz, zz)), transposed(rotation))
    put(w, at + INERTIA, ZERO)
    put(w, at + INERTIA + 3, (0.0, own[0], own[1], own[2], own[4], own[5], own[8]))
    add_point(w, j, mass, in_base(w, j, centre))


def momentum(w, j, spin, shift):
    """I v of link j for a motion (spin, shift): moment, then force."""
    at = WIDTH * j + INERTIA
    mass, first = w[at], three(w, at + 1)
    second = (w[at + 4], w[at + 5], w[at + 6], w[at + 5], w[at + 7], w[at + 8], w[at + 6], w[at + 8], w[at + 9])
    moment = plus(turned(second, spin), cross(first, shift))
    return moment, plus(scaled(mass, shift), cross(spin, first))


def move(w, j, rate, acceleration, gravity):
    """Motion of link j from that of the link before it, and the wrench that it needs; gravity [m/s2] as a vector."""
    at, up = WIDTH * j, WIDTH * (j - 1)
    spin, shift, turn, push = ZERO, ZERO, ZERO, scaled(-1.0, gravity)
    if j > 0:
        spin, shift = three(w, up + MOTION), three(w, up + MOTION + 3)
        turn, push = three(w, up + CHANGE), three(w, up + CHANGE + 3)
    about_axis, along = three(w, at + SCREW), three(w, at + SCREW + 3)
    spin, shift = plus(spin, scaled(rate, about_axis)), plus(shift, scaled(rate, along))
    carried = plus(cross(spin, along), cross(shift, about_axis))
    turn = plus(turn, plus(scaled(acceleration, about_axis), scaled(rate, cross(spin, about_axis))))
    push = plus(push, plus(scaled(acceleration, along), scaled(rate, carried)))
    moment, force = momentum(w, j, turn, push)
    swing, drift = momentum(w, j, spin, shift)
    put(w, at + MOTION, spin)
    put(w, at + MOTION + 3, shift)
    put(w, at + CHANGE, turn)
    put(w, at + CHANGE + 3, push)
    put(w, at + WRENCH, plus(moment, plus(cross(spin, swing), cross(shift, drift))))
    put(w, at + WRENCH + 3, plus(force, cross(spin, drift)))


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
