"""For the bench: how fast the Diagram runs, and a finger of Drake's own MultibodyPlant under the same tendons."""

from __future__ import annotations

import math
from time import thread_time

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource, VectorLogSink
from pydrake.trajectories import PiecewisePolynomial

from exodrake.diagrams.diagram import build_diagram
from exodrake.diagrams.multibody import ElasticTendons, multibody_finger
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot
from exodrake.simulation.simulate import record


def speed(simulator: Simulator, seconds: float, pieces: int) -> float:
    """Simulated seconds per second of this thread: the best of some pieces of a run, after a short start."""
    simulator.AdvanceTo(0.1)
    best, at = math.inf, 0.1
    for _ in range(pieces):
        start = thread_time()
        at += seconds / pieces
        simulator.AdvanceTo(at)
        best = min(best, thread_time() - start)
    return seconds / pieces / best


def diagram_speed(robot: Robot, reference: Reference, seconds: float, pieces: int = 5) -> float:
    """Simulated seconds per second on one core of the closed loop, its log included."""
    return speed(Simulator(build_diagram(robot, reference, seed=1)), seconds, pieces)


def multibody_speed(
    robot: Robot, reference: Reference, step: float, seconds: float, pieces: int = 5
) -> tuple[float, float]:
    """Speed of a MultibodyPlant finger alone, pulled by a Python leaf with our own run's strokes; no motor, no sensors.

    A step of 0 is a continuous plant, with Drake's default error control. With the RMS difference of its angles [rad].
    """
    machine, builder = robot.machine, DiagramBuilder()
    run = record(robot, reference, seed=None, quantisation=False).signals
    breaks = machine.frame * np.arange(1, len(run["stroke"]) + 1)
    held = PiecewisePolynomial.FirstOrderHold(breaks, run["stroke"].T)  # pyright: ignore
    plant, tendons = multibody_finger(robot, step), ElasticTendons(robot)
    stroke, sink = TrajectorySource(held), VectorLogSink(6, machine.frame)
    for system in (plant, tendons, stroke, sink):
        builder.AddSystem(system)
    builder.Connect(plant.get_state_output_port(), tendons.GetInputPort("state"))
    builder.Connect(plant.get_state_output_port(), sink.get_input_port())
    builder.Connect(stroke.get_output_port(), tendons.GetInputPort("stroke"))
    builder.Connect(tendons.GetOutputPort("torque"), plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    fast = speed(simulator, seconds, pieces)
    angle = sink.FindLog(simulator.get_context()).data()[:3, 1:].T
    shared = min(len(angle), len(run["angle"]))
    apart = angle[:shared] - run["angle"][:shared]
    return fast, float(np.sqrt((apart**2).mean()))
