"""The parts of the Exo-Index robot as Drake systems, each constructible on its own: `MotorDynamics(load_robot())`.

Parameters are those of the robot, in SI and in the table's order, as numeric parameter 0 of the Context, found by name:
`motor.parameter("motor.r.AF").set(context, 0.008)`. Port `memory` is for other parts (see `binding`). The plant ticks
every slot (2 ms); sampled tasks run once a frame (20 ms) in the middle of their slot.
"""

from __future__ import annotations

from collections.abc import Mapping

from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.diagrams.leaf import Leaf
from exodrake.diagrams.leaf_spec import InputSpec
from exodrake.diagrams.part_spec import part_spec
from exodrake.machines.robot_file import robot_or_default


class Part(Leaf):
    """A part of a robot as a Drake system; the nominal robot if none is given.

    substeps: plant ticks a slot. inputs: the input ports; None: one for each signal read.
    """

    part = ""

    def __init__(
        self, robot: Robot | None = None, substeps: int = 1, inputs: Mapping[str, InputSpec] | None = None
    ) -> None:
        robot = robot_or_default(robot)
        parts = {part.name: part for part in robot.machine.parts}
        if self.part not in parts:
            raise InputError(f"{robot.machine.name} has no part {self.part!r}{nearest(self.part, list(parts))}")
        super().__init__(part_spec(robot.machine, parts[self.part], robot.values, substeps, inputs))


class TendonFinger(Part):
    """Three elastic wires on a planar finger (`physics.tendon_finger`); ticks with the plant.

    .. pydrake_system::

        name: TendonFinger
        input_ports:
        - stroke
        - wire_speed
        output_ports:
        - angle
        - rate
        - tension_finger
        - tension
        - tension_spool
        - tension+tension_spool
        - start_stroke
        - memory

    start_stroke [m], from the parameters alone, is where the tendons are just taut in q0. tension and tension_spool [N]
    answer stroke [m] at once; the other outputs are state.
    """

    part = "finger"


class MotorDynamics(Part):
    """Rotors behind gears with current-limited speed loops (`physics.motor`); ticks with the plant.

    .. pydrake_system::

        name: MotorDynamics
        input_ports:
        - speed_applied
        - tension_spool
        - start_stroke
        output_ports:
        - stroke
        - wire_speed
        - spool_angle
        - memory
    """

    part = "motor"


class TensionSensor(Part):
    """Load cells (`physics.sensor`), whose amplifiers tick with the plant and which the bus reads in slots 1, 2, 3.

    .. pydrake_system::

        name: TensionSensor
        input_ports:
        - tension
        - wire_speed
        - noise_tension
        output_ports:
        - tension_read
        - cell
        - memory

    cell [N], the amplified tension, answers tension [N] at once; tension_read is state.
    """

    part = "sensor"


class Encoder(Part):
    """Encoders on the gears (`physics.encoder`), read over the bus in slots 1, 2, 3.

    .. pydrake_system::

        name: Encoder
        input_ports:
        - spool_angle
        - start_stroke
        output_ports:
        - stroke_read
        - memory
    """

    part = "encoder"


class MotionCapture(Part):
    """Joint angles with noise (`physics.mocap`), in slot 0.

    .. pydrake_system::

        name: MotionCapture
        input_ports:
        - angle
        - noise_angle
        output_ports:
        - angle_read
        - mocap_delay
        - memory
    """

    part = "mocap"


class AdmittanceController(Part):
    """PD admittance from tension error to wire speed (`physics.controller`), in slot 4.

    .. pydrake_system::

        name: AdmittanceController
        input_ports:
        - tension_ref
        - tension_read
        output_ports:
        - speed_cmd
        - memory
    """

    part = "controller"


class MotorBus(Part):
    """Hands each command to its drive (`physics.bus`), in slots 5, 6, 7.

    .. pydrake_system::

        name: MotorBus
        input_ports:
        - speed_cmd
        - packet_arrival
        output_ports:
        - speed_applied
        - memory
    """

    part = "bus"


NAMED = {
    cls.part: cls
    for cls in (TendonFinger, MotorDynamics, TensionSensor, Encoder, MotionCapture, AdmittanceController, MotorBus)
}


def part_class(machine: Machine, name: str) -> type[Part]:
    """The class of a part: the one that bears its name, else one made for it."""
    return NAMED.get(name) or type(f"{machine.name}_{name}", (Part,), {"part": name})
