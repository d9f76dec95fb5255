"""Inverse dynamics of a serial arm: the effort that its drives need for a measured motion.

    tau = M(q) q'' + c(q, q') + g(q) + (rotor inertia) q'' + friction(q')

Dry friction at a speed below `mobility` times its level grows in proportion to the speed, as noise makes the sign of a
smaller one uncertain.
"""

import sys
from typing import NamedTuple

from exodrake.core.part import JOINTS, Output, Part, State, Task
from exodrake.physics.arm import braked, fields, geared, link, points, pushed, seen, settle
from exodrake.physics.rigid_arm import WIDTH, WRENCH, downwards, effort, gather, move
from exodrake.physics.scalar_laws import slowed


def update(x, z, n, e, dt, position, velocity, acceleration):
    """Efforts of one tick; signals [rad], [rad/s], [rad/s2]. x: memory of the links, efforts [N m]."""
    count = position.shape[0]
    gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
    for j in range(count):
        link(x, z, n, e, j, count, seen(e, z, j, position[j]))
        move(x, j, velocity[j], acceleration[j], gravity)
    gather(x, count, WRENCH, WIDTH - WRENCH)
    for j in range(count):
        speed = velocity[j]
        torque = effort(x, j) + geared(e, z, j, n.rotor_inertia[j]) * acceleration[j] + n.damping[j] * speed
        rest = braked(e, z, j, slowed(speed, n.dry_friction[j] * n.mobility), n.mobility, abs(torque))
        drag = torque - pushed(e, z, j, torque, speed)
        x[WIDTH * count + j] = torque + drag + (speed - rest) / n.mobility
        settle(e, z, j, dt, dt * speed)


def output(x, z, n, e, effort):
    """Efforts [N m]."""
    for j in range(effort.shape[0]):
        effort[j] = x[WIDTH * effort.shape[0] + j]


def start(x, z, n, e, start_stroke):
    """Nothing moves yet."""
    x[:] = 0.0


def part(scales: dict[str, tuple[float, str]], unit: dict[str, str]) -> Part:
    """The arm as a part; scales: of its friction; unit: of inertia, effort and effort/speed."""
    per_joint = {
        "rotor_inertia": unit["inertia"], "damping": unit["effort/speed"], "dry_friction": unit["effort"],
    }  # fmt: skip
    return Part(
        name="arm",
        module=sys.modules[__name__],
        parameters=NamedTuple("Parameters", fields(per_joint, {"mobility": "-"})),
        states=(State("link", JOINTS, WIDTH), State("effort", JOINTS, unit=unit["effort"])),
        tasks=(Task("update", ("position", "velocity", "acceleration")),),
        outputs=(Output("output", ("effort",)),),
        points=points("seen"),
        scales=scales,
    )
