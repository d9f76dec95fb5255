"""What the recording tells that an owner's robot file can only assume: how large effects may be, and the noise.

Ranges of generic effects follow from a typical motion (`Part.scales`). A recording knows better: friction is no larger
than the largest effort, play no larger than the travel. Ranges are only widened.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from exodrake.data.case import Case
from exodrake.effects import LIBRARY
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot

GENERIC = ("signal", "sliding", "joint")  # blocks of the library whose laws serve any machine


def measure_sizes(machine: Machine, case: Case) -> dict[str, float]:
    """Largest value of the recorded signals by unit [SI]: travel of lengths and angles, size of efforts and rates."""
    found, signals = dict[str, float](), dict[str, list[np.ndarray]]()
    for column in machine.columns:
        names = [name for name in machine.log_names([column]) if "start" not in name]
        recorded = (item.log[name] for item in case.fit_logs for name in names if item.log.has(name))
        unit = column.unit or machine.signal[column.signal].unit
        signals.setdefault(unit, []).extend(values for values in recorded if np.isfinite(values).any())
    for unit, recorded in signals.items():
        travel = unit in ("rad", "m")
        sizes = [np.nanmax(values) - np.nanmin(values) if travel else np.nanmax(np.abs(values)) for values in recorded]
        found[unit] = max(found.get(unit, 0.0), *map(float, sizes), 0.0)
        rates = [np.nanmax(np.abs(np.diff(values)), initial=0.0) / machine.frame for values in recorded if travel]
        if rates:
            found[f"{unit}/s"] = max(found.get(f"{unit}/s", 0.0), *map(float, rates))
        elif sizes:
            found[f"{unit}/s"] = found[unit] / (machine.frame * max(map(len, recorded)))
    for force, per in product(("N m", "N"), ("rad", "m")):
        if found.get(force) and found.get(per):
            rates = [np.diff(values) / machine.frame for values in signals[per]]
            speed = np.concatenate([rate[np.isfinite(rate)] for rate in rates]) + 1e-12
            found[f"{force}/{per}"] = found[force] / found[per]
            found[f"{force} s/{per}"] = found[force] / np.sqrt(np.mean(speed**2))
    return found


def with_recorded_ranges(robot: Robot, case: Case) -> Robot:
    """The robot whose generic effects may be as large as the recording shows, and its numbers of rest as small.

    An effect is generic if it is a law of any signal, slide or servo whose range the library does not state for it, so
    that this is only assumed.
    """
    machine, size, values = robot.machine, measure_sizes(robot.machine, case), robot.values.copy()
    for name, largest in machine.recorded.items():
        values[machine.index[name]] = min(values[machine.index[name]], largest(size))
    laws, effects = {id(f) for e in LIBRARY.values() if e.block in GENERIC for f in e.at.values()}, []
    for effect in machine.effects:
        first, *others = effect.parameters
        reach, stated = size.get(first.unit, 0.0), LIBRARY.get(effect.id)
        generic = {id(function) for function in effect.at.values()} <= laws
        short = first.transform == "linear" and first.null == 0.0 and 0.0 < first.high < reach
        if generic and not (stated and stated.parameters == effect.parameters) and short:
            factor = reach / first.high
            default = None if first.default is None else first.default * factor
            low = first.low if first.low > 0.0 else first.low * factor
            effect = replace(effect, parameters=(replace(first, high=reach, low=low, default=default), *others))
        effects.append(effect)
    widened = machine if tuple(effects) == machine.effects else replace(machine, effects=tuple(effects))
    return replace(robot, values=values, machine=widened)
