"""Forward dynamics of a serial arm under the efforts of its drives, with elastic joints where a compliance is stated.

    (M(q) + B) q'' = tau - c(q, q') - g(q)                                rigid joint, B: inertia of its rotor
    M(q) q'' = k (theta - q) - c(q, q') - g(q),   B theta'' = tau - k (theta - q)     elastic joint, k = 1 / compliance

Euler's rule for the speeds, then for the positions with the new speeds. Dry friction sits at the drive: it takes speed
away after the push, at most all of it, on all rigid joints at once (projected Gauss-Seidel). Positions are measured at
the drives. Beyond its limits a link meets a spring and a damper, which push it back and never pull.
"""

import sys
from typing import NamedTuple

from exodrake.core.part import JOINTS, Output, Part, State, Task
from exodrake.physics.arm import braked, fields, geared, link, points, pushed, settle, sprung
from exodrake.physics.rigid_arm import WIDTH, WRENCH, downwards, effort, gather, invert, mass_matrix, move
from exodrake.physics.scalar_laws import slowed

SWEEPS = 10  # over the joints; the coupling through the mass matrix leaves next to nothing after that many
ANGLE, SPEED, ROTOR, ROTOR_SPEED, PUSH, IMPULSE, STATES = 0, 1, 2, 3, 4, 5, 6


def place_of(count, state, j):
    """Where a state of joint j lies, behind the memory of the links and the matrix."""
    return (WIDTH + count + state) * count + j


def update(x, z, n, e, dt, effort_true):
    """One tick; signal [N m]."""
    count = effort_true.shape[0]
    if x[(WIDTH + count + STATES) * count] > 0.0:
        matrix = WIDTH * count
        gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
        for j in range(count):
            link(x, z, n, e, j, count, x[place_of(count, ANGLE, j)])
            move(x, j, x[place_of(count, SPEED, j)], 0.0, gravity)
        gather(x, count, WRENCH, WIDTH - WRENCH)
        mass_matrix(x, count, matrix)
        for j in range(count):
            drive(x, z, n, e, j, count, dt, effort_true[j])
        invert(x, count, matrix)
        accelerate(x, count, dt)
        brake(x, z, n, e, count, dt, effort_true)
        for j in range(count):
            advance(x, z, n, e, j, count, dt)


def drive(x, z, n, e, j, count, dt, given):
    """Effort on link j without its bias; an elastic joint's rotor moves on, a rigid one's inertia joins the link's."""
    rotor, speed = place_of(count, ROTOR, j), x[place_of(count, ROTOR_SPEED, j)]
    inertia, compliance = geared(e, z, j, n.rotor_inertia[j]), sprung(e, z, j, n.compliance[j])
    push = pushed(e, z, j, given, speed) - n.damping[j] * speed
    if compliance > 0.0:
        spring = (x[rotor] - x[place_of(count, ANGLE, j)]) / compliance
        free, mobility = speed + dt * (push - spring) / inertia, dt / inertia
        free = slowed(free, n.dry_friction[j] * mobility)
        x[place_of(count, ROTOR_SPEED, j)] = braked(e, z, j, free, mobility, abs(given))
        push = spring
    else:
        x[WIDTH * count + count * j + j] += inertia
    x[place_of(count, PUSH, j)] = push + stopped(x, n, j, count) - effort(x, j)


def stopped(x, n, j, count):
    """Effort of the end stops on link j [N m]: spring and damper, which push and do not pull."""
    place, speed = x[place_of(count, ANGLE, j)], x[place_of(count, SPEED, j)]
    above, below = place - n.stop_high[j], n.stop_low[j] - place
    if above > 0.0:
        return -max(0.0, n.stop_stiffness[j] * above + n.stop_damping[j] * speed)
    if below > 0.0:
        return max(0.0, n.stop_stiffness[j] * below - n.stop_damping[j] * speed)
    return 0.0


def accelerate(x, count, dt):
    """Speeds after the efforts acted for a tick; the matrix is inverted."""
    for j in range(count):
        for k in range(count):
            x[place_of(count, SPEED, j)] += dt * x[WIDTH * count + count * j + k] * x[place_of(count, PUSH, k)]
        x[place_of(count, IMPULSE, j)] = 0.0


def brake(x, z, n, e, count, dt, efforts):
    """Dry friction of the rigid joints: impulses that agree with all speeds."""
    for _ in range(SWEEPS):
        change = 0.0
        for j in range(count):
            if sprung(e, z, j, n.compliance[j]) > 0.0:
                continue
            own, at = x[WIDTH * count + count * j + j], place_of(count, IMPULSE, j)
            free = x[place_of(count, SPEED, j)] - own * x[at]
            after = slowed(free, n.dry_friction[j] * dt * own)
            after = braked(e, z, j, after, dt * own, abs(efforts[j]))
            more = (after - free) / own - x[at]
            x[at] += more
            change = max(change, abs(more))
            for i in range(count):
                x[place_of(count, SPEED, i)] += x[WIDTH * count + count * i + j] * more
        if change == 0.0:
            break


def advance(x, z, n, e, j, count, dt):
    """Positions of joint j after the tick, and the states of its effects."""
    at, speed = place_of(count, ANGLE, j), x[place_of(count, SPEED, j)]
    x[at] += dt * speed
    if sprung(e, z, j, n.compliance[j]) > 0.0:
        speed = x[place_of(count, ROTOR_SPEED, j)]
        x[place_of(count, ROTOR, j)] += dt * speed
    else:
        x[place_of(count, ROTOR, j)], x[place_of(count, ROTOR_SPEED, j)] = x[at], speed
    settle(e, z, j, dt, dt * speed)


def stand(x, z, n, e, position_start):
    """Where the arm stands at the start of the log [rad], taken in the first frame; it rests there."""
    count = position_start.shape[0]
    if x[(WIDTH + count + STATES) * count] == 0.0:
        for j in range(count):
            x[place_of(count, ANGLE, j)] = position_start[j]
            x[place_of(count, ROTOR, j)] = position_start[j]
        x[(WIDTH + count + STATES) * count] = 1.0


def output(x, z, n, e, position, link_position):
    """Positions at the drives and behind the compliance [rad]."""
    count = position.shape[0]
    for j in range(count):
        position[j], link_position[j] = x[place_of(count, ROTOR, j)], x[place_of(count, ANGLE, j)]


def start(x, z, n, e, start_stroke):
    """At rest, not placed yet."""
    x[:] = 0.0


def part(count: int, slot: int, scales: dict[str, tuple[float, str]], unit: dict[str, str]) -> Part:
    """The arm as a part.

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
        name="arm",
        module=sys.modules[__name__],
        parameters=NamedTuple("Parameters", fields(per_joint, {})),
        states=(
            State("link", JOINTS, WIDTH), State("matrix", JOINTS, count),
            *(State(name, JOINTS, unit=u) for name, u in own), State("placed"),
        ),
        tasks=(Task("update", ("effort_true",)), Task("stand", ("position_start",), slots=(slot,))),
        outputs=(Output("output", ("position", "link_position")),),
        points=points("sprung"),
        scales=scales,
    )  # fmt: skip
