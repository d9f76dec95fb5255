"""Two logs beside each other: the difference of each signal that both have.

found = compare(read_log("robot.csv"), read_log("model.csv"))
found.signals["angle_PIP"].rms                    # rad
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError, argument
from exodrake.core.machine import Machine
from exodrake.core.text import short_repr
from exodrake.core.units import kind_of
from exodrake.data.log import Log
from exodrake.data.plot import display_in, kinds_of

ALIKE = 1e-6  # s, clocks closer than this are the same


@dataclass(frozen=True)
class Difference:
    """Second log less first in one signal.

    Attributes:
        unit: of the figures, SI.
        rms, mean: over the samples that both have [unit].
        largest: largest magnitude [unit].
        at: when that was [s].
        samples: how many both have.
    """

    unit: str
    rms: float
    mean: float
    largest: float
    at: float
    samples: int


@short_repr
@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two logs.

    Attributes:
        names: names of both logs.
        start: start of the time that both cover [s].
        end: end of the time that both cover [s].
        signals: column -> difference.
        notes: what was left out, a sentence each.
    """

    names: tuple[str, str]
    start: float
    end: float
    signals: dict[str, Difference]
    notes: tuple[str, ...] = ()


def compare(first: Log, second: Log) -> Comparison:
    """Compare two logs in the columns and over the time that both have.

    Args:
        first: whose clock counts.
        second: read between its samples where its clock differs.

    Raises:
        InputError: if they have no column or no time in common.
    """
    first, second = argument("first", first, Log), argument("second", second, Log)
    common = [name for name in first.columns if name in second.signals]
    start, end = max(first.time[0], second.time[0]), min(first.time[-1], second.time[-1])
    inside = (first.time >= start - ALIKE) & (first.time <= end + ALIKE)
    if not common or not inside.any():
        lack = "column" if not common else "time"
        raise InputError(f"{first.label} and {second.label}: no {lack} in common, so there is nothing to compare")
    notes = [
        f"{', '.join(alone)} only in {one.label}"
        for one, other in ((first, second), (second, first))
        if (alone := [name for name in one.columns if name not in other.signals])
    ]
    if not inside.all() or second.time[0] < start - ALIKE or second.time[-1] > end + ALIKE:
        notes.append(f"compared from {start:g} to {end:g} s, which both cover")
    time, found = first.time[inside], {}
    for name in common:
        if first.units[name] != second.units[name]:
            notes.append(f"{name} is in [{first.units[name]}] and in [{second.units[name]}], and left out")
            continue
        error = sampled(second, name, time) - first[name][inside]
        known = np.flatnonzero(np.isfinite(error))
        if not len(known):
            notes.append(f"{name} has no sample that both have")
            continue
        worst = known[np.abs(error[known]).argmax()]
        rms, mean = float(np.sqrt(np.mean(error[known] ** 2))), float(error[known].mean())
        found[name] = Difference(first.units[name], rms, mean, float(abs(error[worst])), float(time[worst]), len(known))
    return Comparison((first.label, second.label), float(start), float(end), found, tuple(notes))


def sampled(log: Log, name: str, time: np.ndarray) -> np.ndarray:
    """A column (n,) [its unit] at times (n,) [s]: its samples where the clocks agree, else linear between them."""
    if len(log) == len(time) and np.abs(log.time - time).max() <= ALIKE:
        return log[name]
    return np.interp(time, log.time, log[name])


def remarks(found: Comparison, log: Log, machine: Machine | None = None) -> dict[str, str]:
    """RMS differences of each kind of column in words, for the panels of `plot_log`."""
    said = {}
    for kind in kinds_of(log, machine):
        display = display_in(log, kind, machine)
        values = {n: found.signals[f"{kind}_{n}"] for n in log.names(kind) if f"{kind}_{n}" in found.signals}
        if values and kind_of(f"{kind}_x") == kind:
            listed = ", ".join(f"{name} {display.factor * one.rms:.3g}" for name, one in values.items())
            said[kind] = f"RMS difference: {listed} {display.symbol}".rstrip()
    return said
