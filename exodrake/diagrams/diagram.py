"""The closed loop as a Drake Diagram: machine and schedule of the compiled simulator, and to the last bit its results.

    diagram = build_diagram(load_robot(), Reference(tension), seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(60.0)
    signals = logged_signals(diagram, simulator.get_context())      # name -> (frames, channels)

Every signal is an exported output port, `motor.stroke`. Without a reference the references are input ports. Each part
is a leaf of its name, `diagram.GetSubsystemByName("motor")`; systems of one's own stand in its place or beside it.
A leaf reads the state of others where it lies: `FixValue` on its input port `stroke` has no effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort, PortDataType, System

from exodrake.compiled.events import layout, memory_size, reads_of, start_reads, table_reads, width_of
from exodrake.compiled.inputs import NoiseInputs, Reference, input_rows, prepared
from exodrake.compiled.leaf_functions import held_signals
from exodrake.core.argument import argument
from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.core.part import Part
from exodrake.core.robot import Robot
from exodrake.diagrams.exogenous import Exogenous
from exodrake.diagrams.host import HOST, SAMPLE, Host, host_of
from exodrake.diagrams.leaf import Leaf
from exodrake.diagrams.leaf_spec import InputSpec, wide_port
from exodrake.diagrams.part_spec import alone
from exodrake.diagrams.parts import part_class
from exodrake.diagrams.signal_log import FINE_LOG, SignalLog, logged


def build_diagram(
    robot: Robot,
    reference: Reference | None = None,
    seed: int | None = 0,
    quantisation: bool = True,
    substeps: int = 1,
    fine_log: bool = False,
    systems: Sequence[System] = (),
) -> Diagram:
    """The closed loop of a robot, a leaf for each part.

    Args:
        robot: the robot; its parameters become the numeric parameters of the leaves.
        reference: what the robot follows; None leaves the references as input ports.
        seed: of the noise; None runs without.
        quantisation: whether readings are rounded.
        substeps: plant ticks per slot.
        fine_log: also log all signals every slot.
        systems: systems of one's own, joined to the others by the names of their ports. One that is named like a part
            stands in its place; one that writes a reference drives it; what else they show is exported and logged.

    Returns:
        The Diagram, with the subsystem `log` (see `logged_signals`) and an output port for each signal.

    Raises:
        InputError: a system reads what nothing writes, writes what another writes, or does not write what its part did.
    """
    machine = argument("robot", robot, Robot).machine
    names = [n for n in machine.inputs if n not in written_by(systems)]
    drawn = tuple(name for name in names if machine.signal[name].distribution)
    rows: dict[str, np.ndarray] = {}
    if (reference := argument("reference", reference, Reference, type(None))) is not None:
        found = input_rows(machine, reference.values, NoiseInputs.draw(1, None, machine))
        rows = {name: found[name] for name in names if name not in drawn}
    robot = replace(robot, values=prepared(robot, quantisation))
    diagram = assemble(robot, Exogenous(machine, rows, drawn, seed), substeps, fine_log, systems)
    host = host_of(diagram)
    host.quantisation, host.source = quantisation, reference.name if reference else machine.name
    return diagram


def run_diagram(
    robot: Robot, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int
) -> np.ndarray:
    """All signals (frames, channels) [SI] at each frame's end; to the last bit those of the compiled simulator."""
    machine = robot.machine
    exogenous = Exogenous(machine, input_rows(machine, reference.values, noise_inputs), (), None)
    diagram = assemble(replace(robot, values=values), exogenous, substeps)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(machine.frame * len(reference.values))
    return logged(machine, diagram, simulator.get_context())


def assemble(
    robot: Robot, exogenous: Exogenous, substeps: int = 1, fine_log: bool = False, systems: Sequence[System] = ()
) -> Diagram:
    """The Diagram of a robot; exogenous signals that nothing makes are input ports. Arguments as in `build_diagram`."""
    machine, builder = robot.machine, DiagramBuilder()
    own = {system.get_name(): system for system in systems}
    if len(own) < len(systems):
        names = [system.get_name() for system in systems]
        raise InputError(f"two systems are named {max(names, key=names.count)!r}")
    wide = wide_ports(machine, set(own))
    for part in machine.parts:
        inputs = inputs_of(machine, part, wide)
        leaf = own.pop(part.name, None) or part_class(machine, part.name)(robot, substeps, inputs)
        builder.AddNamedSystem(part.name, leaf)
    for name, system in own.items():
        builder.AddNamedSystem(name, system)
    logged_ports = ports_to_log(machine, port_names(builder), wide)
    builder.AddNamedSystem(HOST, Host(exogenous, logged_ports))
    if fine_log:
        inputs = {**logged_ports, **{name: alone(machine, name) for name in exogenous.signals}}
        builder.AddNamedSystem(FINE_LOG, SignalLog(inputs, machine.slot, 0.75 * machine.slot))
    ports = port_names(builder)
    check_written(machine, ports, systems)
    join_inputs(machine, builder, ports)
    for name, port in ports.items():
        system: Any = port.get_system()
        if name in machine.signal or (system in systems and vector_like(port)):
            builder.ExportOutput(port, f"{system.get_name()}.{name}")
    diagram = builder.Build()
    diagram.set_name(machine.name)
    return diagram


def memory_of(system: str) -> str:
    """Name of the wide port of a system, apart from the names of signals."""
    return f"{system}.memory"


def vector_like(port: OutputPort) -> bool:
    """Whether a port carries a vector."""
    return port.get_data_type() == PortDataType.kVectorValued


