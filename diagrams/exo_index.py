"""The Exo-Index in a DiagramBuilder of one's own: seven systems and the signals between them.

builder = DiagramBuilder()
exo_index = add_exo_index(builder, robot)
planner = builder.AddSystem(ConstantVectorSource([5.0, 3.0, 1.0]))
builder.Connect(planner.get_output_port(), exo_index.controller.GetInputPort("tension_ref"))
LogVectorOutput(exo_index.finger.GetOutputPort("angle"), builder, 0.02)
"""

from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, System

from exodrake.core.errors import InputError, nearest
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.robot import Robot
from exodrake.systems.admittance_controller import AdmittanceController
from exodrake.systems.bus import Bus
from exodrake.systems.encoder import Encoder
from exodrake.systems.motion_capture import MotionCapture
from exodrake.systems.motor import MotorDynamics
from exodrake.systems.tendon_finger import TendonFinger
from exodrake.systems.tension_sensor import TensionSensor


class ExoIndex(NamedTuple):
    """The systems of an Exo-Index in a Diagram."""

    finger: System
    motor: System
    sensor: System
    encoder: System
    mocap: System
    controller: System
    bus: System


def add_exo_index(builder: DiagramBuilder, robot: Robot | None = None, substeps: int = 1, **own: System) -> ExoIndex:
    """Adds the parts of the Exo-Index to a Diagram and joins them; tension_ref of the controller is left to the caller.

    Noise ports are left unconnected, too, which is a robot without noise; `Noise` is a source for them.

    Args:
        builder: of the Diagram.
        robot: the robot; None: the nominal one.
        substeps: plant ticks per slot.
        own: systems that stand in the place of parts, by the name of the part: `controller=Proportional()`.

    Returns:
        The systems.

    Raises:
        InputError: a system in a part's place does not show what the part shows, or there is no such part.

    Examples:
        >>> add_exo_index(DiagramBuilder()).motor.GetOutputPort("stroke").size()
        3
    """
    robot = robot_or_default(robot)
    parts = {
        "finger": own.get("finger") or TendonFinger(robot, substeps),
        "motor": own.get("motor") or MotorDynamics(robot, substeps),
        "sensor": own.get("sensor") or TensionSensor(robot, substeps),
        "encoder": own.get("encoder") or Encoder(robot),
        "mocap": own.get("mocap") or MotionCapture(robot),
        "controller": own.get("controller") or AdmittanceController(robot),
        "bus": own.get("bus") or Bus(robot),
    }
    for name in own.keys() - parts.keys():
        raise InputError(f"{robot.machine.name} has no part {name!r}{nearest(name, list(parts))}")
    finger, motor, sensor, encoder, mocap, controller, bus = added = ExoIndex(
        *(builder.AddNamedSystem(name, system) for name, system in parts.items())
    )

    def connect(signal: str, writer: System, *readers: System) -> None:
        """Connects the output port `signal` to the input ports of that name; a system of one's own may read less."""
        if not writer.HasOutputPort(signal) and signal != "start_stroke":
            raise InputError(f"the system in place of {writer.get_name()} has no output port {signal!r}")
        for reader in (reader for reader in readers if writer.HasOutputPort(signal) and reader.HasInputPort(signal)):
            builder.Connect(writer.GetOutputPort(signal), reader.GetInputPort(signal))

    connect("stroke", motor, finger)  # the spools wind the tendons in,
    connect("wire_speed", motor, finger, sensor)
    connect("tension_spool", finger, motor)  # which pull back
    connect("start_stroke", finger, motor, encoder)  # the tendons are just taut at the start
    connect("tension", finger, sensor)  # load cells, encoders and motion capture
    connect("spool_angle", motor, encoder)
    connect("angle", finger, mocap)
    connect("tension_read", sensor, controller)  # the tension controller
    connect("speed_cmd", controller, bus)
    connect("speed_applied", bus, motor)
    return added
