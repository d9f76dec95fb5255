"""Ranges and histograms of the variables of laws in the logs of a case, by states of the simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows
from exodrake.core.machine import Machine, signal_count, state_size
from exodrake.core.threads import side_by_side
from exodrake.diagnosis.discovery.effect_text import COUNTS
from exodrake.diagnosis.discovery.forms import LawPoint
from exodrake.diagnosis.problem import Problem, Trial


@dataclass(frozen=True, eq=False)
class Seen:
    """Range of a variable in the simulated logs: `low`, `high` (channels,) [its unit]."""

    low: np.ndarray
    high: np.ndarray

    @property
    def span(self) -> np.ndarray:
        """Widths (channels,) of the ranges."""
        return self.high - self.low


def state_places(machine: Machine, identity: str) -> dict[str, np.ndarray]:
    """Indices (channels,) of each state of an effect in the flat state."""
    at = 0
    for part in machine.parts:
        at += machine.part_size(part)[0]
        for effect in machine.effects_on(part):
            found = {}
            for state in effect.states:
                width = machine.width(state.axis)
                found[state.name] = np.arange(at, at + width)
                at += width * state.width
            if effect.id == identity:
                return found
    raise KeyError(identity)


def places(machine: Machine, identity: str, name: str) -> list[int]:
    """Indices (channels,) of a parameter of an effect in the flat parameter vector."""
    return list(machine.effect_indices(identity, name).values())


def end_state(problem: Problem, values: np.ndarray, trial: Trial) -> np.ndarray:
    """Flat state at the end of a trial that a robot runs in closed loop, without noise."""
    machine = problem.robot.machine
    module, n = compile_machine(machine), len(trial.reference)
    state, w = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
    noise = NoiseInputs.draw(n, None, machine)
    noise |= {name: given[:n] for name, given in trial.latent.items()}
    module.begin(values, state)
    rows = np.zeros((n, len(w)))
    given = input_rows(machine, trial.reference, noise).values()
    module.run(values, state, w, *given, machine.slot, 1, rows, NOTHING, NOTHING)
    return state


def end_states(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Flat states (trials, n) at the ends of all fitted trials."""
    return np.array(side_by_side([partial(end_state, problem, values, trial) for trial in problem.fit]))


def watched(problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]) -> dict[tuple[str, int], Seen]:
    """Range of the variable of each form of each law, and scale of the law (one number above all forms).

    Args:
        problem: the case, its robot on a machine with laws and watches.
        values: (parameters,) flat vector of the robot that runs.
        laws: points.

    Returns:
        The range of each variable that is ever computed.
    """
    found, machine = {}, problem.robot.machine
    for k in range(1, max(len(law.forms) for law in laws) + 2):
        here = [law for law in laws if k <= len(law.forms) + 1]
        row = values.copy()
        for law in here:
            row[places(machine, f"{law.identity}_watch", "form")] = k
        states = end_states(problem, row)
        for law in here:
            at = state_places(machine, f"{law.identity}_watch")
            low, high = states[:, at["low_seen"]].min(axis=0), states[:, at["high_seen"]].max(axis=0)
            if np.any(states[:, at["started"]]):
                found[law.identity, k] = Seen(low, np.where(high > low, high, low + 1e-9))
    return found


def counted(problem: Problem, values: np.ndarray, law: LawPoint, form: int, seen: Seen) -> np.ndarray:
    """Histogram (channels, bins) of the variable of a form over its range; arguments as `watched` has."""
    machine, row = problem.robot.machine, values.copy()
    for name, value in (("form", form), ("low", seen.low), ("high", seen.high)):
        row[places(machine, f"{law.identity}_watch", name)] = value
    at = state_places(machine, f"{law.identity}_watch")
    states = end_states(problem, row)
    return np.array([states[:, at[c]].sum(axis=0) for c in COUNTS]).T
