"""The Exo-Index between measured signals as a Python loop over its equations: reference of compiled replay."""

from math import cos, sin

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.schedule import outer_reads
from exodrake.core.machine import feedthrough_order
from exodrake.physics import wire_paths

SOFT, READ = 1e-3, 0.005  # N/m: tendons so soft that a stroke is a force; s: middle of the bus reads
Q, RATE, TAKEN = slice(0, 3), slice(3, 6), slice(12, 15)


class Loop:
    """States, parameters and signals of all parts; signals may be overruled tick by tick."""

    def __init__(self, machine, values):
        self.machine, self.module = machine, compile_machine(machine)
        self.signals = {s.name: np.zeros(machine.width(s.axis)) for s in machine.signals}
        self.states, self.parameters = {}, {}
        state, at, p_at = np.zeros(sum(sum(machine.part_size(b)) for b in machine.parts)), 0, 0
        self.module.begin(values, state)
        for part in machine.parts:
            size, count = sum(machine.part_size(part)), sum(e.part == part.name for e in machine.parameters)
            self.states[part.name] = state[at : at + size].copy()
            self.parameters[part.name] = values[p_at : p_at + count].copy()
            at, p_at = at + size, p_at + count
            self.hold(part)
        self.direct = [(b, b.outputs[k]) for b, k in feedthrough_order(machine) if b.outputs[k].reads]
        self.routers = [
            [[values[machine.index[f"router.{c}_{side}.{j}"]] for c in "abmn"] for j in machine.axes.joints]
            for side in "fe"
        ]
        self.feed_through({})

    def equation(self, part, function, arguments):
        call = getattr(self.module, f"{part.name}__equation__{function}")
        call(self.states[part.name], self.parameters[part.name], *arguments)

    def output(self, part, output):
        for name, state in zip(output.writes, output.states):
            at = self.machine.state_index(part, state)
            self.signals[name][:] = self.states[part.name][at : at + len(self.signals[name])]
        if not output.states:
            self.equation(part, output.function, [self.signals[n] for n in (*output.reads, *output.writes)])

    def hold(self, part):
        for output in (o for o in part.outputs if not o.reads):
            self.output(part, output)

    def task(self, part, task, own, reads):
        """A task and the signals that follow from the part's state; `reads` of other parts' signals."""
        reads = dict(zip(outer_reads(part, task.reads), reads, strict=True))
        self.equation(part, task.function, (*own, *(reads.get(n, self.signals[n]) for n in task.reads)))
        self.hold(part)

    def feed_through(self, imposed):
        for name, value in imposed.items():
            self.signals[name][:] = value
        for part, output in self.direct:
            self.output(part, output)
            for name in set(output.writes) & set(imposed):
                self.signals[name][:] = imposed[name]

    def tick(self, imposed, forced, posture):
        before = {name: values.copy() for name, values in self.signals.items()}
        for part in self.machine.parts:
            for task in (t for t in part.tasks if not t.slots):
                reads = [before[n] for n in outer_reads(part, task.reads)]
                if part.name == "finger" and forced is not None:
                    reads = [forced[0] / SOFT, forced[1] / SOFT]
                self.task(part, task, [self.machine.slot], reads)
        if posture is not None:
            x = self.states["finger"]
            x[Q], x[RATE], x[TAKEN], self.signals["angle"][:] = posture, 0.0, self.taken(posture), posture
        self.feed_through(imposed)

    def tasks(self, slot, imposed):
        for part in self.machine.parts:
            for task in (t for t in part.tasks if slot in t.slots):
                channel = (task.slots.index(slot),) if task.per_channel else ()
                reads = [self.signals[n] for n in outer_reads(part, task.reads)]
                self.task(part, task, channel, reads)
        self.feed_through(imposed)

    def taken(self, posture):
        """Tendon taken in (3,) [m] in a posture [rad]."""
        flexor, extensor = (
            [wire_paths.path(cos(q), sin(q), *a, sign)[0] for q, a in zip(posture, side, strict=True)]
            for side, sign in zip(self.routers, (wire_paths.FLEXOR, wire_paths.EXTENSOR), strict=True)
        )
        return np.array([sum(flexor), flexor[0], sum(extensor)])


def interpreted(machine, values, inputs, feeds, rates):
    """All signals (n, signals) at the end of each frame; feeds and rates: fixed segment -> (n, 3)."""
    loop, rows = Loop(machine, values), []
    if "tendon" in feeds:
        own = [e.name for e in machine.parameters if e.part == "finger"]
        loop.parameters["finger"][[i for i, name in enumerate(own) if name.startswith("tendon.k.")]] = SOFT
    for frame in range(len(next(iter(inputs.values())))):
        for name, values_now in inputs.items():
            loop.signals[name][:] = values_now[frame]
        for slot in range(machine.slots):
            later = (slot + 0.5) * machine.slot - READ
            now = {s: f[frame] + later * rates[s][frame] for s, f in feeds.items()}
            imposed = {"stroke": now["motor"], "wire_speed": rates["motor"][frame]} if "motor" in now else {}
            if "tendon" in now:
                imposed["tension"] = imposed["tension_spool"] = np.maximum(now["tendon"], 0.0)
            forced = (imposed["tension"], rates["tendon"][frame]) if "tendon" in now else None
            loop.tick(imposed, forced, now.get("finger"))
            loop.tasks(slot, imposed)
        rows.append(np.concatenate([loop.signals[s.name] for s in machine.signals]))
    return np.array(rows)
