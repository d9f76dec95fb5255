"""Rotor behind a gear, driven by a current-limited PI speed loop; one per wire.

    w_ref = v_ref N / r_set      e = w_ref - w      i = clip(Kp e + z, -i_max, +i_max)      z' = Ki e
    J w' = kM i - b w - r T_c / N               theta' = w / N                          s = r theta

z is frozen while i is clipped and e pushes on. r_set is the spool radius configured in drive and log: nominally r.
Integrated by the classical Runge-Kutta rule over one tick with command and tension held (`physics.md`, Motor).
"""

import sys

from exodrake.model.part import SCALAR, TENDONS, FreeLaw, Output, Part, Point, State, Task, free_memory, parameter_class

# motor, gear, spool and drive of each wire; the gear ratio and the spool radius configured in all drives
Parameters = parameter_class(
    (TENDONS, {"kM": "N m/A", "J": "kg m2", "b": "N m s/rad"}), (SCALAR, {"N": "-"}), (TENDONS, {"r": "m"}),
    (SCALAR, {"r_set": "m"}), (TENDONS, {"Kp": "A s/rad", "Ki": "A/rad", "i_max": "A"}),
)  # fmt: skip

follow = Point("follow", TENDONS, "dt, speed, loop_time",
               "before a tick, states of the effects on the command [m/s] of motor j after dt [s]; loop_time: time "
               "constant J / (Kp kM) of the nominal speed loop [s]", laws=())  # fmt: skip
command = Point(
    "command", TENDONS, "speed, tension",
    "wire speed that the drive follows [m/s], from the one that it was sent; tension [N]",
    laws=(
        FreeLaw("speed over its command", "speed", "m/s", fine=True),
        FreeLaw("loss of speed over tension", "tension", "N", "-1.0"),
        *free_memory("of speed over its command", "speed", "m/s", "follow"),
    ),
)  # fmt: skip
loop_gain = Point("loop_gain", TENDONS, "gain", "factor on both gains of the speed loop [-]", laws=())
integral_gain = Point("integral_gain", TENDONS, "gain", "factor on the integral gain of the speed loop [-]", laws=())
current_limit = Point("current_limit", TENDONS, "limit", "current at which the drive clips [A]", laws=())
current = Point("current", TENDONS, "clipped, wanted, limit",
                "current that flows [A] where the drive wants another one and clips it [A]")  # fmt: skip
load = Point(
    "load", TENDONS, "tension, spool",
    "wire tension felt by the gear at the spool's nominal radius [N]; spool: r theta [m]",
    laws=(
        FreeLaw("load over tension", "tension", "N"),
        FreeLaw("radius for the load over wire wound", "spool", "m", "tension"),
    ),
)  # fmt: skip
drag = Point("drag", TENDONS, "torque", "torque that the wire's load and losses put on the rotor [N m]", laws=())
wind_wire = Point(
    "wound", TENDONS, "stroke", "wire on the spool [m], from r theta",
    laws=(FreeLaw("wire wound over spool angle", "stroke", "m", rate=("winding", "spool", "speed * (1.0 + slope)")),),
)  # fmt: skip
winding_speed = Point("winding", TENDONS, "speed, spool",
                      "speed of the wire [m/s] at the spool, from r theta'; spool: r theta [m]", laws=())  # fmt: skip
settle = Point("settle", TENDONS, "dt, rotor_speed",
               "states of the effects on motor j after dt [s]; rotor speed [rad/s]", laws=())  # fmt: skip


def drive(e, z, w, integral, w_ref, load_torque, kp, ki, i_max, j, n):
    """Torque that speeds the rotor up [N m] and rate of the integral part [A/s]."""
    error = w_ref - w
    wanted = kp * error + integral
    amps = current(e, z, j, min(max(wanted, -i_max), i_max), wanted, i_max)
    frozen = (wanted > i_max and error > 0.0) or (wanted < -i_max and error < 0.0)
    return n.kM[j] * amps - n.b[j] * w - load_torque, 0.0 if frozen else ki * error


def turn(e, z, w, integral, angle, w_ref, load_torque, kp, ki, i_max, dt, j, n):
    """Rotor speed, integral part and output angle after dt."""
    half, push = 0.5 * dt, dt / n.J[j]  # [s], and the change of speed by a torque [rad/s per N m]
    t1, c1 = drive(e, z, w, integral, w_ref, load_torque, kp, ki, i_max, j, n)
    t2, c2 = drive(e, z, w + 0.5 * push * t1, integral + half * c1, w_ref, load_torque, kp, ki, i_max, j, n)
    t3, c3 = drive(e, z, w + 0.5 * push * t2, integral + half * c2, w_ref, load_torque, kp, ki, i_max, j, n)
    t4, c4 = drive(e, z, w + push * t3, integral + dt * c3, w_ref, load_torque, kp, ki, i_max, j, n)
    angle += dt * (w + push * (t1 + t2 + t3) / 6.0) / n.N
    w += push * (t1 + 2.0 * (t2 + t3) + t4) / 6.0
    return w, integral + dt * (c1 + 2.0 * (c2 + c3) + c4) / 6.0, angle


def update(x, z, n, e, dt, speed_applied, tension_spool):
    """One tick. x: rotor speeds, integral parts [A], output angles [rad] (3 each); signals [m/s], [N]."""
    for j in range(3):
        w = x[j]
        follow(e, z, j, dt, speed_applied[j], n.J[j] / (n.Kp[j] * n.kM[j]))
        w_ref = command(e, z, j, speed_applied[j], tension_spool[j]) * n.N / n.r_set
        load_torque = drag(e, z, j, n.r[j] * load(e, z, j, tension_spool[j], n.r[j] * x[6 + j]) / n.N)
        kp, ki = n.Kp[j] * loop_gain(e, z, j, 1.0), n.Ki[j] * integral_gain(e, z, j, 1.0)
        limit = current_limit(e, z, j, n.i_max[j])
        x[j], x[3 + j], x[6 + j] = turn(e, z, w, x[3 + j], x[6 + j], w_ref, load_torque, kp, ki, limit, dt, j, n)
        settle(e, z, j, dt, x[j])


def output(x, z, n, e, stroke, wire_speed, spool_angle):
    """Wire wound in [m], its speed [m/s], and the spool's angle, which the encoder sees [rad]."""
    for j in range(3):
        spool_angle[j] = x[6 + j]
        stroke[j] = wind_wire(e, z, j, n.r[j] * x[6 + j])
        wire_speed[j] = winding_speed(e, z, j, n.r[j] * x[j] / n.N, n.r[j] * x[6 + j])


def start(x, z, n, e, start_stroke):
    """At rest with the wires just taut (`start_stroke` [m])."""
    x[:] = 0.0
    for j in range(3):
        x[6 + j] = start_stroke[j] / n.r[j]


PART = Part(
    name="motor", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("w", TENDONS, unit="rad/s"), State("integral", TENDONS, unit="A"), State("theta", TENDONS, unit="rad"),
    ),
    tasks=(Task("update", ("speed_applied", "tension_spool")),),
    outputs=(Output("output", ("stroke", "wire_speed", "spool_angle")),),
    points=(
        follow, command, loop_gain, integral_gain, current_limit, current, load, drag, wind_wire, winding_speed, settle,
    ),
)  # fmt: skip
