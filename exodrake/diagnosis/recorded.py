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


def measure_sizes(machine: Machine, case: Case) -> dict[str, float]:
    """Largest value of the recorded signals by unit [SI]: travel of lengths and angles, size of efforts and rates."""
    found: dict[str, float] = {}
    names: dict[str, list[str]] = {}
    for column in machine.columns:
        unit, own = column.unit or machine.signal[column.signal].unit, machine.log_names([column])
        names.setdefault(unit, []).extend(name for name in own if "start" not in name)
        for values in (item.log[name] for item in case.fit_logs for name in own if item.log.has(name)):
            travel = unit in ("rad", "m") and np.isfinite(values).any()
            size = np.nanmax(values) - np.nanmin(values) if travel else np.nanmax(np.abs(values), initial=0)
            found[unit] = max(found.get(unit, 0.0), float(size))
            if travel:
                rate = float(np.nanmax(np.abs(np.diff(values)), initial=0.0) / machine.frame)
                found[f"{unit}/s"] = max(found.get(f"{unit}/s", 0.0), rate)
    for force in ("N m", "N"):
        for per in ("rad", "m"):
            if found.get(force) and found.get(per):
                logs = [i.log[n] for i in case.fit_logs for n in names[per] if i.log.has(n)]
                rates = [np.diff(values) / machine.frame for values in logs]
                speed = np.concatenate([rate[np.isfinite(rate)] for rate in rates] or [np.zeros(1)]) + 1e-12
                found[f"{force}/{per}"] = found[force] / found[per]
                found[f"{force} s/{per}"] = found[force] / np.sqrt(np.mean(speed**2))
    return found


def widen(parameter: EffectParameter, size: float) -> EffectParameter:
    """A parameter whose range reaches as far as a recorded size [unit]."""
    if parameter.transform != "linear" or parameter.null != 0.0 or not 0.0 < parameter.high < size:
        return parameter
    factor = size / parameter.high
    low = parameter.low if parameter.low > 0.0 else parameter.low * factor
    default = None if parameter.default is None else parameter.default * factor
    return replace(parameter, high=size, low=low, default=default)


def with_recorded_ranges(robot: Robot, case: Case) -> Robot:
    """The robot whose generic effects may be as large as the recording shows, and its numbers of rest as small.

    An effect is generic if it is a law of any signal, slide or servo, so that its range is only assumed.
    """
    machine, size, values = robot.machine, measure_sizes(robot.machine, case), robot.values.copy()
    for name, largest in machine.recorded.items():
        values[machine.index[name]] = min(values[machine.index[name]], largest(size))
    laws = {id(f) for e in LIBRARY.values() if e.block in GENERIC for f in e.at.values()}

    def widen_generic(effect: Effect) -> Effect:
        if not all(id(function) in laws for function in effect.at.values()):
            return effect
        lead, *rest = effect.parameters
        return replace(effect, parameters=(widen(lead, size.get(lead.unit, 0.0)), *rest))

    return replace(robot, values=values, machine=replace(machine, effects=tuple(map(widen_generic, machine.effects))))
