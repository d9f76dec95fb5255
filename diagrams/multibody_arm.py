"""A serial arm as Drake's own MultibodyPlant: `multibody_arm(load_robot("improved.yaml"))`.

It knows payload and inertias of a diagnosis, and has an actuator for each joint, ports and all of Drake's tools.
"""

from __future__ import annotations

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.machines.export import robot_as


def multibody_arm(robot: Robot, step: float = 0.0) -> MultibodyPlant:
    """The arm of a robot, finalized: links, joints with damping, rotors, payload and a tilted base.

    Dry friction, elastic joints and other effects are not part of it.

    Args:
        robot: of a machine with an arm.
        step: of a discrete plant [s]; 0 for a continuous one.

    Raises:
        InputError: the robot has no arm.
    """
    if "arm.tip_mass" not in robot.machine.index:
        raise InputError(f"{robot.machine.name}: no arm that a MultibodyPlant could stand for")
    plant = MultibodyPlant(step)
    Parser(plant).AddModelsFromString(robot_as(robot, "urdf"), "urdf")
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -robot["arm.gravity"]]))
    plant.Finalize()
    return plant
