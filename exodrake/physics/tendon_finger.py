"""Three elastic tendons on a planar finger, one stiff part (`physics.md`, Wire, Path, Finger).

    M(q) q'' + C(q, q') q' + B q' + tau_p(q) = P(q)^T T_d + tau_external          P = dl/dq

One tick is the two-step backward differentiation formula (L-stable, second order), solved for q' by Newton's method:
the wire on the light distal phalanx rings at 430 rad/s and joint damping decays at 2400 1/s. The spool is taken to move
on at its speed during the tick.
"""

import sys
from math import cos, sin

from exodrake.model.part import JOINTS, SCALAR, TENDONS, Output, Part, State, Task, parameter_class
from exodrake.physics import finger, tendon, wire_paths
from exodrake.physics.arithmetic import add, column, dot, multiply, solve
from exodrake.physics.finger import coriolis, external_with_slope, inertia, mass_matrix, passive_with_slope, relax
from exodrake.physics.tendon import at_cell, at_spool, cell_tension, finger_tension, move_slide, settle, stretch_wire
from exodrake.physics.wire_paths import applied_arm, differ_from_levers, heights, levers, paths, take_in_further


def newton_row(i, inertia, damping, lag, s, passive_slope, push_slope):
    """Row i of the Newton matrix d(residual)/d(rate) [N m s/rad]; inertia: row i of the mass matrix [kg m2]."""
    return (
        entry(i, 0, inertia[0], damping, lag, s, passive_slope, push_slope),
        entry(i, 1, inertia[1], damping, lag, s, passive_slope, push_slope),
        entry(i, 2, inertia[2], damping, lag, s, passive_slope, push_slope),
    )


def entry(i, k, inertia, damping, lag, s, passive_slope, push_slope):
    """Entry i, k of the Newton matrix [N m s/rad]; lag times d(passive - tendon - external torque)/dq is in it."""
    turns, arms, bends, falls, pull = s
    own = inertia / lag + damping if i == k else inertia / lag
    stiffness = passive_slope - dot(column(bends, i), pull) if i == k else 0.0
    r, a = column(turns, i), column(arms, k)
    stiffness = stiffness + r[0] * a[0] * falls[0] + r[1] * a[1] * falls[1] + r[2] * a[2] * falls[2] - push_slope[k][i]
    return own + lag * stiffness


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


class Parameters(parameter_class(
    (TENDONS, {"k": "N/m"}, "tendon"), (SCALAR, {"presliding": "m"}, "tendon"),
    (JOINTS, dict.fromkeys(("a_f", "b_f", "m_f", "n_f", "a_e", "b_e", "m_e", "n_e"), "m"), "router"),
    (JOINTS, {"kappa": "N m/rad", "q0": "rad", "B": "N m s/rad", "q_f": "rad", "q_e": "rad", "beta": "1/rad"}),
    (JOINTS, {"A": "N m", "length": "m", "mass": "kg", "radius": "m"}),
)):  # fmt: skip
    """Wires, routers (a, b, m, n per joint for flexor and extensor) and finger."""


Q, RATE, Q_BEFORE, RATE_BEFORE, TAKEN, SLIDE, PULL, CLOCK = 0, 3, 6, 9, 12, 15, 18, 21
STEPS, CLOSE = 6, 1e-5  # Newton steps at most; last step [rad]: they converge quadratically, to 1e-9 after it
RESTING = 0.02  # length of a tick before the log begins [s]
PULLING = 0.1  # tension with which a finger does not rest in q0 [N], ten times the noise of the cells; assumed
RESTS = 100  # ticks: 2 s, 40 time constants B / kappa
NUDGE = 1e-7  # of difference quotients [m]


def wire(e, z, j, n, x, stroke, taken, dt):
    """Tension at the finger [N] and its fall with wire taken in, -dT_d/dl [N/m], for wire j at the end of a tick."""
    travel = taken - x[TAKEN + j]
    tension = pull_wire(e, z, j, n, x, stroke - taken, travel, dt)
    beyond = pull_wire(e, z, j, n, x, stroke - taken - NUDGE, travel + NUDGE, dt)
    return tension, (tension - beyond) / NUDGE


def pull_wire(e, z, j, n, x, extension, travel, dt):
    """Tension at the finger [N] of wire j, extended by `extension` [m], after a tick that took in `travel` [m]."""
    stretched = stretch_wire(e, z, j, extension, x[PULL + j])
    tension = cell_tension(e, z, j, stretched, travel, n.k[j])
    slide = move_slide(x[SLIDE + j], travel, n.presliding, tension)
    return finger_tension(e, z, j, tension, stretched, slide, travel, travel / dt)


