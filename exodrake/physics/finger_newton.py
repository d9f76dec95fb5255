"""Entries of the Newton step that moves the finger, and where its two-step formula starts from (`tendon_finger`)."""

from exodrake.physics.routers import applied_arm
from exodrake.physics.triples import column, dot


def stiffness(i, k, turns, arms, bends, falls, tensions, passive_slope, external_slope):
    """Entry i, k of d(passive - tendon - external torque)/dq [N m/rad]."""
    own = passive_slope - dot(column(bends, i), tensions) if i == k else 0.0
    r, s = column(turns, i), column(arms, k)
    return own + r[0] * s[0] * falls[0] + r[1] * s[1] * falls[1] + r[2] * s[2] * falls[2] - external_slope[k][i]


def newton_row(i, inertia, damping, lag, s, passive_slope, push_slope):
    """Row i of the Newton matrix d(residual)/d(rate) [N m s/rad]; inertia: row i of the mass matrix [kg m2]."""
    return (
        entry(i, 0, inertia[0], damping, lag, s, passive_slope, push_slope),
        entry(i, 1, inertia[1], damping, lag, s, passive_slope, push_slope),
        entry(i, 2, inertia[2], damping, lag, s, passive_slope, push_slope),
    )


def entry(i, k, inertia, damping, lag, s, passive_slope, push_slope):
    """Entry i, k of the Newton matrix [N m s/rad]."""
    own = inertia / lag + damping if i == k else inertia / lag
    return own + lag * stiffness(i, k, s[0], s[1], s[2], s[3], s[4], passive_slope, push_slope)


def torque(turns, i, pull):
    """Torque of the wires at joint i: row i of P^T T [N m]."""
    r = column(turns, i)
    return applied_arm(r[0]) * pull[0] + applied_arm(r[1]) * pull[1] + applied_arm(r[2]) * pull[2]


def behind(x, i):
    """Where the two-step formula starts from: (4 y_n - y_(n-1)) / 3."""
    return (4.0 * x[i] - x[i + 6]) / 3.0


def onward(x, i):
    """First guess of a rate: it goes on changing as in the last tick."""
    return 2.0 * x[i] - x[i + 6]
