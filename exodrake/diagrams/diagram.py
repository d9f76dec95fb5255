"""The closed loop as a Drake Diagram: the table and the schedule of the compiled simulator, and to the last bit its
numbers.

    diagram = build_diagram(load_robot(), Reference(tension), seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(60.0)
    rows = logged(robot.machine, diagram, simulator.get_context())         # (frames, wires of the table side by side)

Every wire is an exported output port, `motor.stroke`. Without a reference the wires given from outside are input ports.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Demultiplexer, Multiplexer, TrajectorySource, VectorLogSink
from pydrake.trajectories import PiecewisePolynomial

from exodrake.compiled.fused import GROUP, plant_machine, state_size
from exodrake.compiled.inputs import NoiseInputs, Reference, input_rows, prepared
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.diagrams.gp_estimator import GPEstimator
from exodrake.diagrams.leaf import Leaf
from exodrake.diagrams.leaf_specs import fusible, part_spec, plant_spec
from exodrake.diagrams.parts import part_class
from exodrake.systems.gp_estimator import Weights

OUTSIDE = "outside"
LOG, FINE_LOG = "log", "fine_log"


def build_diagram(
    robot: Robot,
    reference: Reference | None = None,
    seed: int | None = 0,
    quantisation: bool = True,
    substeps: int = 1,
    fused: bool = False,
    fine_log: bool = False,
    estimator: Weights | None = None,
) -> Diagram:
    """The closed loop of a robot.

    Args:
        reference: what it shall follow; None leaves the wires from outside (tension_ref, noise...) as input ports.
        seed: of the noise; None runs without. quantisation: whether readings are rounded.
        substeps: plant ticks per 2 ms slot.
        fused: all parts in front of the bus as one leaf, for speed; else a leaf for each part.
        fine_log: also log all wires every slot (2 ms).
        estimator: weights of an estimator that listens (ports `estimator.angle_est`, `.angle_std`; not logged).
    """
    robot, given = replace(robot, values=prepared(robot, quantisation)), None
    if reference is not None:
        noise_inputs = NoiseInputs.draw(len(reference.tension), seed, robot.machine)
        given = input_rows(robot.machine, reference.tension, noise_inputs)
    return assemble(robot, given, substeps, fused, fine_log, estimator)


def run_diagram(
    robot: Robot, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int, fused: bool = True
) -> np.ndarray:
    """All signals (frames, signals) [SI] at the end of each frame, equal to the compiled simulator to the last bit."""
    machine = robot.machine
    given = input_rows(machine, reference.tension, noise_inputs)
    fused = fused and plant_machine(machine) is not None
    diagram = assemble(replace(robot, values=values), given, substeps, fused, fine_log=False)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(machine.frame * len(reference.tension))
    return logged(machine, diagram, simulator.get_context())


def assemble(
    robot: Robot,
    given: dict[str, np.ndarray] | None,
    substeps: int,
    fused: bool,
    fine_log: bool,
    estimator: Weights | None = None,
) -> Diagram:
    """Build the Diagram; `given`: rows (frames, channels) [SI] of outside signals, or None to export input ports."""
    machine, builder = robot.machine, DiagramBuilder()
    outputs: dict[str, OutputPort] = {}
    inputs: list[tuple[str, InputPort]] = []
    for leaf in leaves(robot, substeps, fused):
        builder.AddNamedSystem(leaf.plan.name, leaf)
        inputs += [(wire, leaf.GetInputPort(wire)) for wire in leaf.plan.inputs]
        outputs |= output_ports(machine, builder, leaf)
    if given is not None:
        outputs |= {name: source(machine, builder, name, rows) for name, rows in given.items()}
    join_signals(builder, outputs, inputs)
    writer = {wire: part.name for part in machine.parts for output in part.outputs for wire in output.writes}
    for wire in (wire.name for wire in machine.signals if wire.name in outputs):
        builder.ExportOutput(outputs[wire], f"{writer.get(wire, OUTSIDE)}.{wire}")
    add_logs(machine, builder, outputs, fused, fine_log)
    if estimator is not None:
        add_estimator(machine, builder, outputs, estimator)
    diagram = builder.Build()
    diagram.set_name(machine.name)
    return diagram


def add_estimator(
    machine: Machine, builder: DiagramBuilder, outputs: dict[str, OutputPort], estimator: Weights
) -> None:
    """An estimator that listens to the readings, with its outputs exported."""
    leaf = GPEstimator(estimator, machine)
    builder.AddNamedSystem(leaf.plan.name, leaf)
    join_signals(builder, outputs, [(wire, leaf.GetInputPort(wire)) for wire in leaf.plan.inputs])
    for wire in leaf.plan.held:
        builder.ExportOutput(leaf.GetOutputPort(wire), f"{leaf.plan.name}.{wire}")


def leaves(robot: Robot, substeps: int, fused: bool) -> list[Leaf]:
    """The leaves of a robot, in the table's order."""
    parts = robot.machine.parts
    first = [Leaf(plant_spec(robot.machine, robot.values, substeps))] if fused else []
    rest = parts[len(fusible(robot.machine).parts) :] if fused else parts
    return [*first, *(part_class(robot.machine, part.name)(robot, substeps) for part in rest)]