def newton_step(e, z, n, x, ends, angle, rate, rate_from, constants, high, dt, lag):
    """One Newton step for the joint rates at the end of a tick: their change [rad/s], and the `paths` of the wires.

    Args: ends: strokes at the end of the tick [m]; angle, rate: the iterate;
        rate_from, lag [s]: rate' = (rate - rate_from) / lag; high: `heights` and `levers` [m].
    """
    diagonal, coupling, moments = constants
    cosines, sines = (cos(angle[0]), cos(angle[1]), cos(angle[2])), (sin(angle[0]), sin(angle[1]), sin(angle[2]))
    cos_12, sin_12 = cosines[1] * cosines[2] - sines[1] * sines[2], sines[1] * cosines[2] + cosines[1] * sines[2]
    here = paths(n, cosines, sines, high[0])
    taken, arms, bends = here
    turns = arms
    if differ_from_levers(high):
        _, turns, bends = paths(n, cosines, sines, high[1])
    t0, g0 = wire(e, z, 0, n, x, ends[0], taken[0], dt)
    t1, g1 = wire(e, z, 1, n, x, ends[1], taken[1], dt)
    t2, g2 = wire(e, z, 2, n, x, ends[2], taken[2], dt)
    pull, falls = (t0, t1, t2), (g0, g1, g2)
    now = x[CLOCK] + dt
    p0, k0 = passive_with_slope(e, z, 0, n, angle[0], rate[0], now, lag)
    p1, k1 = passive_with_slope(e, z, 1, n, angle[1], rate[1], now, lag)
    p2, k2 = passive_with_slope(e, z, 2, n, angle[2], rate[2], now, lag)
    push, push_slope = external_with_slope(e, z, n, angle, rate, moments, now, lag)
    m11, m12, m13, m22, m23, m33 = mass_matrix(diagonal, coupling, cosines[1], cosines[2], cos_12)
    spin = coriolis(coupling, sines[1], sines[2], sin_12, rate)
    speed_up = ((rate[0] - rate_from[0]) / lag, (rate[1] - rate_from[1]) / lag, (rate[2] - rate_from[2]) / lag)
    r0 = dot((m11, m12, m13), speed_up) + spin[0] + n.B[0] * rate[0] + p0 - torque(turns, 0, pull) - push[0]
    r1 = dot((m12, m22, m23), speed_up) + spin[1] + n.B[1] * rate[1] + p1 - torque(turns, 1, pull) - push[1]
    r2 = dot((m13, m23, m33), speed_up) + spin[2] + n.B[2] * rate[2] + p2 - torque(turns, 2, pull) - push[2]
    s = (turns, arms, bends, falls, pull)
    rows = (
        newton_row(0, (m11, m12, m13), n.B[0], lag, s, k0, push_slope),
        newton_row(1, (m12, m22, m23), n.B[1], lag, s, k1, push_slope),
        newton_row(2, (m13, m23, m33), n.B[2], lag, s, k2, push_slope),
    )
    return solve(rows, (-r0, -r1, -r2)), here


def update(x, z, n, e, dt, stroke, wire_speed):
    """One tick of length dt [s]; signals [m], [m/s]. Before the first one, the finger may come to rest."""
    rests = 0
    if x[CLOCK] == 0.0:
        for j in range(3):  # by the tension in the wires before the finger has moved
            stretched = stretch_wire(e, z, j, stroke[j] - x[TAKEN + j], 0.0)
            rests = max(rests, rests_before(cell_tension(e, z, j, stretched, 0.0, n.k[j])))
    for k in range(rests + 1):
        resting = k < rests
        tick(x, z, n, e, RESTING if resting else dt, stroke, wire_speed, 0.0 if resting else dt)
        for i in range(3 if resting else 0):  # it stands still again
            x[RATE + i] = x[RATE_BEFORE + i] = 0.0
            x[Q_BEFORE + i] = x[Q + i]
    x[CLOCK] += dt


def rests_before(tension):
    """Ticks of rest before the log begins, by the tension in a wire [N]: none, it begins in q0 however it pulls."""
    return 0


def rests_at_switch_on(tension):
    """Ticks of rest before the log begins, by the tension in a wire [N], a variant: at rest at switch-on.

    The nominal log begins in q0 at once, as that of the reference simulator does: wires homed 1 mm too far in then pull
    at the finger with 2.7 N, and it moves before the controller does.
    """
    return RESTS if tension > PULLING else 0


