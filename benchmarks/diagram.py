"""For the bench: how fast the Diagram runs, and a finger of Drake's own MultibodyPlant under the same wires."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import TrajectorySource, VectorLogSink
from pydrake.trajectories import PiecewisePolynomial

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.diagrams.diagram import build_diagram
from exodrake.simulation.simulate import record
from exodrake.systems.finger import end_stop
from exodrake.systems.routers import EXTENSOR, FLEXOR, path


def speed(simulator: Simulator, seconds: float, pieces: int) -> float:
    """Simulated seconds per wall second: the best of some pieces of a run, after a short start."""
    simulator.AdvanceTo(0.1)
    best, at = math.inf, 0.1
    for _ in range(pieces):
        start = perf_counter()
        at += seconds / pieces
        simulator.AdvanceTo(at)
        best = min(best, perf_counter() - start)
    return seconds / pieces / best


def diagram_speed(robot: Robot, reference: Reference, seconds: float, pieces: int = 5) -> float:
    """Simulated seconds per wall second of the closed loop, its log included."""
    return speed(Simulator(build_diagram(robot, reference, seed=1)), seconds, pieces)


class WireTorques(LeafSystem):
    """Torques of elastic wires and passive joints on a MultibodyPlant finger.

    .. pydrake_system::

        name: WireTorques
        input_ports:
        - state
        - stroke
        output_ports:
        - torque

    state: angles [rad], then rates [rad/s]; stroke [m]; torque [N m], all without the joints' damping.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self.law = torque_law(robot)
        self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorInputPort("stroke", 3)
        self.DeclareVectorOutputPort("torque", 3, self.calculate)

    def calculate(self, context: Context, out: BasicVector) -> None:
        """Fills the output port."""
        state, stroke = self.EvalVectorInput(context, 0).value(), self.EvalVectorInput(context, 1).value()
        self.law(state, stroke, out.get_mutable_value())


def torque_law(robot: Robot) -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
    """A compiled function (state, stroke, torque to fill) of the nominal wires and joints."""
    from numba import njit

    flexor = np.array([robot.channels(f"router.{name}") for name in ("a_f", "b_f", "m_f", "n_f")])
    extensor = np.array([robot.channels(f"router.{name}") for name in ("a_e", "b_e", "m_e", "n_e")])
    stiffness, kappa, q0 = robot.channels("tendon.k"), robot.channels("finger.kappa"), robot.channels("finger.q0")
    q_f, q_e, beta, a = (
        robot.channels("finger.q_f"),
        robot.channels("finger.q_e"),
        robot["finger.beta"],
        robot["finger.A"],
    )
    axis, stop = njit(path), njit(end_stop)

    @njit
    def law(state, stroke, torque):
        arms, taken = np.zeros((3, 3)), np.zeros(3)
        for i in range(3):
            c, s = math.cos(state[i]), math.sin(state[i])
            f = axis(c, s, flexor[0, i], flexor[1, i], flexor[2, i], flexor[3, i], FLEXOR)
            x = axis(c, s, extensor[0, i], extensor[1, i], extensor[2, i], extensor[3, i], EXTENSOR)
            taken[0] += f[0]
            taken[1] += f[0] if i == 0 else 0.0
            taken[2] += x[0]
            arms[0, i], arms[1, i], arms[2, i] = f[1], f[1] if i == 0 else 0.0, x[1]
        for i in range(3):
            torque[i] = -kappa[i] * (state[i] - q0[i]) - stop(state[i], q_f[i], q_e[i], beta, a)
            for j in range(3):
                torque[i] += arms[j, i] * max(0.0, stiffness[j] * (stroke[j] - taken[j]))

    return law


def multibody_finger(robot: Robot, step: float) -> MultibodyPlant:
    """The finger as three solid cylinders on damped hinges, without gravity; step [s], 0 continuous."""
    plant = MultibodyPlant(step)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    along, about = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    parent, offset = plant.world_frame(), 0.0
    for i, joint in enumerate(robot.machine.axes.joints):
        length, mass = robot[f"finger.length.{joint}"], robot[f"finger.mass.{joint}"]
        centred = SpatialInertia.SolidCylinderWithMass(mass, robot[f"finger.radius.{joint}"], length, along)
        body = plant.AddRigidBody(joint, centred.Shift(-0.5 * length * along))
        hinge = plant.AddFrame(FixedOffsetFrame(f"hinge_{joint}", parent, RigidTransform(offset * along)))
        damping = robot[f"finger.B.{joint}"]
        hinged = RevoluteJoint(f"joint_{i}", hinge, body.body_frame(), about, damping)
        hinged.set_default_angle(robot[f"finger.q0.{joint}"])
        plant.AddJoint(hinged)
        parent, offset = body.body_frame(), length
    plant.Finalize()
    return plant


def multibody_speed(
    robot: Robot, reference: Reference, step: float, seconds: float, pieces: int = 5
) -> tuple[float, float]:
    """Speed of a MultibodyPlant finger alone, pulled by a Python leaf with our own run's strokes; no motor, no sensors.

    Args:
        step: of the discrete plant [s]; 0 for a continuous one, integrated with Drake's default error control.

    Returns: simulated seconds per wall second; and the RMS difference of its angles from ours [rad].
    """
    machine, builder = robot.machine, DiagramBuilder()
    run = record(robot, reference, seed=None, quantisation=False).signals
    breaks = machine.frame * np.arange(1, len(run["stroke"]) + 1)
    held = PiecewisePolynomial.FirstOrderHold(breaks, run["stroke"].T)  # pyright: ignore
    plant, wires = multibody_finger(robot, step), WireTorques(robot)
    stroke, sink = TrajectorySource(held), VectorLogSink(6, machine.frame)
    for system in (plant, wires, stroke, sink):
        builder.AddSystem(system)
    builder.Connect(plant.get_state_output_port(), wires.GetInputPort("state"))
    builder.Connect(plant.get_state_output_port(), sink.get_input_port())
    builder.Connect(stroke.get_output_port(), wires.GetInputPort("stroke"))
    builder.Connect(wires.get_output_port(), plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    fast = speed(simulator, seconds, pieces)
    angle = sink.FindLog(simulator.get_context()).data()[:3, 1:].T
    shared = min(len(angle), len(run["angle"]))
    apart = angle[:shared] - run["angle"][:shared]
    return fast, float(np.sqrt((apart**2).mean()))
