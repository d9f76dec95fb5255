"""Links, payload and friction of a serial arm: what its inverse and its forward dynamics share, with their points.

The friction family (`sliding.*`) acts on each joint. Link frames, axes and inertias are those of the URDF.
"""

import sys
from typing import Annotated

from exodrake.core.part import JOINTS, SCALAR, Point, Unit
from exodrake.physics.rigid_arm import add_point, in_base, load, place


def weighed(e, z, j, mass):
    """Point: mass of link j [kg]."""
    return mass


def carried(e, z, mass):
    """Point: mass at the tip [kg]."""
    return mass


def geared(e, z, j, inertia):
    """Point: inertia of the rotor of joint j as the joint feels it [kg m2]."""
    return inertia


def seen(e, z, j, position):
    """Point: position of joint j [rad], from the measured one, in inverse dynamics."""
    return position


def sprung(e, z, j, compliance):
    """Point: compliance between drive and joint j [rad/(N m)], in forward dynamics."""
    return compliance


def pushed(e, z, j, effort, speed):
    """Point: effort on joint j [N m], from that of the drive; speed [rad/s]."""
    return effort


def braked(e, z, j, speed, mobility, load):
    """Point: speed of joint j [rad/s] after dry friction; mobility: speed per effort; load: |effort| [N m]."""
    return speed


def settle(e, z, j, dt, travel):
    """Point: after a tick, states of the effects on joint j advance by dt [s]; travel [rad]."""


def link(x, z, n, e, j, count, q):
    """Place and inertia of link j at q; the last one holds the payload."""
    body(x, n, j, count, q, weighed(e, z, j, n.mass[j]), carried(e, z, n.tip_mass))


def body(x, n, j, count, q, mass, payload):
    """Place and inertia of link j with this mass, and payload at the tip [kg].

    For any part whose parameters begin with those of `fields`, such as a controller with a model of the arm.
    """
    origin, angles = (n.x[j], n.y[j], n.z[j]), (n.roll[j], n.pitch[j], n.yaw[j])
    place(x, j, origin, angles, (n.axis_x[j], n.axis_y[j], n.axis_z[j]), n.sliding[j], q)
    centre = (n.com_x[j], n.com_y[j], n.com_z[j])
    load(x, j, mass, centre, (n.xx[j], n.xy[j], n.xz[j], n.yy[j], n.yz[j], n.zz[j]))
    if j == count - 1:
        add_point(x, j, payload, in_base(x, j, (n.tip_x, n.tip_y, n.tip_z)))


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


def fields(joints: dict[str, str], scalars: dict[str, str]) -> list:
    """Fields of a parameter class with units: those of an arm first, then further ones of each joint, and scalars."""
    each = [(name, Annotated[tuple, Unit(unit, JOINTS)]) for name, unit in LINK.items()]
    each += [(name, Annotated[float, Unit(unit)]) for name, unit in BODY.items()]
    each += [(name, Annotated[tuple, Unit(unit, JOINTS)]) for name, unit in joints.items()]
    return each + [(name, Annotated[float, Unit(unit)]) for name, unit in scalars.items()]


def points(*names: str) -> tuple[Point, ...]:
    """The points by name; those of the friction family are standard ones."""
    friction = ("pushed", "braked", "settle")
    return tuple(
        Point(name, SCALAR if name == "carried" else JOINTS, sys.modules[__name__],
              f"sliding.{name}" if name in friction else "")
        for name in ("weighed", "carried", "geared", *names, *friction)
    )  # fmt: skip