def tick(x, z, n, e, dt, stroke, wire_speed, turning):
    """One tick of length dt [s]; signals [m], [m/s]; turning: time for which the spool moves on at its speed [s]."""
    constants = inertia(n.length, n.mass, n.radius)
    worn = heights(e, z, n, (x[PULL], x[PULL + 1], x[PULL + 2]))
    high = (worn, levers(e, z, worn))
    lag = 2.0 * dt / 3.0
    s = (turning * wire_speed[0], turning * wire_speed[1], turning * wire_speed[2])
    ends = (stroke[0] + s[0], stroke[1] + s[1], stroke[2] + s[2])
    q_from = (behind(x, Q), behind(x, Q + 1), behind(x, Q + 2))
    rate_from = (behind(x, RATE), behind(x, RATE + 1), behind(x, RATE + 2))
    rate = (onward(x, RATE), onward(x, RATE + 1), onward(x, RATE + 2))
    angle = add(q_from, multiply(lag, rate))
    for _ in range(STEPS):
        change, here = newton_step(e, z, n, x, ends, angle, rate, rate_from, constants, high, dt, lag)
        rate = add(rate, change)
        angle = add(q_from, multiply(lag, rate))
        if lag * max(abs(change[0]), abs(change[1]), abs(change[2])) < CLOSE:
            break
    for i in range(3):
        x[Q_BEFORE + i], x[RATE_BEFORE + i] = x[Q + i], x[RATE + i]
        x[Q + i], x[RATE + i] = angle[i], rate[i]
        relax(e, z, i, dt, angle[i] - n.q0[i], rate[i], n.kappa[i] * (angle[i] - n.q0[i]))
    taken = take_in_further(here, multiply(lag, change))
    for j in range(3):
        travel = taken[j] - x[TAKEN + j]
        stretched = stretch_wire(e, z, j, ends[j] - taken[j], x[PULL + j])
        tension = cell_tension(e, z, j, stretched, travel, n.k[j])
        x[SLIDE + j] = move_slide(x[SLIDE + j], travel, n.presliding, tension)
        x[PULL + j] = finger_tension(e, z, j, tension, stretched, x[SLIDE + j], travel, travel / dt)
        x[TAKEN + j] = taken[j]
        settle(e, z, j, dt, stretched, tension, x[PULL + j], travel)


def taken_in(x, n, high):
    """Wire that each tendon's path takes in [m] at the joint angles of the state; router heights `high` [m]."""
    cosines, sines = (cos(x[Q]), cos(x[Q + 1]), cos(x[Q + 2])), (sin(x[Q]), sin(x[Q + 1]), sin(x[Q + 2]))
    taken, _, _ = paths(n, cosines, sines, high)
    return taken


def output_tension(x, z, n, e, stroke, tension, tension_spool):
    """Tension at the cell and at the spool [N], directly from the stroke [m]."""
    for j in range(3):
        stretched = stretch_wire(e, z, j, stroke[j] - x[TAKEN + j], x[PULL + j])
        own = cell_tension(e, z, j, stretched, 0.0, n.k[j])
        tension[j], tension_spool[j] = at_cell(e, z, j, own), at_spool(e, z, j, own)


def hold(x, z, n, e, angle):
    """Puts the finger at rest into a posture [rad]."""
    for i in range(3):
        x[Q + i], x[RATE + i] = angle[i], 0.0
    taken = taken_in(x, n, heights(e, z, n, (x[PULL], x[PULL + 1], x[PULL + 2])))
    for j in range(3):
        x[TAKEN + j] = taken[j]


def start(x, z, n, e, start_stroke):
    """At rest in q0; writes the strokes [m] at which the wires are just taut there."""
    x[:] = 0.0
    for i in range(3):
        x[Q + i] = x[Q_BEFORE + i] = n.q0[i]
    taken = taken_in(x, n, heights(e, z, n, (0.0, 0.0, 0.0)))
    for j in range(3):
        x[TAKEN + j] = start_stroke[j] = taken[j]


PART = Part(
    name="finger", module=sys.modules[__name__], parameters=Parameters, fills_start=True,
    states=(
        State("angle", JOINTS, unit="rad"), State("rate", JOINTS, unit="rad/s"),
        State("angle_before", JOINTS, unit="rad"), State("rate_before", JOINTS, unit="rad/s"),
        State("taken", TENDONS, unit="m"), State("slide", TENDONS), State("pull", TENDONS, unit="N"),
        State("clock", SCALAR, unit="s"),
    ),
    tasks=(Task("update", ("stroke", "wire_speed")),),
    outputs=(
        Output.of_states(angle="angle", rate="rate", pull="tension_finger"),
        Output("output_tension", ("tension", "tension_spool"), reads=("stroke",)),
    ),
    points=(
        wire_paths.router_height, wire_paths.worn_height, wire_paths.lever_height,
        tendon.stretch, tendon.elastic, tendon.near_end, tendon.far_end, tendon.transmit, at_cell, at_spool, settle,
        finger.passive, finger.external, relax,
    ),
)  # fmt: skip