def written_by(systems: Sequence[System]) -> set[str]:
    """Names of the output ports of some systems."""
    return {system.get_output_port(i).get_name() for system in systems for i in range(system.num_output_ports())}


def wide_ports(machine: Machine, replaced: set[str]) -> dict[str, InputSpec]:
    """Ports that carry several signals, and those that say where a state lies: port -> what it carries."""
    found = {}
    for part in (part for part in machine.parts if part.name not in replaced):
        where = layout(machine, part)
        carried = {name: where[name] for name in held_signals(part)}
        found[memory_of(part.name)] = InputSpec(memory_size(machine, part), carried, state=True)
        for writes in (output.writes for output in part.outputs if output.reads and len(output.writes) > 1):
            first, last = where[writes[0]].start, where[writes[-1]].stop
            places = {name: slice(where[name].start - first, where[name].stop - first) for name in writes}
            found[wide_port(writes)] = InputSpec(last - first, places)
    return found


def inputs_of(machine: Machine, part: Part, wide: Mapping[str, InputSpec]) -> dict[str, InputSpec]:
    """Input ports of a part in the Diagram: the wide ports that carry what it reads; all else has a port of its own.

    A state behind direct feedthrough has both, so that Drake sees what depends on it.
    """
    holder = {name: port for port, spec in wide.items() for name in spec.signals}
    wanted: dict[str, list[str]] = {}
    for name in (name for name in table_reads(part) if name in holder):
        wanted.setdefault(holder[name], []).append(name)
    found = {
        port: replace(wide[port], signals={name: wide[port].signals[name] for name in names})
        for port, names in wanted.items()
    }
    through = {name for output in part.outputs for name in reads_of(part, output.reads) if name in holder}
    through = {name for name in through if wide[holder[name]].state}
    found |= {name: InputSpec(width_of(machine, name), {}) for name in sorted(through)}
    return found | {name: alone(machine, name) for name in table_reads(part) if name not in holder}


def port_names(builder: DiagramBuilder) -> dict[str, OutputPort]:
    """Output ports by the names by which input ports ask for them. InputError if two systems write one signal."""
    found: dict[str, OutputPort] = {}
    for system in builder.GetSystems():
        for port in (system.get_output_port(i) for i in range(system.num_output_ports())):
            name = port.get_name()
            if isinstance(system, Host) and name == SAMPLE:
                continue
            if isinstance(system, Leaf) and name == "memory":
                name = memory_of(system.get_name())
            if name in found and vector_like(port):
                first: Any = found[name].get_system()
                both = f"{first.get_name()} and {system.get_name()} both write {name}"
                raise InputError(f"{both}; a system takes a part's place by bearing its name")
            found[name] = port
    return found


def check_written(machine: Machine, ports: Mapping[str, OutputPort], systems: Sequence[System]) -> None:
    """InputError where a system of one's own does not fit in."""
    for part in machine.parts:
        for name in (name for output in part.outputs for name in output.writes):
            if name not in ports:
                raise InputError(f"the system in place of {part.name} has no output port {name!r}")
    known = {*ports, *machine.inputs}
    for system in systems:
        for i in range(system.num_input_ports()):
            if (name := system.get_input_port(i).get_name()) not in known:
                hint = nearest(name.rpartition(".")[2], sorted(known))
                raise InputError(f"{system.get_name()} reads {name!r}, which nothing writes{hint}")


def join_inputs(machine: Machine, builder: DiagramBuilder, ports: Mapping[str, OutputPort]) -> None:
    """Connects each input port to the output of its name; an exogenous signal else becomes a port of the Diagram."""
    exported = set()
    for system in builder.GetSystems():
        for i in range(system.num_input_ports()):
            port = system.get_input_port(i)
            name = port.get_name()
            if name in ports:
                builder.Connect(ports[name], port)
            elif name in exported:
                builder.ConnectInput(name, port)
            elif name in machine.inputs:
                builder.ExportInput(port, name)
                exported.add(name)


def ports_to_log(
    machine: Machine, ports: Mapping[str, OutputPort], wide: Mapping[str, InputSpec]
) -> dict[str, InputSpec]:
    """Input ports of a log: the wide ports, and all other vectors that are shown."""
    starts = {name for part in machine.parts for name in start_reads(part)}
    carried = {name for spec in wide.values() for name in spec.signals} | starts | set(wide)
    sizes = {name: port.size() for name, port in ports.items() if name not in carried and vector_like(port)}
    return {**wide, **{name: InputSpec(size, {name: slice(0, size)}) for name, size in sizes.items()}}


def set_parameters(robot: Robot, diagram: Diagram, context: Context) -> None:
    """Puts a robot's parameters into a Context of its machine's Diagram and starts anew: one Diagram, many runs.

    Args:
        robot: of the machine of the Diagram.
        diagram: from `build_diagram`; readings stay unrounded if it was built so.
        context: root Context.

    Raises:
        InputError: the robot lacks a parameter.
    """
    robot = replace(argument("robot", robot, Robot), values=prepared(robot, host_of(diagram).quantisation))
    diagram.SetDefaultContext(argument("context", context, Context))
    context.SetTime(0.0)
    for leaf in diagram.GetSystems():
        if isinstance(leaf, Leaf):
            own = leaf.GetMyMutableContextFromRoot(context)
            values = [robot[name] for name in leaf.spec.parameter_names]
            own.get_mutable_numeric_parameter(0).SetFromVector(np.array(values))