def output_ports(machine: Machine, builder: DiagramBuilder, leaf: Leaf) -> dict[str, OutputPort]:
    """The ports of the wires that a leaf writes; the fused plant's come out of a demultiplexer, beside its memory."""
    if leaf.plan.name != GROUP:
        return {port.get_name(): port for port in (leaf.get_output_port(i) for i in range(leaf.num_output_ports()))}
    plant, memory = fusible(machine), leaf.get_output_port()
    split = Demultiplexer([state_size(plant), *(machine.width(wire.axis) for wire in plant.signals)])
    builder.AddNamedSystem(f"{GROUP}_wires", split)
    builder.Connect(memory, split.get_input_port())
    return {GROUP: memory, **{wire.name: split.get_output_port(1 + i) for i, wire in enumerate(plant.signals)}}


def join_signals(builder: DiagramBuilder, outputs: dict[str, OutputPort], inputs: list[tuple[str, InputPort]]) -> None:
    """Connects each input to the wire of its name; a wire that nothing writes becomes an input port of the Diagram."""
    exported = set()
    for wire, port in inputs:
        if wire in outputs:
            builder.Connect(outputs[wire], port)
        elif wire in exported:
            builder.ConnectInput(wire, port)
        else:
            builder.ExportInput(port, wire)
            exported.add(wire)


def source(machine: Machine, builder: DiagramBuilder, name: str, rows: np.ndarray) -> OutputPort:
    """Hold rows (frames, channels) [SI] for a frame each, a quarter slot late so that a frame ends with its own row."""
    breaks = machine.frame * np.arange(len(rows) + 1) + 0.25 * machine.slot
    held = PiecewisePolynomial.ZeroOrderHold(breaks, np.vstack([rows, rows[-1:]]).T)  # pyright: ignore
    return builder.AddNamedSystem(name, TrajectorySource(held)).get_output_port()


def logged_ports(machine: Machine, fused: bool) -> list[tuple[str, list[tuple[str, int]]]]:
    """What a log shows, in order: (wire, or the fused plant's memory; the wires in it with their widths)."""
    width = {wire.name: machine.width(wire.axis) for wire in machine.signals}
    plant = fusible(machine) if fused else None
    inside = [wire.name for wire in plant.signals] if plant else []
    ports = [(name, [(name, width[name])]) for name in width if name not in inside]
    if plant:  # straight from the memory: fewer ports that hear of each tick
        ports.append((GROUP, [("", state_size(plant)), *((name, width[name]) for name in inside)]))
    return ports


def add_logs(
    machine: Machine, builder: DiagramBuilder, outputs: dict[str, OutputPort], fused: bool, fine_log: bool
) -> None:
    """Logs of all wires at the end of each frame (or slot), where nothing else happens."""
    ports = [(outputs[name], parts) for name, parts in logged_ports(machine, fused) if name in outputs]
    join = builder.AddNamedSystem("wires", Multiplexer([port.size() for port, _ in ports]))
    for i, (port, _) in enumerate(ports):
        builder.Connect(port, join.get_input_port(i))
    for name, period in [(LOG, machine.frame), (FINE_LOG, machine.slot)] if fine_log else [(LOG, machine.frame)]:
        sink = builder.AddNamedSystem(name, VectorLogSink(join.get_output_port().size(), period))
        builder.Connect(join.get_output_port(), sink.get_input_port())


def logged(machine: Machine, diagram: Diagram, context: Context, log: str = LOG) -> np.ndarray:
    """Rows (frames, signals) [SI] of a log, one per completed frame; `FINE_LOG`: one per slot.

    Wires from outside are left out if the Diagram was built without a reference.
    """
    sink = diagram.GetSubsystemByName(log)
    assert isinstance(sink, VectorLogSink)
    data, at, found = sink.FindLog(context).data(), 0, {}
    for _, parts in logged_ports(machine, diagram.HasSubsystemNamed(GROUP)):
        for name, width in parts:
            if name in machine.inputs and not diagram.HasSubsystemNamed(name):
                continue
            found[name], at = data[at : at + width, 1:], at + width
    return np.ascontiguousarray(np.vstack([found[wire.name] for wire in machine.signals if wire.name in found]).T)


def set_parameters(robot: Robot, diagram: Diagram, context: Context) -> None:
    """Puts a robot's numbers into a Context of its machine's Diagram and starts anew: one Diagram serves many runs."""
    parts = {part.name: part for part in robot.machine.parts}
    for leaf in diagram.GetSystems():
        if isinstance(leaf, Leaf) and (leaf.plan.name == GROUP or leaf.plan.name in parts):
            fused = leaf.plan.name == GROUP
            machine, values = robot.machine, robot.values
            plan = plant_spec(machine, values) if fused else part_spec(machine, parts[leaf.plan.name], values)
            leaf.set_part(leaf.GetMyMutableContextFromRoot(context), plan)
