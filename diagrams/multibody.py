"""Robots as Drake's own MultibodyPlant: a serial arm, and a finger under the same tendons.

    plant = multibody_arm(load_robot("improved.yaml"))
    diagram = build_diagram(robot, reference, systems=[MultibodyFinger(robot)])

An arm knows payload and inertias of a diagnosis, and has an actuator for each joint. A MultibodyFinger stands in the
place of the part `finger`.
"""

from functools import partial

import numpy as np
from numba import njit
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Demultiplexer

from exodrake.core.errors import InputError
from exodrake.machines.export import robot_as
from exodrake.model.robot import Robot
from exodrake.physics.finger_statics import MF_JOINTS, excess, joint_paths, read_parameters
from exodrake.systems.part import Cloneable


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


def multibody_finger(robot: Robot, step: float) -> MultibodyPlant:
    """The finger as three solid cylinders on damped hinges, without gravity; step [s], 0 continuous."""
    plant = MultibodyPlant(step)
    Parser(plant).AddModelsFromString(robot_as(robot, "urdf"), "urdf")
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    for joint in robot.machine.axes.joints:
        hinge = plant.GetJointByName(joint)
        hinge.set_default_positions(np.array([robot[f"finger.q0.{joint}"]]))
        hinge.set_position_limits(np.array([-np.inf]), np.array([np.inf]))  # the tissue's own law stops it
    plant.Finalize()
    return plant


class MultibodyFinger(Cloneable, Diagram):
    """The nominal finger as a MultibodyPlant with elastic tendons.

    .. pydrake_system::

        name: MultibodyFinger
        input_ports: [stroke]
        output_ports: [angle, rate, tension_finger, tension, tension_spool]

    stroke and tensions per tendon [m], [N]; angle and rate per joint [rad], [rad/s]. `plant` is the MultibodyPlant.

    Raises:
        InputError: the robot has no finger, or an effect on it, which the MultibodyPlant does not know.

    Examples:
        >>> import exodrake as exo
        >>> MultibodyFinger(exo.load_robot()).plant.num_positions()
        3
    """

    def __init__(self, robot: Robot, step: float = 0.0) -> None:
        """Takes the robot, and the step of a discrete plant [s]; 0 for a continuous one."""
        super().__init__()
        part = next((part for part in robot.machine.parts if part.name == "finger"), None)
        if part is None:
            raise InputError(f"{robot.machine.name}: no finger that a MultibodyPlant could stand for")
        for effect in robot.machine.effects_on(part):
            lead = effect.parameters[0]
            if (robot.channels(f"{effect.id}.{lead.name}") != lead.null).any():
                raise InputError(f"a MultibodyFinger is nominal: it does not know the effect {effect.id}")
        builder, joints = DiagramBuilder(), len(robot.machine.axes.joints)
        self.plant, tendons = multibody_finger(robot, step), ElasticTendons(robot)
        split = Demultiplexer(output_ports_sizes=[joints, joints])  # angles, then rates
        for name, system in (("plant", self.plant), ("tendons", tendons), ("split", split)):
            builder.AddNamedSystem(name, system)
        builder.Connect(self.plant.get_state_output_port(), tendons.GetInputPort("state"))
        builder.Connect(self.plant.get_state_output_port(), split.get_input_port())
        builder.Connect(tendons.GetOutputPort("torque"), self.plant.get_applied_generalized_force_input_port())
        builder.ExportInput(tendons.GetInputPort("stroke"), "stroke")
        builder.ExportOutput(split.get_output_port(0), "angle")
        builder.ExportOutput(split.get_output_port(1), "rate")
        for name in ("tension_finger", "tension", "tension_spool"):
            builder.ExportOutput(tendons.GetOutputPort("tension"), name)
        builder.BuildInto(self)
        self.set_name("finger")


class ElasticTendons(Cloneable, LeafSystem):
    """Tensions of the tendons, and torques of tendons and passive joints without their damping.

    .. pydrake_system::

        name: ElasticTendons
        input_ports: [state, stroke]
        output_ports: [torque, tension]

    state: angles [rad], then rates [rad/s]; stroke [m]; torque [N m]; tension [N].
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self.parameters = read_parameters(robot)
        self.state = self.DeclareVectorInputPort("state", 6)
        self.stroke = self.DeclareVectorInputPort("stroke", 3)
        for which, name in enumerate(("torque", "tension")):
            self.DeclareVectorOutputPort(name, 3, partial(self.show, which), {self.all_input_ports_ticket()})

    def show(self, which: int, context: Context, output: BasicVector) -> None:
        """Torques on the joints [N m], or tensions [N]."""
        output.set_value(pull_joints(self.state.Eval(context), self.stroke.Eval(context), self.parameters)[which])


@njit
def pull_joints(state, stroke, n):
    """Torques (3,) [N m] and tensions (3,) [N] of nominal tendons and joints.

    state: (6,) angles [rad], then rates [rad/s]; stroke: (3,) [m]; n: `Parameters` of the finger.
    """
    taken = np.zeros(3)
    for i in range(3):
        flexor, extensor = joint_paths(i, state[i], n)
        taken += np.array([flexor[0], flexor[0] if i < MF_JOINTS else 0.0, extensor[0]])
    tension = np.maximum(0.0, np.array(n.k) * (stroke - taken))
    return np.array([excess(i, state[i], tension, n) for i in range(3)]), tension
