"""EMPS, an electro-mechanical positioning system: drive -> carriage -> scale, a position loop at 1 kHz."""

from functools import cache

import numpy as np

from exodrake.effects import collect_effects
from exodrake.model.machine import Column, Controller, Gain, Loop, Machine, Segment
from exodrake.model.mechanism import Body, Chain, Drive, Joint, Mechanism, axes_side_by_side
from exodrake.model.part import JOINTS, NORMAL, UNIFORM, Axes, Signal
from exodrake.model.robot import Robot
from exodrake.physics import carriage, position_drive
from exodrake.physics.reading import sensor

FRAME = 1e-3  # s
POSITION = ("position", "noise_position", "reading_arrival", "position_read")
SCALE = sensor("scale", POSITION, unit="m", slot=1, frame=FRAME, size=0.1, channels=1)
PARTS = (carriage.PART, SCALE, position_drive.PART)
INPUTS = (
    Signal("position_ref", "m", JOINTS), Signal("position_start", "m", JOINTS), Signal("speed_start", "m/s", JOINTS),
    Signal("noise_position", "-", JOINTS, NORMAL), Signal("reading_arrival", "-", JOINTS, UNIFORM),
)  # fmt: skip
COMPUTED = (Signal("force", "N", JOINTS), Signal("position", "m", JOINTS), Signal("position_read", "m", JOINTS))
SHOWN = {"position": "position_read", "force": "force"}
COLUMNS = tuple(Column(kind, signal) for kind, signal in ({s.name: s.name for s in INPUTS[:3]} | SHOWN).items())

STEP = 1e-6  # m, assumed for limit cycles: the coarsest that the range of scale.step allows
GAINS = (Gain("drive.kp", 10.0, 400.0), Gain("drive.kv", 25.0, 1000.0))  # 1/s, V s/m: about the published ones
LOOP = Loop(
    reference="position_ref", command="force", output="position", measured="position_read", part="drive", held="force",
    gains=GAINS, gentle={"drive.kp": 20.0, "drive.kv": 100.0}, step=1e-3, points={"middle": {"carriage": 0.0}},
    controllers=(Controller("cascade", GAINS),), resolution="scale.step",
    nonlinear={"scale.quantisation": {"step": STEP}, "carriage.coulomb_friction": {}},
)  # fmt: skip


def mechanism(robot: Robot) -> Mechanism:
    """The carriage under its cascade, as a position loop: kp kv and kv, both times the amplifier's gain."""
    kv = robot["drive.gain"] * robot["drive.kv"]
    axis = Joint(
        "carriage", "prismatic", "", "carriage", np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0]),
        damping=robot["carriage.viscous_friction.coefficient"], friction=robot["carriage.coulomb_friction.force"],
    )  # fmt: skip
    body = Body(robot["carriage.M"], np.zeros(3), robot["carriage.M"] * 0.01 * np.eye(3))
    return Mechanism(
        Chain(("carriage",), (axis,), (body,), np.zeros(3)), (Drive(robot["drive.kp"] * kv, kv),), 1e-4,
        frozenset(("carriage.viscous_friction", "carriage.coulomb_friction")),
        notes=("the drive computes once in 1 ms, with the difference of places over two frames as the speed",
               "the inertia of the carriage about its centre is assumed; it does not turn"),
    )  # fmt: skip


@cache
def machine() -> Machine:
    """The frictionless inertia under its drive, with every effect of its library at its null value."""
    return Machine(
        name="emps", axes=Axes((), ("carriage",)), signals=(*INPUTS, *COMPUTED), parts=PARTS,
        inputs=tuple(s.name for s in INPUTS), columns=COLUMNS, effects=collect_effects(PARTS), frame=FRAME,
        slots=16,  # so short that from reading to force takes the drive next to no time
        noise=("scale.sigma.carriage",), resolution=("scale.step.carriage",), compared=("position", "force"),
        noise_std=lambda value: {"position": value("scale.repeatability"), "force": value("drive.repeatability")},
        segments=(Segment("drive", "force", ("position",)), Segment("carriage", "position", ("force",))),
        max_effects=4, reference_limits=("position_min", "position_max"),
        skeleton=lambda robot: axes_side_by_side(robot.machine.axes.joints, "position", "force", "x", sliding=True),
        mechanism=mechanism, loop=LOOP,
    )  # fmt: skip
