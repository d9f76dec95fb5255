"""The closed loop as a Drake Diagram: machine and schedule of the compiled simulator, and to the last bit its results.

    diagram = build_diagram(load_robot(), Reference(tension), seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(60.0)
    rows = logged(robot.machine, diagram, simulator.get_context())     # (frames, channels of all signals side by side)

Every signal is an exported output port, `motor.stroke`. Without a reference the exogenous signals are input ports.
Each part is a leaf of its name: `diagram.GetSubsystemByName("motor")`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort

from exodrake.compiled.events import layout, memory_size, signals_read
from exodrake.compiled.inputs import NoiseInputs, Reference, input_rows, prepared
from exodrake.compiled.leaf_functions import held_signals
from exodrake.core.machine import Machine
from exodrake.core.part import Part
from exodrake.core.robot import Robot
from exodrake.diagrams.gp_estimator import GPEstimator
from exodrake.diagrams.inputs import OUTSIDE, ExogenousInputs
from exodrake.diagrams.leaf import InputSpec, Leaf
from exodrake.diagrams.leaf_specs import part_spec
from exodrake.diagrams.parts import part_class
from exodrake.diagrams.signal_log import SignalLog
from exodrake.systems.gp_estimator import Weights

LOG, FINE_LOG = "log", "fine_log"


def build_diagram(
    robot: Robot,
    reference: Reference | None = None,
    seed: int | None = 0,
    quantisation: bool = True,
    substeps: int = 1,
    fine_log: bool = False,
    estimator: Weights | None = None,
) -> Diagram:
    """The closed loop of a robot, a leaf for each part.

    Args:
        robot: the robot; its parameters become the numeric parameters of the leaves.
        reference: what the robot follows; None leaves the exogenous signals (tension_ref, noise...) as input ports.
        seed: of the noise; None runs without.
        quantisation: whether readings are rounded.
        substeps: plant ticks per slot.
        fine_log: also log all signals every slot.
        estimator: weights of a joint-angle estimator that listens (ports `estimator.angle_est`, `.angle_std`; not
            logged).

    Returns:
        The Diagram, with the subsystem `log` (see `logged`) and an output port for each signal.
    """
    robot, rows = replace(robot, values=prepared(robot, quantisation)), None
    if reference is not None:
        noise_inputs = NoiseInputs.draw(len(reference.tension), seed, robot.machine)
        rows = input_rows(robot.machine, reference.tension, noise_inputs)
    return assemble(robot, rows, substeps, fine_log, estimator)


def run_diagram(
    robot: Robot, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int
) -> np.ndarray:
    """All signals (frames, channels) [SI] at each frame's end; to the last bit those of the compiled simulator."""
    machine = robot.machine
    diagram = assemble(replace(robot, values=values), input_rows(machine, reference.tension, noise_inputs), substeps)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(machine.frame * len(reference.tension))
    return logged(machine, diagram, simulator.get_context())


def assemble(
    robot: Robot,
    rows: Mapping[str, np.ndarray] | None,
    substeps: int = 1,
    fine_log: bool = False,
    estimator: Weights | None = None,
) -> Diagram:
    """The Diagram of a robot.

    Args:
        robot: what is simulated.
        rows: exogenous signal -> (frames, channels) array [SI]; None: they are exported as input ports.
        substeps: plant ticks per slot.
        fine_log: whether a row is logged each slot, too.
        estimator: weights of an estimator that listens, if any.
    """
    machine, builder = robot.machine, DiagramBuilder()
    leaves = [part_class(machine, part.name)(robot, substeps, inputs_of(machine, part, rows is not None))
              for part in machine.parts]  # fmt: skip
    ports: dict[str, OutputPort] = {}  # what input ports connect to
    for leaf in leaves:
        builder.AddNamedSystem(leaf.get_name(), leaf)
        ports[memory_of(leaf.get_name())] = leaf.GetOutputPort("memory")
        ports |= {name: leaf.GetOutputPort(name) for name in leaf.spec.signals}
    if rows is not None:
        inputs = builder.AddNamedSystem(OUTSIDE, ExogenousInputs(machine, dict(rows)))
        ports[memory_of(OUTSIDE)] = inputs.GetOutputPort("memory")
        ports |= {name: inputs.GetOutputPort(name) for name in rows}
    join_inputs(builder, ports, leaves)
    writer = {signal: leaf.get_name() for leaf in leaves for signal in leaf.spec.signals}
    for name in (signal.name for signal in machine.signals if signal.name in ports):
        builder.ExportOutput(ports[name], f"{writer.get(name, OUTSIDE)}.{name}")
    add_logs(machine, builder, ports, fine_log)
    if estimator is not None:
        add_estimator(machine, builder, ports, estimator)
    diagram = builder.Build()
    diagram.set_name(machine.name)
    return diagram


def memory_of(system: str) -> str:
    """Name of the wide port of a system, apart from the names of signals."""
    return f"{system}.memory"


def held_by(machine: Machine) -> dict[str, Part]:
    """Signal -> the part whose memory holds it; signals of direct feedthrough and exogenous ones are missing."""
    return {name: part for part in machine.parts for name in held_signals(part)}


