"""The closed loop as a Drake Diagram, from the same table and schedule as the compiled twin, and to the last bit the same numbers.

    diagram = build_diagram(load_robot(), Reference(tension), seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(60.0)
    rows = logged(diagram, simulator.get_context())            # (frames, wires of the machine side by side)

Every wire is an exported output port, `motor.stroke`. Without a reference the wires given from outside are exported input ports.
"""

from __future__ import annotations

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Demultiplexer, Multiplexer, TrajectorySource, VectorLogSink, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

from exodrake.diagrams.drake_plans import fusible, held_at_start, numbers_of, part_plan, plant_plan, start_state, state_of
from exodrake.diagrams.fused import GROUP
from exodrake.diagrams.machine import Machine
from exodrake.diagrams.robot import Robot
from exodrake.diagrams.simulate import Chance, Reference, prepared
from exodrake.systems.leaf import Leaf

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
) -> Diagram:
    """The closed loop of a robot.

    Args:
        reference: what it shall follow; None leaves the wires from outside (tension_ref, noise...) as input ports.
        seed: of the noise; None runs without. quantisation: whether readings are rounded. substeps: plant ticks per 2 ms slot.
        fused: all parts in front of the bus as one leaf, for speed; else a leaf for each part.
        fine_log: also log all wires every slot (2 ms).
    """
    given = None
    if reference is not None:
        chance = Chance.draw(len(reference.tension), seed, robot.machine)
        given = given_rows(robot.machine, reference, chance)
    return assemble(robot.machine, prepared(robot, quantisation), given, substeps, fused, fine_log)


def run_diagram(
    robot: Robot, values: np.ndarray, reference: Reference, chance: Chance, substeps: int, fused: bool = True
) -> np.ndarray:
    """All wires (frames, wires) at each frame's end; to the last bit those of the compiled twin."""
    machine = robot.machine
    diagram = assemble(machine, values, given_rows(machine, reference, chance), substeps, fused, False)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(machine.frame * len(reference.tension))
    return logged(diagram, simulator.get_context())


def given_rows(machine: Machine, reference: Reference, chance: Chance) -> dict[str, np.ndarray]:
    """The wires that come from outside, (frames, lanes) each."""
    return dict(zip(machine.given, (reference.tension, chance.tension, chance.angle, chance.lottery), strict=True))


def assemble(
    machine: Machine, values: np.ndarray, given: dict[str, np.ndarray] | None, substeps: int, fused: bool, fine_log: bool
) -> Diagram:
    """The Diagram of a machine with these numbers [SI]."""
    builder = DiagramBuilder()
    outputs: dict[str, OutputPort] = {}
    inputs: list[tuple[str, InputPort]] = []
    for leaf in leaves(machine, values, substeps, fused):
        builder.AddNamedSystem(leaf.plan.name, leaf)
        inputs += [(wire, leaf.GetInputPort(wire)) for wire in leaf.plan.inputs]
        outputs |= output_ports(machine, builder, leaf)
    if given is not None:
        outputs |= {name: source(machine, builder, name, rows) for name, rows in given.items()}
    for wire, port in inputs:
        if wire in outputs:
            builder.Connect(outputs[wire], port)
        else:
            builder.ConnectInput(wire, port) if builder.IsInputExported(wire) else builder.ExportInput(port, wire)
    writer = {wire: block.name for block in machine.blocks for output in block.outputs for wire in output.writes}
    for wire, port in outputs.items():
        builder.ExportOutput(port, f"{writer.get(wire, OUTSIDE)}.{wire}")
    add_logs(machine, builder, outputs, fine_log)
    diagram = builder.Build()
    diagram.set_name(machine.name)
    return diagram


