"""The closed loop as a Drake Diagram: machine and schedule of the compiled simulator, and to the last bit its results.

    diagram = build_diagram(load_robot(), Reference(tension), seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(60.0)
    signals = logged_signals(diagram, simulator.get_context())      # name -> (frames, channels)

Every signal is an exported output port, `motor.stroke`. Without a reference the references are input ports. Each part
is a system of its name, `diagram.GetSubsystemByName("motor")`; systems of one's own stand in its place or beside it.

Context time: the plant ticks 0.5 ms into each slot of 2 ms, and its ports then show the end of that slot, until the
next tick. Sampled tasks run in the middle of their slot. With `substeps`, all ticks of a slot lie in its first half.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort, OutputPort, PortDataType, System
from pydrake.systems.primitives import Multiplexer, VectorLogSink

from exodrake.core.errors import InputError, argument, nearest
from exodrake.diagrams.exo_index import add_exo_index
from exodrake.engine.inputs import NoiseInputs, Reference, input_rows, prepare_values, stack
from exodrake.machines.exo_index.machine import PARTS
from exodrake.model.machine import Machine, find_places
from exodrake.model.robot import Robot
from exodrake.systems.part import Cloneable, MachinePart, NamedParameter, PartSystem
from exodrake.systems.sources import Noise, Playback, RobotDraw


def build_diagram(
    robot: Robot, reference: Reference | None = None, seed: int | None = 0, quantisation: bool = True,
    substeps: int = 1, systems: Sequence[System] = (),
) -> RobotDiagram:  # fmt: skip
    """The closed loop of a robot, a system for each part.

    Args:
        robot: the robot; its parameters become the numeric parameters of the systems.
        reference: what the robot follows; None leaves the references as input ports.
        seed: of the noise; None runs without.
        quantisation: whether readings are rounded.
        substeps: plant ticks per slot.
        systems: systems of one's own, joined to the others by the names of their ports. One that is named like a part
            stands in its place; one that writes a reference drives it; what else they show is exported and logged.

    Returns:
        The Diagram, with an output port for each signal, and a log (see `logged_signals`).

    Raises:
        InputError: a system reads what nothing writes, writes what another writes, or does not write what its part did.

    Examples:
        >>> import exodrake as exo
        >>> diagram = build_diagram(exo.load_robot(), exo.grasp("caging"))
        >>> diagram.GetOutputPort("finger.angle").size()
        3
    """
    machine, systems = argument("robot", robot, Robot).machine, [argument("systems", one, System) for one in systems]
    rows: dict[str, np.ndarray] = {}
    if (reference := argument("reference", reference, Reference, type(None))) is not None:
        written = {port.get_name() for system in systems for port in list_outputs(system)}
        found = input_rows(machine, reference.values, NoiseInputs.draw(1, None, machine))
        rows = {n: v for n, v in found.items() if not machine.signal[n].distribution and n not in written}
    source = reference.name if reference else machine.name
    return RobotDiagram(robot, rows, seed, quantisation, substeps, systems, source)


def run_diagram(
    robot: Robot, values: np.ndarray, reference: Reference, noise_inputs: NoiseInputs, substeps: int
) -> np.ndarray:
    """All signals (frames, channels) [SI] at each frame's end; to the last bit those of the compiled simulator."""
    machine = robot.machine
    rows = input_rows(machine, reference.values, noise_inputs)
    diagram = RobotDiagram(replace(robot, values=values), rows, None, True, substeps)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(machine.frame * len(reference.values))
    return read_signals(machine, diagram, simulator.get_context())