def inputs_of(machine: Machine, part: Part, rows: bool) -> dict[str, InputSpec]:
    """Input ports of a part in the Diagram: the memory of each part that it reads, and the signals of feedthrough.

    Args:
        machine: the machine.
        part: one of its parts.
        rows: whether the exogenous signals come from `ExogenousInputs`; else each is a port of its own.
    """
    holder, ports = held_by(machine), {}
    widths = {signal.name: machine.width(signal.axis) for signal in machine.signals}
    exogenous = input_places(machine)
    for name in signals_read(part):
        if name in holder:
            source, size, at = (
                memory_of(holder[name].name),
                memory_size(machine, holder[name]),
                layout(machine, holder[name])[name],
            )
        elif name in exogenous and rows:
            source, size, at = memory_of(OUTSIDE), max(place.stop for place in exogenous.values()), exogenous[name]
        else:
            source, size, at = name, widths[name], slice(0, widths[name])
        before = ports[source].signals if source in ports else {}
        ports[source] = InputSpec(size, {**before, name: at}, connected=rows or name not in exogenous)
    return ports


def input_places(machine: Machine) -> dict[str, slice]:
    """Where the exogenous signals lie side by side."""
    found, at = {}, 0
    for name in machine.inputs:
        width = machine.width(machine.signal[name].axis)
        found[name], at = slice(at, at + width), at + width
    return found


def join_inputs(builder: DiagramBuilder, ports: Mapping[str, OutputPort], leaves: Sequence[Leaf]) -> None:
    """Connects each input port to the output of its name; what nothing writes becomes an input port of the Diagram."""
    exported = set()
    for leaf in leaves:
        for name in leaf.spec.inputs:
            port = leaf.GetInputPort(name)
            if name in ports:
                builder.Connect(ports[name], port)
            elif name in exported:
                builder.ConnectInput(name, port)
            else:
                builder.ExportInput(port, name)
                exported.add(name)


def add_estimator(machine: Machine, builder: DiagramBuilder, ports: Mapping[str, OutputPort], weights: Weights) -> None:
    """An estimator that listens to the readings, with its outputs exported."""
    leaf = builder.AddNamedSystem("estimator", GPEstimator(weights, machine))
    for i in range(leaf.num_input_ports()):
        builder.Connect(ports[leaf.get_input_port(i).get_name()], leaf.get_input_port(i))
    for i in range(leaf.num_output_ports()):
        builder.ExportOutput(leaf.get_output_port(i), f"estimator.{leaf.get_output_port(i).get_name()}")


def logged_ports(machine: Machine, rows: bool) -> dict[str, tuple[int, dict[str, slice]]]:
    """What a log shows, in order: port -> (its width, places of the signals in it)."""
    holder, found = held_by(machine), {}
    for part in machine.parts:
        where = layout(machine, part)
        found[memory_of(part.name)] = memory_size(machine, part), {name: where[name] for name in held_signals(part)}
        through = {name: at.stop - at.start for name, at in where.items() if name not in holder}
        found |= {name: (width, {name: slice(0, width)}) for name, width in through.items()}
    if rows:
        places = input_places(machine)
        found[memory_of(OUTSIDE)] = max(place.stop for place in places.values()), places
    return found


def add_logs(machine: Machine, builder: DiagramBuilder, ports: Mapping[str, OutputPort], fine_log: bool) -> None:
    """Logs of all signals at the end of each frame (or slot), where nothing else happens."""
    widths = {name: width for name, (width, _) in logged_ports(machine, memory_of(OUTSIDE) in ports).items()}
    for log, period in [(LOG, machine.frame), (FINE_LOG, machine.slot)] if fine_log else [(LOG, machine.frame)]:
        system = builder.AddNamedSystem(log, SignalLog(widths, period))
        for name in widths:
            builder.Connect(ports[name], system.GetInputPort(name))


def logged(machine: Machine, diagram: Diagram, context: Context, log: str = LOG) -> np.ndarray:
    """All signals of a log [SI].

    Args:
        machine: the machine.
        diagram: its Diagram.
        context: Context of the Diagram that has run.
        log: `LOG`, one row for each frame that has ended, or `FINE_LOG`, one for each slot.

    Returns:
        (rows, channels) array of all signals of the machine side by side, each in its unit. Exogenous signals are
        missing if the Diagram was built without a reference.
    """
    system = diagram.GetSubsystemByName(log)
    assert isinstance(system, SignalLog)
    at, places = 0, {}
    for width, inside in logged_ports(machine, diagram.HasSubsystemNamed(OUTSIDE)).values():
        places |= {name: np.arange(at + place.start, at + place.stop) for name, place in inside.items()}
        at += width
    order = np.concatenate([places[signal.name] for signal in machine.signals if signal.name in places])
    return np.array(system.rows(system.GetMyContextFromRoot(context))).reshape(-1, at)[1:, order]


def set_parameters(robot: Robot, diagram: Diagram, context: Context) -> None:
    """Puts a robot's parameters into a Context of its machine's Diagram and starts anew: one Diagram, many runs."""
    parts = {part.name: part for part in robot.machine.parts}
    for leaf in diagram.GetSystems():
        if isinstance(leaf, Leaf) and leaf.get_name() in parts:
            spec = part_spec(robot.machine, parts[leaf.get_name()], robot.values)
            leaf.set_part(leaf.GetMyMutableContextFromRoot(context), spec)