def leaves(machine: Machine, values: np.ndarray, substeps: int, fused: bool) -> list[Leaf]:
    """The leaves of a machine, in the table's order."""
    if not fused:
        return [Leaf(part_plan(machine, block, values, substeps)) for block in machine.blocks]
    rest = machine.blocks[len(fusible(machine).blocks) :]
    return [Leaf(plant_plan(machine, values, substeps)), *(Leaf(part_plan(machine, b, values, substeps)) for b in rest)]


def output_ports(machine: Machine, builder: DiagramBuilder, leaf: Leaf) -> dict[str, OutputPort]:
    """The ports of the wires that a leaf writes; those of the fused plant come out of a demultiplexer."""
    if leaf.plan.name != GROUP:
        return {port.get_name(): port for port in (leaf.get_output_port(i) for i in range(leaf.num_output_ports()))}
    wires = fusible(machine).wires
    split = builder.AddNamedSystem(f"{GROUP}_wires", Demultiplexer([machine.width(wire.over) for wire in wires]))
    builder.Connect(leaf.get_output_port(), split.get_input_port())
    return {wire.name: split.get_output_port(i) for i, wire in enumerate(wires)}


def source(machine: Machine, builder: DiagramBuilder, name: str, rows: np.ndarray) -> OutputPort:
    """Rows (frames, lanes) as a wire, each held for a frame."""
    breaks = machine.frame * np.arange(len(rows) + 1)
    held = PiecewisePolynomial.ZeroOrderHold(breaks, np.vstack([rows, rows[-1:]]).T)
    return builder.AddNamedSystem(name, TrajectorySource(held)).get_output_port()


def add_logs(machine: Machine, builder: DiagramBuilder, outputs: dict[str, OutputPort], fine_log: bool) -> None:
    """Logs of all wires in the table's order: a sample late in the last slot of a frame (or in every slot), written at its end.

    Two periodic events at "the same" time may differ by a rounding error, so a log on the tick could show either side of it; the hold
    samples three quarters into the slot, where nothing else happens.
    """
    wires = [wire for wire in machine.wires if wire.name in outputs]
    join = builder.AddNamedSystem("wires", Multiplexer([machine.width(wire.over) for wire in wires]))
    for i, wire in enumerate(wires):
        builder.Connect(outputs[wire.name], join.get_input_port(i))
    size, late = join.get_output_port().size(), 0.75 * machine.slot
    logs = [(LOG, machine.frame, machine.frame - machine.slot + late)]
    for name, period, offset in [*logs, (FINE_LOG, machine.slot, late)] if fine_log else logs:
        hold = builder.AddNamedSystem(f"{name}_hold", ZeroOrderHold(period, size, offset))
        sink = builder.AddNamedSystem(name, VectorLogSink(size, period))
        builder.Connect(join.get_output_port(), hold.get_input_port())
        builder.Connect(hold.get_output_port(), sink.get_input_port())


def logged(diagram: Diagram, context: Context, log: str = LOG) -> np.ndarray:
    """Rows (frames, wires) of a log so far, one for each frame that has ended; `FINE_LOG`: one for each slot."""
    sink = diagram.GetSubsystemByName(log)
    assert isinstance(sink, VectorLogSink)
    return np.ascontiguousarray(sink.FindLog(context).data()[:, 1:].T)


def set_numbers(diagram: Diagram, context: Context, machine: Machine, values: np.ndarray) -> None:
    """Puts other numbers [SI] into a Context of the Diagram and starts all parts anew, so that one Diagram serves many runs."""
    state = start_state(machine, values)
    for leaf in diagram.GetSystems():
        if not isinstance(leaf, Leaf):
            continue
        own = leaf.GetMyMutableContextFromRoot(context)
        if leaf.plan.name == GROUP:
            plan = plant_plan(machine, values)
            leaf.set_part(own, plan.numbers, plan.state, plan.held)
        else:
            block = next(b for b in machine.blocks if b.name == leaf.plan.name)
            numbers, part = values[numbers_of(machine, block)], state[state_of(machine, block)]
            leaf.set_part(own, numbers, part, held_at_start(machine, block, numbers, part))