class RobotDiagram(Cloneable, Diagram):
    """The closed loop of a robot: parts, sources of what comes from outside, and the log; see `build_diagram`.

    Subsystems beside the parts: `reference` plays the given signals, `noise` those of the sensors; `random` and `draw`
    make another robot within the tolerances, with noise of its own, of a Context that `SetRandomContext` has set; `log`
    is a VectorLogSink behind the Multiplexer `signals`.

    Attributes:
        robot: the robot.
        quantisation: whether readings are rounded.
        source: what the log of a run is named after.
        columns: signal -> place in a row of the log.
    """

    def __init__(
        self, robot: Robot, rows: Mapping[str, np.ndarray], seed: int | None, quantisation: bool = True,
        substeps: int = 1, systems: Sequence[System] = (), source: str = "",
    ) -> None:  # fmt: skip
        """Takes rows (frames, channels) of given signals [SI], and arguments as in `build_diagram`."""
        super().__init__()
        self.robot, self.quantisation, self.source = robot, quantisation, source
        robot = replace(robot, values=prepare_values(robot, quantisation))
        machine, builder = robot.machine, DiagramBuilder()
        own = {system.get_name(): system for system in systems}
        if len(own) < len(systems):
            names = [system.get_name() for system in systems]
            raise InputError(f"two systems are named {max(names, key=names.count)!r}")
        replaced = {part.name: own.pop(part.name) for part in machine.parts if part.name in own}
        if machine.parts == PARTS:
            parts, added = add_exo_index(builder, robot, substeps, **replaced)._asdict(), own
        else:
            parts = {p.name: replaced.get(p.name) or MachinePart(robot, p.name, substeps) for p in machine.parts}
            added = parts | own
        for name, system in added.items():
            builder.AddNamedSystem(name, system)
        if rows:
            builder.AddNamedSystem("reference", Playback(rows, machine.frame, 0.125 * machine.slot))
        draw = RobotDraw(robot)
        builder.AddNamedSystem("draw", draw)
        builder.AddNamedSystem("random", draw.source)
        builder.Connect(draw.source.get_output_port(), draw.GetInputPort("sample"))
        if any(machine.signal[name].distribution and name not in rows for name in machine.inputs):
            noise = builder.AddNamedSystem("noise", Noise(machine, seed))
            builder.Connect(draw.GetOutputPort("drawn_seed"), noise.GetInputPort("drawn_seed"))
        for name, system in parts.items():
            if isinstance(system, PartSystem):
                builder.Connect(draw.GetOutputPort(f"{name}.deviation"), system.GetInputPort("deviation"))
        ports: dict[str, OutputPort] = {}  # by the names by which input ports ask for them
        for system in builder.GetSystems():
            for port in list_outputs(system) if system.get_name() not in ("random", "draw") else ():
                name = port.get_name()
                if name in ports:
                    first: Any = ports[name].get_system()
                    both = f"{first.get_name()} and {system.get_name()} both write {name}"
                    raise InputError(f"{both}; a system takes a part's place by bearing its name")
                ports[name] = port
        for part in machine.parts:
            lacks = [repr(name) for output in part.outputs for name in output.writes if name not in ports]
            if lacks:
                raise InputError(f"the system in place of {part.name} has no output port {', '.join(lacks)}")
        for system in systems:
            known = {*ports, *machine.inputs, *getattr(system, "optional", ())}
            known |= {"deviation", "start_stroke"} if isinstance(system, PartSystem) else set()
            for name in (port.get_name() for port in list_inputs(system)):
                if name not in known:
                    hint = nearest(name.rpartition(".")[2], sorted(known))
                    raise InputError(f"{system.get_name()} reads {name!r}, which nothing writes{hint}")
        exported = set()
        for port in (port for system in builder.GetSystems() for port in list_inputs(system)):
            name = port.get_name()
            if builder.IsConnectedOrExported(port):
                continue
            if name in ports:
                builder.Connect(ports[name], port)
            elif name in exported:
                builder.ConnectInput(name, port)
            elif name in machine.inputs and not machine.signal[name].distribution:  # from outside
                builder.ExportInput(port, name)
                exported.add(name)
        # the log: a row of the signals that something writes, and of what systems of one's own show
        names = [name for name in machine.signal if name in ports]
        names += [n for n in ports if n not in machine.signal and not isinstance(ports[n].get_system(), PartSystem)]
        sizes = [ports[name].size() for name in names]
        signals = builder.AddNamedSystem("signals", Multiplexer(sizes))
        log = builder.AddNamedSystem("log", VectorLogSink(sum(sizes), machine.frame))
        for k, name in enumerate(names):
            builder.Connect(ports[name], signals.get_input_port(k))
        builder.Connect(signals.get_output_port(), log.get_input_port())
        self.columns = stack(dict(zip(names, sizes)))
        for name, port in ports.items():
            system: Any = port.get_system()
            if name in machine.signal or system in systems:
                builder.ExportOutput(port, f"{system.get_name()}.{name}")
        builder.BuildInto(self)
        self.set_name(machine.name)


