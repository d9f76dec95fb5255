"""Generates the schedule: one frame as its slots in order, the run over frames, the batch over rows of parameters."""

from __future__ import annotations

from inspect import signature

from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task, prefix
from exodrake.core.wiring import feedthrough_order


def generate_frame(machine: Machine) -> list[str]:
    """The functions `begin`, `run` and `batch`."""
    return [generate_begin(machine), generate_run(machine), generate_batch(machine)]


def views(machine: Machine, signals: bool = True) -> list[str]:
    """Source lines that name the parts of the flat vectors p, state and w."""
    lines, parameter, state, at = [], 0, 0, 0
    for part in machine.parts:
        count = sum(info.part == part.name for info in machine.parameters)
        own, extra = machine.part_size(part)
        lines += [f"{part.name}_p = p[{parameter}:{parameter + count}]"]
        name, middle, end = part.name, state + own, state + own + extra
        lines += [f"{name}_n, {name}_e = fill_{name}_n({name}_p), fill_{name}_e({name}_p)"]
        lines += [f"{name}_x, {name}_z = state[{state}:{middle}], state[{middle}:{end}]"]
        parameter, state = parameter + count, end
    for signal in machine.signals if signals else ():
        width = machine.width(signal.axis)
        lines.append(f"{signal.name} = w[{at}:{at + width}]")
        at += width
    return lines


def call(part: Part, function: str, arguments: list[str]) -> str:
    """A call of a part's function."""
    module = prefix(part.module.__name__)
    return f"{module}__{function}({part.name}_x, {part.name}_z, {part.name}_n, {part.name}_e, {', '.join(arguments)})"


def outputs(machine: Machine, part_names: set[str] | None = None) -> list[str]:
    """Calls of the outputs of some parts, and of those that these feed, in feedthrough order."""
    changed: set[str] = set()
    lines = []
    for part, k in feedthrough_order(machine):
        output = part.outputs[k]
        if part_names is None or part.name in part_names or changed & set(output.reads):
            lines.append(call(part, output.function, [*output.reads, *output.writes]))
            changed |= set(output.writes)
    return lines


def tick(machine: Machine) -> list[str]:
    """The plant's tick: every update sees the signals before it; then the outputs follow."""
    plant = [(b, t) for b in machine.parts for t in b.tasks if not t.slots]
    lines = [call(b, t.function, ["dt", *t.reads]) for b, t in plant]
    return lines + outputs(machine, {b.name for b, _ in plant}) if plant else ["pass"]


def task_lines(machine: Machine, slot: int, channel: str = "") -> list[str]:
    """The tasks in one slot and the outputs that follow.

    `channel`: source of the channel's index, if not the slot's own.
    """
    here: list[tuple[Part, Task]] = [(b, t) for b in machine.parts for t in b.tasks if slot in t.slots]
    lines = [
        call(b, t.function, [*([channel or str(t.slots.index(slot))] if t.per_channel else []), *t.reads])
        for b, t in here
    ]
    return lines + (outputs(machine, {b.name for b, _ in here}) if here else [])


def generate_begin(machine: Machine) -> str:
    """`begin(p, state)`: the start of every part, from the shared start vectors, which their writers fill first."""
    vectors = dict.fromkeys(name for part in machine.parts for name in start_vectors(part))
    first = sorted(machine.parts, key=lambda part: not part.fills_start)
    lines = [*views(machine, signals=False), *(f"{name} = np.zeros({len(machine.axes.tendons)})" for name in vectors)]
    lines += [call(part, "start", list(start_vectors(part))) for part in first]
    return "@njit(cache=True)\ndef begin(p, state):\n" + indent(lines)


def start_vectors(part: Part) -> tuple[str, ...]:
    """Vectors over the tendons that a part's `start(x, z, n, e, ...)` reads, or fills if `fills_start`."""
    return tuple(signature(part.module.start).parameters)[4:]


def inject_input(machine: Machine, slot: int) -> list[str]:
    """Lines that put measured values on the measured input after the slot in which it is written."""
    observer = machine.observer
    if observer is None:
        return []
    signal = machine.column(observer.measured_input).signal
    here = [b for b in machine.parts if any(slot in t.slots for t in b.tasks)]
    if all(signal not in output.writes for b in here for output in b.outputs):
        return []
    return [
        "if follow.shape[0] > 0:",
        f"    {signal}[:] = follow[frame, :{machine.column_width(observer.measured_input)}]",
    ]


def correct_state(machine: Machine) -> list[str]:
    """Lines that move the observed state at a frame's end."""
    observer = machine.observer
    if observer is None:
        return []
    name, state = observer.state
    part = next(b for b in machine.parts if b.name == name)
    signal, at = machine.column(observer.output).signal, machine.state_index(part, state)
    own = [e.name for e in machine.parameters if e.part == name]
    divisor = next(i for i, full in enumerate(own) if full.startswith(observer.divisor + "."))
    first = machine.column_width(observer.measured_input)
    change = f"{observer.gain} * (follow[frame, {first} + j] - {signal}[j]) / {name}_p[{divisor} + j]"
    return [
        "if follow.shape[0] > 0:",
        f"    for j in range({machine.column_width(observer.output)}):",
        f"        {name}_x[{at} + j] += {change}",
    ]


def generate_run(machine: Machine) -> str:
    """`run(p, state, w, given..., dt, substeps, record, fine, follow)`: frames in order.

    `record` and `fine` take the signals at each frame's and each slot's end. The plant's tick stands in one place, so
    that it is inlined once. `follow`: values of measured input and output (frames, channels of both), or of no length.
    """
    given = [f"{name}_rows" for name in machine.inputs]
    body = [*views(machine), *outputs(machine), f"for frame in range({given[0]}.shape[0]):"]
    inner = [f"{name}[:] = {name}_rows[frame]" for name in machine.inputs]
    inner += [f"for slot in range({machine.slots}):"]
    inner += ["    for _ in range(substeps):", *("        " + line for line in tick(machine))]
    for slot in range(machine.slots):
        if lines := task_lines(machine, slot):
            lines += inject_input(machine, slot)
            inner += [f"    if slot == {slot}:", *("        " + line for line in lines)]
    inner += ["    if fine.shape[0] > 0:", f"        fine[{machine.slots} * frame + slot, :] = w"]
    inner += ["record[frame, :] = w", *correct_state(machine)]
    header = f"@njit(cache=True)\ndef run(p, state, w, {', '.join(given)}, dt, substeps, record, fine, follow):\n"
    return header + indent(body + ["    " + line for line in inner])


def generate_batch(machine: Machine) -> str:
    """`batch(rows, size, given..., dt, substeps, records, follow)`: a run from the start for each row of parameters.

    Threads may call it side by side (`core.threads`).
    """
    given = [f"{name}_rows" for name in machine.inputs]
    lines = [
        "for i in range(rows.shape[0]):",
        "    state, w, fine = np.zeros(size), np.zeros(records.shape[2]), np.zeros((0, 0))",
        "    begin(rows[i], state)",
        f"    run(rows[i], state, w, {', '.join(given)}, dt, substeps, records[i], fine, follow)",
    ]
    header = f"def batch(rows, size, {', '.join(given)}, dt, substeps, records, follow):\n"
    return "@njit(cache=True, nogil=True)\n" + header + indent(lines)


def indent(lines: list[str]) -> str:
    """Lines of a function's body."""
    return "\n".join("    " + line for line in lines)
