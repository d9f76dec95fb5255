"""Paths of the three wires over the finger: wire taken in, moment arms P = dl/dq and their slopes.

A wire crosses a joint between a router on each phalanx, at axial distances a, b from the joint and heights n, m above
the bone. Distal router A = Rot(-q) (a, -+n), proximal one B = (-b, -+m), upper sign for the flexor (palmar). With
L(q) = |A - B|:

    L(q)^2 = a^2 + b^2 + m^2 + n^2 - 2 (D cos q + sigma E sin q)     D = m n - a b    E = m a + n b
    l = L(0) - L(q)     R = dl/dq = (sigma E cos q - D sin q) / L     dR/dq = (R^2 - sigma E sin q - D cos q) / L

with sigma = +1 for a flexor, -1 for the extensor. l is the wire taken in by the finger and R the signed moment arm
(R > 0 flexes): the paper's Eq. 1 and 2 with the sign kept and without the factor 0.5, which breaks T dl = tau dq
(`physics.md` 1.1). For a = b, m = n = h this is rho sin(alpha +- q/2).
"""

import sys
from math import sqrt

from exodrake.model.part import JOINTS, TENDONS, FreeLaw, Point
from exodrake.physics.arithmetic import dot

FLEXOR, EXTENSOR = 1.0, -1.0
HERE = sys.modules[__name__]


def path(cos_q, sin_q, a, b, m, n, side):
    """Wire taken in l [m], moment arm R [m] and dR/dq [m/rad] at one joint.

    Args: cos_q, sin_q of the joint angle; a, b, m, n [m]; side `FLEXOR` or `EXTENSOR`.
    """
    d = m * n - a * b
    e = side * (m * a + n * b)
    squares = a * a + b * b + m * m + n * n
    length = sqrt(squares - 2.0 * (d * cos_q + e * sin_q))
    arm = (e * cos_q - d * sin_q) / length
    return sqrt(squares - 2.0 * d) - length, arm, (arm * arm - e * sin_q - d * cos_q) / length


def applied_arm(arm):
    """Moment arm that turns tension into torque [m]: the same one, by virtual work."""
    return arm


def applied_arm_as_printed(arm):
    """Half the moment arm [m], by the factor 0.5 of Eq. 2 in our copy of the paper.

    A variant of `applied_arm`: T dl/dt = tau q' no longer holds (`physics.md` 1.1). The path keeps its true length.
    """
    return 0.5 * arm


router_height = Point("router_height", JOINTS, "height", "router height at joint i [m]",
                      (FreeLaw("height", "height", "m"),), HERE)  # fmt: skip
worn_height = Point("worn_height", TENDONS, "height, tension",
                    "router height under wire j [m], which its tension [N] may move",
                    (FreeLaw("height over tension", "tension", "N"),), HERE)  # fmt: skip
lever_height = Point("lever_height", TENDONS, "height",
                     "router height [m] with which wire j turns the joints, from its path's", (), HERE)  # fmt: skip


def levers(e, z, high):
    """Heights with which the wires turn the joints [m], as in `heights`, from those of their paths."""
    (f0, f1, f2), g0, (x0, x1, x2) = high
    flexors = (lever(e, z, 0, f0), lever(e, z, 0, f1), lever(e, z, 0, f2))
    return flexors, lever(e, z, 1, g0), (lever(e, z, 2, x0), lever(e, z, 2, x1), lever(e, z, 2, x2))


def lever(e, z, j, height):
    """Heights m, n [m] with which wire j turns one joint."""
    return lever_height(e, z, j, height[0]), lever_height(e, z, j, height[1])


def differ_from_levers(high):
    """Whether any wire turns the joints with other heights than those of its path; high: `heights`, `levers`."""
    path, turn = high
    return path[0][0][0] != turn[0][0][0] or path[1][0] != turn[1][0] or path[2][0][0] != turn[2][0][0]


def heights(e, z, n, pull):
    """Heights m, n [m] of the routers at tensions `pull` [N]: AF at three joints, MF at the MCP, AE at three joints."""
    f0 = pair(e, z, 0, 0, n.m_f, n.n_f, pull)
    f1 = pair(e, z, 0, 1, n.m_f, n.n_f, pull)
    f2 = pair(e, z, 0, 2, n.m_f, n.n_f, pull)
    x0 = pair(e, z, 2, 0, n.m_e, n.n_e, pull)
    x1 = pair(e, z, 2, 1, n.m_e, n.n_e, pull)
    x2 = pair(e, z, 2, 2, n.m_e, n.n_e, pull)
    return (f0, f1, f2), pair(e, z, 1, 0, n.m_f, n.n_f, pull), (x0, x1, x2)


def pair(e, z, j, i, proximal, distal, pull):
    """Heights of the proximal and the distal router of wire j at joint i [m]."""
    m = worn_height(e, z, j, router_height(e, z, i, proximal[i]), pull[j])
    return m, worn_height(e, z, j, router_height(e, z, i, distal[i]), pull[j])


def paths(n, cosines, sines, high):
    """Wire taken in [m], the rows of P [m] and of dP/dq [m/rad] for AF, MF, AE at these angles; high: `heights` [m]."""
    all_flexor, mcp_flexor, all_extensor = high
    f0 = path(cosines[0], sines[0], n.a_f[0], n.b_f[0], all_flexor[0][0], all_flexor[0][1], FLEXOR)
    f1 = path(cosines[1], sines[1], n.a_f[1], n.b_f[1], all_flexor[1][0], all_flexor[1][1], FLEXOR)
    f2 = path(cosines[2], sines[2], n.a_f[2], n.b_f[2], all_flexor[2][0], all_flexor[2][1], FLEXOR)
    g0 = path(cosines[0], sines[0], n.a_f[0], n.b_f[0], mcp_flexor[0], mcp_flexor[1], FLEXOR)
    x0 = path(cosines[0], sines[0], n.a_e[0], n.b_e[0], all_extensor[0][0], all_extensor[0][1], EXTENSOR)
    x1 = path(cosines[1], sines[1], n.a_e[1], n.b_e[1], all_extensor[1][0], all_extensor[1][1], EXTENSOR)
    x2 = path(cosines[2], sines[2], n.a_e[2], n.b_e[2], all_extensor[2][0], all_extensor[2][1], EXTENSOR)
    taken = (f0[0] + f1[0] + f2[0], g0[0], x0[0] + x1[0] + x2[0])
    arms = ((f0[1], f1[1], f2[1]), (g0[1], 0.0, 0.0), (x0[1], x1[1], x2[1]))
    return taken, arms, ((f0[2], f1[2], f2[2]), (g0[2], 0.0, 0.0), (x0[2], x1[2], x2[2]))


def take_in_further(here, move):
    """Wire taken in [m] after a small further move of the joints [rad], to the second order; here: `paths`."""
    taken, arms, bends = here
    half = (0.5 * move[0] * move[0], 0.5 * move[1] * move[1], 0.5 * move[2] * move[2])
    return (
        taken[0] + dot(arms[0], move) + dot(bends[0], half),
        taken[1] + dot(arms[1], move) + dot(bends[1], half),
        taken[2] + dot(arms[2], move) + dot(bends[2], half),
    )
