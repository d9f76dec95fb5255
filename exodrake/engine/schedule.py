"""Generates the engine: one frame as its slots in order, and the run over frames.

The one `run` serves simulation, prediction-error simulation and replay. Where something is imposed, signals carry
measured values: those of fixed segments (`model.machine.Segment`), so that no error of a segment reaches the others,
and single readings. Further functions run parts of a machine: `moves` its drives, `part__equation__...` a part's
equations.
"""

from collections.abc import Container
from inspect import signature

from exodrake.engine.inputs import RunOptions, feed_places, reading_places
from exodrake.model.machine import Imposed, Machine, Segment, feedthrough_order
from exodrake.model.part import Output, Part, prefix


def views(machine: Machine, signals: bool = True) -> list[str]:
    """Source lines that name the parts of the flat vectors p and state, and of w each signal (`w_name`)."""
    lines, parameter, state = [], 0, 0
    for part in machine.parts:
        name, count = part.name, sum(info.part == part.name for info in machine.parameters)
        lines += [f"{name}_p = p[{parameter}:{parameter + count}]", *part_views(machine, part, "state", state)]
        parameter, state = parameter + count, state + sum(machine.part_sizes[name])
    if signals:
        lines += [f"w_{name} = w[{at.start}:{at.stop}]" for name, at in machine.offsets.items()]
    return lines


def part_views(machine: Machine, part: Part, state: str, at: int = 0) -> list[str]:
    """Source lines that name a part's parameters n, effects e, state x and effect state z; `at`: start in `state`."""
    name, (own, extra) = part.name, machine.part_sizes[part.name]
    middle, end, count = at + own, at + own + extra, sum(machine.width(f.axis) for f in part.fields)
    effects = f"fill({name}_p[{count}:], INTEGER_{len(part.points)}, {name}_places, {name}_nulls)"
    return [
        f"{name}_n, {name}_e = {name}_p[:{count}], {effects}",
        f"{name}_x, {name}_z = {state}[{at}:{middle}], {state}[{middle}:{end}]",
    ]


def call(part: Part, function: str, arguments: list[str]) -> str:
    """A call of a part's function."""
    own = f"{part.name}_x, {part.name}_z, {part.name}_n, {part.name}_e"
    return f"{prefix(part.module.__name__)}__{function}({', '.join([own, *arguments])})"


def call_output(machine: Machine, part: Part, output: Output) -> list[str]:
    """Lines that compute one of a part's outputs."""
    if not output.states:
        return [call(part, output.function, [f"w_{name}" for name in (*output.reads, *output.writes)])]
    lines = []
    for name, state in zip(output.writes, output.states):
        shown = f"w_{name}[j] = {part.name}_x[{machine.state_index(part, state)} + j]"
        lines += nest(f"for j in range({len(machine.channels(name))}):", [shown])
    return lines


def outputs(machine: Machine, part_names: set[str] | None = None) -> list[str]:
    """Lines of the outputs of some parts, and of those that these feed, in feedthrough order."""
    changed: set[str] = set()
    lines = []
    for part, k in feedthrough_order(machine):
        output = part.outputs[k]
        if part_names is None or part.name in part_names or changed & set(output.reads):
            lines += call_output(machine, part, output)
            changed |= set(output.writes)
    return lines


def held_signals(part: Part) -> tuple[str, ...]:
    """Signals that follow from a part's state alone."""
    return tuple(name for output in part.outputs if not output.reads for name in output.writes)


def held_outputs(machine: Machine, part: Part) -> list[str]:
    """Lines that compute a part's held signals."""
    return [line for output in part.outputs if not output.reads for line in call_output(machine, part, output)]


def outer_reads(part: Part, reads: tuple[str, ...]) -> tuple[str, ...]:
    """Signals of `reads` that the part does not hold."""
    return tuple(name for name in reads if name not in held_signals(part))


def generate_begin(machine: Machine) -> str:
    """`begin(p, state)`: the start of every part, from the shared start vectors, which their writers fill first."""
    vectors = dict.fromkeys(name for part in machine.parts for name in start_vectors(part))
    first = sorted(machine.parts, key=lambda part: not part.fills_start)
    start = f"np.zeros(INTEGER_{len(machine.axes.tendons)})"
    lines = [*views(machine, signals=False), *(f"{name} = {start}" for name in vectors)]
    lines += [call_start(part) for part in first]
    return "@njit(cache=True)\ndef begin(p, state):\n" + indent(lines)


def start_vectors(part: Part) -> tuple[str, ...]:
    """Vectors over the tendons that a part's `start(x, z, n, e, ...)` reads, or fills if `fills_start`."""
    start = getattr(part.module, "start", None)
    return tuple(signature(start).parameters)[4:] if start else ()


def call_start(part: Part) -> str:
    """A call of a part's `start`; without one its state begins at 0."""
    has_start = hasattr(part.module, "start")
    return call(part, "start", list(start_vectors(part))) if has_start else f"{part.name}_x[:] = 0.0"


