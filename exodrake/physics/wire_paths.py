"""Paths of the three wires over the finger: wire taken in, moment arms P = dl/dq and their slopes."""

from exodrake.physics.routers import EXTENSOR, FLEXOR, path


def router_height(e, z, i, height):
    """Point: router height at joint i [m]."""
    return height


def worn_height(e, z, j, height, tension):
    """Point: router height under wire j [m], which its tension [N] may move."""
    return height


def lever_height(e, z, j, height):
    """Point: router height [m] with which wire j turns the joints, from that of its path."""
    return height


def levers(e, z, high):
    """Heights with which the wires turn the joints [m], as in `heights`, from those of their paths."""
    (f0, f1, f2), g0, (x0, x1, x2) = high
    flexors = (lever(e, z, 0, f0), lever(e, z, 0, f1), lever(e, z, 0, f2))
    return flexors, lever(e, z, 1, g0), (lever(e, z, 2, x0), lever(e, z, 2, x1), lever(e, z, 2, x2))


def lever(e, z, j, height):
    """Heights m, n [m] with which wire j turns one joint."""
    return lever_height(e, z, j, height[0]), lever_height(e, z, j, height[1])


def moved(high):
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


def flexor(i, cosines, sines, height, n):
    """Path of a flexor over joint i: l, R, dR/dq (`routers.path`); height: m and n [m]."""
    return path(cosines[i], sines[i], n.a_f[i], n.b_f[i], height[0], height[1], FLEXOR)


def extensor(i, cosines, sines, height, n):
    """Path of an extensor over joint i: l, R, dR/dq (`routers.path`); height: m and n [m]."""
    return path(cosines[i], sines[i], n.a_e[i], n.b_e[i], height[0], height[1], EXTENSOR)


def paths(n, cosines, sines, high):
    """Wire taken in [m], the rows of P [m] and of dP/dq [m/rad] for AF, MF, AE at these angles; high: `heights` [m]."""
    all_flexor, mcp_flexor, all_extensor = high
    f0 = flexor(0, cosines, sines, all_flexor[0], n)
    f1 = flexor(1, cosines, sines, all_flexor[1], n)
    f2 = flexor(2, cosines, sines, all_flexor[2], n)
    g0 = flexor(0, cosines, sines, mcp_flexor, n)
    x0 = extensor(0, cosines, sines, all_extensor[0], n)
    x1 = extensor(1, cosines, sines, all_extensor[1], n)
    x2 = extensor(2, cosines, sines, all_extensor[2], n)
    taken = (f0[0] + f1[0] + f2[0], g0[0], x0[0] + x1[0] + x2[0])
    arms = ((f0[1], f1[1], f2[1]), (g0[1], 0.0, 0.0), (x0[1], x1[1], x2[1]))
    return taken, arms, ((f0[2], f1[2], f2[2]), (g0[2], 0.0, 0.0), (x0[2], x1[2], x2[2]))
