"""A serial arm as Drake's own MultibodyPlant: `multibody_arm(load_robot("improved.yaml"))`.

It knows payload and inertias of a diagnosis, and has an actuator for each joint, ports and all of Drake's tools.
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)  # fmt: skip

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot


def multibody_arm(robot: Robot, step: float = 0.0) -> MultibodyPlant:
    """The arm of a robot, finalized: links, joints with damping, rotors, payload, gravity in the axes of its base.

    Dry friction, elastic joints and other effects are not part of it.

    Args:
        robot: of a machine with an arm.
        step: of a discrete plant [s]; 0 for a continuous one.

    Raises:
        InputError: the robot has no arm.
    """
    if "arm.tip_mass" not in robot.machine.index:
        raise InputError(f"{robot.machine.name}: no arm that a MultibodyPlant could stand for")
    plant, loads = MultibodyPlant(step), arm_loads(robot)
    roll, pitch = robot["arm.base_roll"], robot["arm.base_pitch"]
    down = RollPitchYaw(roll, pitch, 0.0).ToRotationMatrix().matrix().T @ np.array([0.0, 0.0, -robot["arm.gravity"]])
    plant.mutable_gravity_field().set_gravity_vector(down)
    parent = plant.world_body()
    for j, name in enumerate(robot.machine.axes.joints):
        body = plant.AddRigidBody(f"link_{name}", loads[j])
        add_joint(plant, robot, name, parent, body)
        parent = body
    plant.Finalize()
    return plant


def values(robot: Robot, joint: str, *names: str) -> np.ndarray:
    """Parameters of a joint."""
    return np.array([robot[f"arm.{name}.{joint}"] for name in names])


def effect_value(robot: Robot, name: str) -> float:
    """A parameter of an effect; 0 of one that the machine lacks."""
    return robot[name] if name in robot.machine.index else 0.0


def arm_loads(robot: Robot) -> list[SpatialInertia]:
    """Spatial inertias of the links about their joints' origins, the last with the payload."""
    found = []
    for name in robot.machine.axes.joints:
        mass = robot[f"arm.mass.{name}"] * (1.0 + effect_value(robot, f"arm.link_mass.share.{name}"))
        xx, xy, xz, yy, yz, zz = values(robot, name, "xx", "xy", "xz", "yy", "yz", "zz")
        about = RotationalInertia(xx, yy, zz, xy, xz, yz)
        centre = values(robot, name, "com_x", "com_y", "com_z")
        found.append(SpatialInertia.MakeFromCentralInertia(mass, centre, about))
    payload = robot["arm.tip_mass"] + effect_value(robot, "arm.payload.mass")
    if payload > 0.0:
        tip = np.array([robot[f"arm.tip_{axis}"] for axis in "xyz"])
        found[-1] += SpatialInertia(payload, tip, UnitInertia.PointMass(tip))
    return found


def add_joint(plant: MultibodyPlant, robot: Robot, name: str, parent: RigidBody, body: RigidBody) -> None:
    """A joint with damping, its actuator and the inertia of its rotor."""
    place = RigidTransform(RollPitchYaw(*values(robot, name, "roll", "pitch", "yaw")), values(robot, name, *"xyz"))
    frame = plant.AddFrame(FixedOffsetFrame(f"at_{name}", parent.body_frame(), place))
    kind = PrismaticJoint if robot[f"arm.sliding.{name}"] else RevoluteJoint
    axis = values(robot, name, "axis_x", "axis_y", "axis_z")
    joint = plant.AddJoint(kind(name, frame, body.body_frame(), axis, damping=robot[f"arm.damping.{name}"]))
    rotor = robot[f"arm.rotor_inertia.{name}"] + effect_value(robot, f"arm.rotor_inertia.inertia.{name}")
    plant.AddJointActuator(name, joint).set_default_rotor_inertia(rotor)