def list_inputs(system: System) -> list[InputPort]:
    """Input ports of a system."""
    return [system.get_input_port(i) for i in range(system.num_input_ports())]


def list_outputs(system: System) -> list[OutputPort]:
    """Output ports of a system that carry vectors."""
    ports = (system.get_output_port(i) for i in range(system.num_output_ports()))
    return [port for port in ports if port.get_data_type() == PortDataType.kVectorValued]


def logged_signals(diagram: Diagram, context: Context) -> dict[str, np.ndarray]:
    """Signal -> (rows, channels) array [SI], `time` -> (rows,) [s]; all that the Diagram's systems show.

    A row for each frame that has ended. A Context that was set back in time has lost the rows from there on.

    Args:
        diagram: from `build_diagram`.
        context: root Context that has run.

    Examples:
        >>> import exodrake as exo
        >>> diagram = exo.build_diagram(exo.load_robot(), exo.grasp("caging"))
        >>> logged_signals(diagram, diagram.CreateDefaultContext())["angle"].shape
        (0, 3)
    """
    robot_diagram = check_diagram(diagram)
    sink: Any = robot_diagram.GetSubsystemByName("log")
    log = sink.GetLog(sink.GetMyContextFromRoot(argument("context", context, Context)))
    kept: list[int] = []
    times = np.array(log.sample_times())
    for i, time in enumerate(times):
        while kept and times[kept[-1]] > time:
            kept.pop()
        if time > 0.0 and not (kept and times[kept[-1]] == time):
            kept.append(i)
    rows = np.ascontiguousarray(log.data()[:, kept].T)
    return {"time": times[kept]} | {name: rows[:, place] for name, place in robot_diagram.columns.items()}


def check_diagram(diagram: Diagram) -> RobotDiagram:
    """A Diagram from `build_diagram`. TypeError for any other."""
    argument("diagram", diagram, Diagram)
    if not isinstance(diagram, RobotDiagram):
        raise TypeError("diagram: wanted one from build_diagram, whose log has a column for each signal")
    return diagram


def read_signals(machine: Machine, diagram: Diagram, context: Context) -> np.ndarray:
    """All signals (rows, channels) [SI] of the machine side by side; arguments as in `logged_signals`.

    Signals from outside are missing where they are input ports of the Diagram.
    """
    found = logged_signals(diagram, context)
    return np.hstack([found[signal.name] for signal in machine.signals if signal.name in found])


def find_parameter(diagram: Diagram, name: str) -> NamedParameter:
    """A parameter of a Diagram's parts by its full name, whichever system holds it. InputError if none does.

    Examples:
        >>> import exodrake as exo
        >>> diagram = exo.build_diagram(exo.load_robot())
        >>> find_parameter(diagram, "finger.kappa.MCP").get(diagram.CreateDefaultContext())
        array([0.08])
    """
    known: list[str] = []
    for system in argument("diagram", diagram, Diagram).GetSystems():
        if isinstance(system, PartSystem):
            if find_places(name, system.parameter_names):
                return system.parameter(name)
            known += system.parameter_names
    raise InputError(f"{diagram.get_name()} has no parameter {name!r}{nearest(name, known)}")


def set_parameters(robot: Robot, diagram: Diagram, context: Context) -> None:
    """Puts a robot's parameters into a Context of its machine's Diagram and starts anew: one Diagram, many runs.

    Args:
        robot: of the machine of the Diagram.
        diagram: from `build_diagram`; readings stay unrounded if it was built so.
        context: root Context.

    Raises:
        InputError: the robot lacks a parameter.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> robot = exo.load_robot()
        >>> diagram = exo.build_diagram(robot, exo.grasp("caging"))
        >>> simulator = Simulator(diagram)
        >>> set_parameters(robot.splice("tendon.coulomb_friction"), diagram, simulator.get_mutable_context())
    """
    robot = replace(argument("robot", robot, Robot), values=prepare_values(robot, check_diagram(diagram).quantisation))
    diagram.SetDefaultContext(argument("context", context, Context))
    context.SetTime(0.0)
    for system in diagram.GetSystems():
        if isinstance(system, PartSystem):
            values = np.array([robot[name] for name in system.parameter_names])
            own = system.GetMyMutableContextFromRoot(context)
            own.get_mutable_numeric_parameter(0).SetFromVector(values)
