"""What the recording tells that an owner's robot file can only assume: how large effects may be, and the noise.

Ranges of generic effects follow from a typical motion (`Part.scales`). A recording knows better: friction is no larger
than the largest effort, play no larger than the travel. Ranges are only widened.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.effects import LIBRARY

GENERIC = ("signal", "sliding", "joint")  # blocks of the library whose laws serve any machine


def sizes(machine: Machine, case: Case) -> dict[str, float]:
    """Largest value of the recorded signals by unit [SI]: travel of lengths and angles, size of efforts and rates."""
    found: dict[str, float] = {}
    for column in machine.columns:
        signal = machine.signal[column.signal]
        unit, names = column.unit or signal.unit, machine.log_names([column])
        for values in (item.log[name] for item in case.fit_logs for name in names if item.log.has(name)):
            travel = unit in ("rad", "m") and np.isfinite(values).any()
            size = (
                float(np.nanmax(values) - np.nanmin(values)) if travel else float(np.nanmax(np.abs(values), initial=0))
            )
            found[unit] = max(found.get(unit, 0.0), size)
            if travel:
                rate = np.nanmax(np.abs(np.diff(values)), initial=0.0) / machine.frame
                found[f"{unit}/s"] = max(found.get(f"{unit}/s", 0.0), float(rate))
    for force in ("N m", "N"):
        for per in ("rad", "m"):
            if found.get(force) and found.get(per):
                found[f"{force}/{per}"] = found[force] / found[per]
                found[f"{force} s/{per}"] = found[force] / np.sqrt(np.mean(rates(machine, case, per) ** 2))
    return found


def rates(machine: Machine, case: Case, unit: str) -> np.ndarray:
    """Rates of change (n,) of the recorded signals of a unit [unit/s]."""
    columns = [c for c in machine.columns if (c.unit or machine.signal[c.signal].unit) == unit]
    names = [name for name in machine.log_names(columns) if "start" not in name]
    found = [np.diff(i.log[n]) / machine.frame for i in case.fit_logs for n in names if i.log.has(n)]
    return np.concatenate([r[np.isfinite(r)] for r in found] or [np.zeros(1)]) + 1e-12


def is_generic(effect: Effect) -> bool:
    """Whether an effect is a law of any signal, slide or servo, so that its range is only assumed."""
    laws = {id(f) for e in LIBRARY.values() if e.block in GENERIC for f in e.at.values()}
    return all(id(function) in laws for function in effect.at.values())


def widened(parameter: EffectParameter, size: float) -> EffectParameter:
    """A parameter whose range reaches as far as a recorded size [unit]."""
    if parameter.transform != "linear" or parameter.null != 0.0 or not 0.0 < parameter.high < size:
        return parameter
    factor = size / parameter.high
    low = parameter.low if parameter.low > 0.0 else parameter.low * factor
    return replace(
        parameter, high=size, low=low, default=None if parameter.default is None else parameter.default * factor
    )


def with_recorded_ranges(robot: Robot, case: Case) -> Robot:
    """The robot whose generic effects may be as large as the recording shows, and its numbers of rest as small."""
    machine, size = robot.machine, sizes(robot.machine, case)
    values = robot.values.copy()
    for name, largest in machine.recorded.items():
        values[machine.index[name]] = min(values[machine.index[name]], largest(size))

    def adapted(effect: Effect) -> Effect:
        if not is_generic(effect):
            return effect
        lead, *rest = effect.parameters
        return replace(effect, parameters=(widened(lead, size.get(lead.unit, 0.0)), *rest))

    return replace(robot, values=values, machine=replace(machine, effects=tuple(map(adapted, machine.effects))))