def generate_run(machine: Machine) -> str:
    """`run(p, state, w, given..., dt, substeps, record, *RunOptions)`.

    `record` takes the signals at each frame's end. The plant's tick stands in one place, so that it is inlined once.
    Nothing imposed: the signals follow from the state; else they go on from `w`.
    """
    given = [f"{name}_rows" for name in machine.inputs]
    private = dict.fromkeys((i.part, i.signal) for _, i in impositions(machine) if i.part)
    slot = nest("for _ in range(substeps):", tick(machine, private))
    for k in range(machine.slots):
        if lines := slot_tasks(machine, k):
            slot += nest(f"if slot == {k}:", lines)
    slot += impose_all(machine) + nest("if fine.shape[0] > 0:", [f"copy(w, fine[{machine.slots} * frame + slot])"])
    frame = [f"copy({name}_rows[frame], w_{name})" for name in machine.inputs]
    frame += [*nest(f"for slot in range({machine.slots}):", slot), "copy(w, record[frame])", *correct_state(machine)]
    body = [*views(machine), "imposing = readings.shape[0] > 0 or targets.shape[0] > 0"]
    body += nest("for k in range(len(fixed)):", ["imposing = imposing or fixed[k]"])
    body += [f"{part}_reads_{name} = np.zeros(len(w_{name})) if imposing else w_{name}" for part, name in private]
    body += nest("if not imposing:", outputs(machine)) + nest(f"for frame in range({given[0]}.shape[0]):", frame)
    arguments = ", ".join(["p, state, w", *given, "dt, substeps, record", *RunOptions._fields])
    return f"@njit(cache=True, nogil=True)\ndef run({arguments}):\n{indent(body)}"


def tick(machine: Machine, private: Container[tuple[str, str]]) -> list[str]:
    """The plant's tick: every update sees the signals before it, `private` ones as the segments impose them on it."""
    plant = [(b, t) for b in machine.parts for t in b.tasks if not t.slots]
    alone = [(s, i) for s, i in impositions(machine) if i.part]
    copies = dict.fromkeys(f"copy(w_{i.signal}, {i.part}_reads_{i.signal})" for _, i in alone)
    measured = (line for s, i in alone for line in impose_segment(machine, s, i))
    lines = nest("if imposing:", [*copies, *measured]) if alone else []
    for part, task in plant:
        reads = [f"{part.name}_reads_{n}" if (part.name, n) in private else f"w_{n}" for n in task.reads]
        lines.append(call(part, task.function, ["dt", *reads]))
    lines += outputs(machine, {b.name for b, _ in plant}) if plant else []
    for k, segment in enumerate(machine.segments):
        if segment.hold:
            part = next(b for b in machine.parts if b.name == segment.hold[0])
            width = machine.column_width(segment.output)
            values = ", ".join(measured_output(machine, segment, str(j)) for j in range(width))
            lines += nest(f"if imposing and fixed[{k}]:", [call(part, segment.hold[1], [f"({values})"])])
    return lines + impose_all(machine) or ["pass"]


def slot_tasks(machine: Machine, slot: int) -> list[str]:
    """The tasks in one slot, the outputs that follow, and the measured input of a run that follows a log."""
    here = [(b, t) for b in machine.parts for t in b.tasks if slot in t.slots]
    if not here:
        return []
    lines = []
    for part, task in here:
        channel = [f"INTEGER_{task.slots.index(slot)}"] if task.per_channel else []
        lines.append(call(part, task.function, [*channel, *(f"w_{name}" for name in task.reads)]))
    lines += outputs(machine, {b.name for b, _ in here})
    if (observer := machine.observer) is not None:
        signal = machine.column(observer.measured_input).signal
        if any(signal in output.writes for b, _ in here for output in b.outputs):
            width = machine.column_width(observer.measured_input)
            lines += nest("if follow.shape[0] > 0:", [f"copy(follow[frame, :{width}], w_{signal})"])
    return lines


def impositions(machine: Machine) -> list[tuple[Segment, Imposed]]:
    """Impositions of all segments; those of exact software are readings, and none of these."""
    return [
        (segment, imposed)
        for segment in machine.segments
        if not segment.exact
        for imposed in segment.imposed or (Imposed(machine.column(segment.output).signal),)
    ]


def measured_output(machine: Machine, segment: Segment, channel: str) -> str:
    """Measured output of a segment's channel in the middle of a slot, as source."""
    at = feed_places(machine)[segment.name].start
    value = f"feed[frame, {at} + {channel}]"
    if segment.sampled is None:
        return value
    return f"{value} + ((slot + 0.5) * {machine.slot!r} - {segment.sampled!r}) * rate[frame, {at} + {channel}]"


def impose_segment(machine: Machine, segment: Segment, imposed: Imposed) -> list[str]:
    """Lines that impose one signal of a segment if it is fixed."""
    at = feed_places(machine)[segment.name].start
    value = f"rate[frame, {at} + j]" if imposed.rate else measured_output(machine, segment, "j")
    value = f"max({value}, {imposed.low!r})" if imposed.low is not None else value
    value = f"{imposed.gain!r} * ({value})" if imposed.gain != 1.0 else value
    target = f"{imposed.part}_reads_{imposed.signal}" if imposed.part else f"w_{imposed.signal}"
    loop = nest(f"for j in range({machine.column_width(segment.output)}):", [f"{target}[j] = {value}"])
    return nest(f"if fixed[{machine.segments.index(segment)}]:", loop)


