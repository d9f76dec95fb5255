"""A finger of Drake's own MultibodyPlant under the same tendons, to stand in the place of the part `finger`.

diagram = build_diagram(robot, reference, systems=[MultibodyFinger(robot)])
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Demultiplexer

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.machines.export import robot_as
from exodrake.physics.finger import end_stop
from exodrake.physics.routers import EXTENSOR, FLEXOR, path

FINGER = "finger"


class MultibodyFinger(Diagram):
    """The nominal finger as a MultibodyPlant with elastic tendons.

    .. pydrake_system::

        name: MultibodyFinger
        input_ports:
        - stroke
        output_ports:
        - angle
        - rate
        - tension_finger
        - tension
        - tension_spool

    stroke and tensions per tendon [m], [N]; angle and rate per joint [rad], [rad/s]. `plant` is the MultibodyPlant.

    Raises:
        InputError: the robot has no finger, or an effect on it, which the MultibodyPlant does not know.
    """

    def __init__(self, robot: Robot, step: float = 0.0) -> None:
        """Takes the robot, and the step of a discrete plant [s]; 0 for a continuous one."""
        super().__init__()
        refuse_effects(robot)
        builder = DiagramBuilder()
        self.plant, tendons = multibody_finger(robot, step), ElasticTendons(robot)
        joints = len(robot.machine.axes.joints)
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
        self.set_name(FINGER)


def refuse_effects(robot: Robot) -> None:
    """InputError if the robot has no finger, or an effect on it."""
    part = next((part for part in robot.machine.parts if part.name == FINGER), None)
    if part is None:
        raise InputError(f"{robot.machine.name}: no finger that a MultibodyPlant could stand for")
    for effect in robot.machine.effects_on(part):
        lead = effect.parameters[0]
        if (robot.channels(f"{effect.id}.{lead.name}") != lead.null).any():
            raise InputError(f"a MultibodyFinger is nominal: it does not know the effect {effect.id}")


class ElasticTendons(LeafSystem):
    """Tensions of the tendons, and torques of tendons and passive joints without their damping.

    .. pydrake_system::

        name: ElasticTendons
        input_ports:
        - state
        - stroke
        output_ports:
        - torque
        - tension

    state: angles [rad], then rates [rad/s]; stroke [m]; torque [N m]; tension [N].
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self.law = tendon_law(robot)
        self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorInputPort("stroke", 3)
        for name, method in (("torque", self._torque), ("tension", self._tension)):
            self.DeclareVectorOutputPort(name, 3, method, {self.all_input_ports_ticket()})

    def _torque(self, context: Context, out: BasicVector) -> None:
        """Fills the port of torques."""
        out.set_value(self._both(context)[0])

    def _tension(self, context: Context, out: BasicVector) -> None:
        """Fills the port of tensions."""
        out.set_value(self._both(context)[1])

    def _both(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Torques (3,) [N m] and tensions (3,) [N]."""
        state, stroke = self.EvalVectorInput(context, 0).value(), self.EvalVectorInput(context, 1).value()
        torque, tension = np.zeros(3), np.zeros(3)
        self.law(np.array(state), np.array(stroke), torque, tension)
        return torque, tension


def tendon_law(robot: Robot) -> Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]:
    """A compiled function of the nominal tendons and joints, which fills its last two arguments.

    They are state (6,), angles [rad], then rates [rad/s]; stroke (3,) [m]; torque (3,) [N m]; tension (3,) [N].
    """
    from numba import njit

    flexor = np.array([robot.channels(f"router.{name}") for name in ("a_f", "b_f", "m_f", "n_f")])
    extensor = np.array([robot.channels(f"router.{name}") for name in ("a_e", "b_e", "m_e", "n_e")])
    stiffness, kappa, q0 = robot.channels("tendon.k"), robot.channels("finger.kappa"), robot.channels("finger.q0")
    q_f, q_e, beta, a = (robot.channels(f"finger.{name}") for name in ("q_f", "q_e", "beta", "A"))
    tendon_path, stop = njit(path), njit(end_stop)

    @njit
    def law(state, stroke, torque, tension):
        arms, taken = np.zeros((3, 3)), np.zeros(3)
        for i in range(3):
            c, s = math.cos(state[i]), math.sin(state[i])
            f = tendon_path(c, s, flexor[0, i], flexor[1, i], flexor[2, i], flexor[3, i], FLEXOR)
            x = tendon_path(c, s, extensor[0, i], extensor[1, i], extensor[2, i], extensor[3, i], EXTENSOR)
            taken[0] += f[0]
            taken[1] += f[0] if i == 0 else 0.0
            taken[2] += x[0]
            arms[0, i], arms[1, i], arms[2, i] = f[1], f[1] if i == 0 else 0.0, x[1]
        for j in range(3):
            tension[j] = max(0.0, stiffness[j] * (stroke[j] - taken[j]))
        for i in range(3):
            torque[i] = -kappa[i] * (state[i] - q0[i]) - stop(state[i], q_f[i], q_e[i], beta[i], a[i])
            for j in range(3):
                torque[i] += arms[j, i] * tension[j]

    return law


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
