"""The machine as an interpreted loop over its leaf functions, whose wires can be overruled tick by tick."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.leaf_functions import held_signals, outer_reads
from exodrake.core.machine import Machine
from exodrake.core.part import Part
from exodrake.core.wiring import feedthrough_order
from exodrake.systems import routers
from exodrake.systems.tendon_finger import RATE, TAKEN, Q

SOFT = 1e-3  # N/m: a wire this soft is a source of force


class Loop:
    """The machine as an interpreted loop over its leaf functions, whose wires can be overruled tick by tick."""

    def __init__(self, machine: Machine, values: np.ndarray) -> None:
        self.machine, self.module = machine, compile_machine(machine)
        self.signals = {w.name: np.zeros(machine.width(w.axis)) for w in machine.signals}
        self.states, self.parameters = {}, {}
        state, at, p_at = np.zeros(sum(sum(machine.part_size(b)) for b in machine.parts)), 0, 0
        self.tasks_of = {
            (b.name, t.function): (getattr(self.module, f"{b.name}__leaf__{t.function}"), outer_reads(b, t.reads))
            for b in machine.parts
            for t in b.tasks
        }
        self.held = {b.name: [self.signals[n] for n in held_signals(b)] for b in machine.parts}
        self.module.begin(values, state)
        for part in machine.parts:
            size, count = sum(machine.part_size(part)), sum(e.part == part.name for e in machine.parameters)
            self.states[part.name], self.parameters[part.name] = (
                state[at : at + size].copy(),
                values[p_at : p_at + count].copy(),
            )
            at, p_at = at + size, p_at + count
            held = getattr(self.module, f"{part.name}__leaf__hold")
            held(self.states[part.name], *self.held[part.name], self.parameters[part.name])
        self.direct = [(b, b.outputs[k]) for b, k in feedthrough_order(machine) if b.outputs[k].reads]
        self.routing = routing(machine, values)
        self.pass_through({})

    def call(self, part: Part, function: str, own: tuple = (), reads: tuple = ()) -> None:
        """A task of a part: its own wires follow from its state."""
        parameter, _ = self.tasks_of[part.name, function]
        parameter(self.states[part.name], *self.held[part.name], self.parameters[part.name], *own, *reads)

    def reads(self, part: Part, function: str) -> tuple[str, ...]:
        """Wires from other parts that a task reads."""
        return self.tasks_of[part.name, function][1]

    def pass_through(self, imposed: dict[str, np.ndarray]) -> None:
        """Imposed wires take their values, then wires of direct feedthrough follow."""
        for name, value in imposed.items():
            self.signals[name][:] = value
        for part, output in self.direct:
            parameter = getattr(self.module, f"{part.name}__leaf__{output.function}")
            parameter(
                self.states[part.name],
                self.parameters[part.name],
                *(self.signals[n] for n in (*output.reads, *output.writes)),
            )
            for name in set(output.writes) & set(imposed):
                self.signals[name][:] = imposed[name]

    def tasks(self, slot: int, imposed: dict[str, np.ndarray]) -> None:
        """The sampled tasks of a slot."""
        for part in self.machine.parts:
            for task in part.tasks:
                if slot in task.slots:
                    channel = (task.slots.index(slot),) if task.per_channel else ()
                    self.call(
                        part, task.function, channel, tuple(self.signals[n] for n in self.reads(part, task.function))
                    )
        self.pass_through(imposed)

    def tick(
        self,
        dt: float,
        imposed: dict[str, np.ndarray],
        forced: tuple[np.ndarray, np.ndarray] | None,
        held: np.ndarray | None,
    ) -> None:
        """One plant tick; `forced`: tension [N] and its rate [N/s] on the finger; `held`: joint angles [rad] put in
        place of its own.
        """
        before = {name: values.copy() for name, values in self.signals.items()}
        for part in self.machine.parts:
            for task in part.tasks:
                if task.slots:
                    continue
                reads = tuple(before[n] for n in self.reads(part, task.function))
                if part.name == "finger" and forced is not None:
                    reads = (forced[0] / SOFT, forced[1] / SOFT)
                self.call(part, task.function, (dt,), reads)
        if held is not None:
            self.hold(held)
        self.pass_through(imposed)

    def hold(self, angle: np.ndarray) -> None:
        """Puts the finger into a posture, at rest."""
        x = self.states["finger"]
        x[Q : Q + 3], x[RATE : RATE + 3], self.signals["angle"][:] = angle, 0.0, angle
        x[TAKEN : TAKEN + 3] = taken_in(self.routing, angle)

    def soften(self) -> None:
        """Makes the finger's wires so soft that a stroke is a force."""
        for place, parameter in enumerate(e for e in self.machine.parameters if e.part == "finger"):
            if parameter.name.startswith("tendon.k."):
                self.parameters["finger"][place] = SOFT


def routing(machine: Machine, values: np.ndarray) -> list[list[tuple[float, ...]]]:
    """a, b, m, n [m] of the routers, flexor side and extensor side, joint by joint; nothing of a machine without
    routers.
    """
    return [
        [
            tuple(values[machine.index[f"router.{letter}_{side}.{joint}"]] for letter in "abmn")
            for joint in machine.axes.joints
        ]
        for side in "fe"
        if f"router.a_{side}.{machine.axes.joints[0]}" in machine.index
    ]


def taken_in(sides: list[list[tuple[float, ...]]], angle: np.ndarray) -> np.ndarray:
    """Wire taken in by the finger in a posture (3,) [m]."""
    turned = [(cos(q), sin(q)) for q in angle]
    flexor, extensor = (
        [routers.path(c, s, a, b, m, n, sign)[0] for (c, s), (a, b, m, n) in zip(turned, side, strict=True)]
        for side, sign in zip(sides, (routers.FLEXOR, routers.EXTENSOR), strict=True)
    )
    return np.array([sum(flexor), flexor[0], sum(extensor)])