def impose(machine: Machine, signals: Container[str]) -> list[str]:
    """Lines that impose measured outputs and readings on some signals."""
    shared = [(s, i) for s, i in impositions(machine) if not i.part and i.signal in signals]
    lines = [line for s, i in shared for line in impose_segment(machine, s, i)]
    for kind, at in reading_places(machine).items():
        signal = machine.column(kind).signal
        if signal in signals:
            value = f"readings[frame, {at.start} + j]"
            there = nest(f"if {value} == {value}:", [f"w_{signal}[j] = {value}"])
            lines += nest("if readings.shape[0] > 0:", nest(f"for j in range({at.stop - at.start}):", there))
    return lines


def impose_all(machine: Machine) -> list[str]:
    """Lines that impose all that is measured, and compute what follows from it by direct feedthrough."""
    lines = impose(machine, machine.offsets)
    for part, k in feedthrough_order(machine):
        if (output := part.outputs[k]).reads:
            lines += [*call_output(machine, part, output), *impose(machine, output.writes)]
    return nest("if imposing:", lines) if lines else []


def correct_state(machine: Machine) -> list[str]:
    """Lines that move the observer's state towards its measured output at a frame's end."""
    observer = machine.observer
    if observer is None:
        return []
    part = next(b for b in machine.parts if b.name == observer.state[0])
    own = [e.name for e in machine.parameters if e.part == part.name]
    divisor = next(i for i, full in enumerate(own) if full.rsplit(".", 1)[0] == observer.divisor)
    signal, first = machine.column(observer.output).signal, machine.column_width(observer.measured_input)

    state, lines = f"{part.name}_x[{machine.state_index(part, observer.state[1])} + j]", []
    channels = f"for j in range({machine.column_width(observer.output)}):"
    for rows, target, gain in (
        ("follow", f"follow[frame, {first} + j]", repr(observer.gain)),
        ("targets", "targets[frame, j]", "gains[frame, j]"),
    ):
        off = [f"off = {target} - w_{signal}[j]"]
        off += nest("if off == off:", [f"{state} += {gain} * off / {part.name}_p[{divisor} + j]"])
        lines += nest(f"if {rows}.shape[0] > 0:", nest(channels, off))
    return lines + ["    " + line for line in held_outputs(machine, part)]


def generate_moves(machine: Machine) -> str:
    """`moves(...)`: by how much (`moved`) the drives move in a frame with commands `after` from slot `switch` on."""
    link = machine.command_link
    assert link is not None
    part = next(b for b in machine.parts if b.name == link.part)
    (task,) = (t for t in part.tasks if not t.slots)
    loads = [name for name in outer_reads(part, task.reads) if name != link.received]
    body = [
        f"{part.name}_p = p",
        *(f"w_{n} = np.zeros(INTEGER_{len(machine.channels(n))})" for n in held_signals(part)),
    ]
    ticks = [f"w_{link.received} = after[k] if tick >= switch else before[k]"]
    ticks += [call(part, task.function, ["dt", *(f"w_{n}" for n in task.reads)]), *held_outputs(machine, part)]
    inner = [*part_views(machine, part, "states[k]"), *held_outputs(machine, part), f"moved[k] = -w_{link.moved}"]
    inner += [*nest("for tick in range(slots):", ticks), f"moved[k] += w_{link.moved}"]
    body += nest("for k in range(states.shape[0]):", inner)
    arguments = ", ".join(("states, p, dt, slots, switch, before, after", *(f"w_{n}" for n in loads), "moved"))
    return f"@njit(cache=True)\ndef moves({arguments}):\n{indent(body)}"


def generate_equations(machine: Machine, part: Part) -> list[str]:
    """One function `part__equation__name(state, p, ...)` per task (`dt` or `channel`, reads...), output and start."""
    tasks = [(t.function, [*(["dt"] if not t.slots else ["channel"] * t.per_channel), *t.reads]) for t in part.tasks]
    outputs = [(o.function, [*o.reads, *o.writes]) for o in part.outputs if not o.states]
    functions = [(name, given, call(part, name, given)) for name, given in (*tasks, *outputs)]
    lines = []
    for name, given, line in [*functions, ("start", list(start_vectors(part)), call_start(part))]:
        head = f"@njit(cache=True)\ndef {part.name}__equation__{name}({', '.join(['state', 'p', *given])}):\n"
        lines.append(head + indent([f"{part.name}_p = p", *part_views(machine, part, "state"), line]))
    return lines


def nest(head: str, lines: list[str]) -> list[str]:
    """Lines under a head such as `if ...:`."""
    return [head, *("    " + line for line in lines)]


def indent(lines: list[str]) -> str:
    """Lines of a function's body."""
    return "\n".join("    " + line for line in lines)
