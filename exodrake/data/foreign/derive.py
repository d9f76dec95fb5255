"""Columns made from others: continuous readings, zero-phase filters, derivatives, and clocks brought together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import si_unit
from exodrake.data.foreign.mapping import Column, Derived, Sync

ALIKE = 0.1  # relative difference of a frame and a recording's step up to which it has one sample a frame: assumed


@dataclass(frozen=True, eq=False)
class Track:
    """A foreign column with a clock of its own: time (n,) s, values (n,) in the foreign unit."""

    time: np.ndarray
    values: np.ndarray


def median_step(time: np.ndarray) -> float:
    """Median step of a clock (n,) [s]; infinite with a single sample."""
    return float(np.median(np.diff(time))) if len(time) > 1 else float("inf")


def has_one_sample_a_frame(step: float, frame: float) -> bool:
    """Whether a clock of this step [s] has about one sample in each frame [s]."""
    return abs(step / frame - 1.0) < ALIKE


ORDER = 4  # of the Butterworth filter, run forwards and backwards
LEAST = 0.3  # correlation below which two signals tell no delay: assumed
JITTER = 0.05  # of a step by which a clock may vary for a filter: assumed
FINEST = 200_000  # samples on which two signals are compared
RATES = {"rad": "rad/s", "m": "m/s", "N": "N/s", "rad/s": "rad/s2", "m/s": "m/s2", "s": "-"}


def scaled(column: Column, values: np.ndarray) -> np.ndarray:
    """Foreign values (n,) as sign (value * scale + offset), made continuous first [foreign unit]."""
    if column.wrap is not None:
        known = np.isfinite(values)
        values = values.copy()
        values[known] = np.unwrap(values[known], period=column.wrap)
    return column.sign * (values * column.scale + column.offset)


def low_passed(time: np.ndarray, values: np.ndarray, cutoff: float, where: str) -> np.ndarray:
    """Values (n,) through a zero-phase Butterworth low-pass; a missing sample stays missing.

    Args:
        time: (n,) [s], evenly spaced.
        values: (n,) in any unit.
        cutoff: where the amplitude falls to a half [Hz], since the filter runs both ways.
        where: column, for messages.

    Raises:
        InputError: for a clock that is not even, a cut-off that it cannot hold, and too few samples.
    """
    from scipy.signal import butter, sosfiltfilt

    steps, known = np.diff(time), np.isfinite(values)
    if len(time) < 8 * ORDER or known.sum() < 2:
        raise InputError(f"{where}: {int(known.sum())} samples, too few for a filter")
    step = float(np.median(steps))
    if np.abs(steps - step).max() > JITTER * step:
        raise InputError(f"{where}: a filter wants an even clock; put the rows on frames with `period`")
    if cutoff >= 0.5 / step:
        raise InputError(f"{where}: filter: {cutoff:g} Hz, wanted below half the sampling rate, {0.5 / step:g} Hz")
    if cutoff * (time[-1] - time[0]) < 1.0:
        slowest = 1.0 / (time[-1] - time[0])
        raise InputError(f"{where}: filter: {cutoff:g} Hz, wanted above one period in the log, {slowest:.3g} Hz")
    filled = np.interp(time, time[known], values[known])
    sections = butter(ORDER, 2.0 * step * cutoff, output="sos")
    return np.where(known, sosfiltfilt(sections, filled), np.nan)


def derived(column: Derived, time: np.ndarray, values: Mapping[str, np.ndarray], units: Mapping[str, str], source: str):
    """Values (n,) [SI] of a derived column, and its unit."""
    found, unit = values[column.of], units[column.of]
    if column.minus:
        if units[column.minus] != unit:
            raise InputError(
                f"{source}: {column.name}: {column.of} is in {unit}, {column.minus} in {units[column.minus]}"
            )
        found = found - values[column.minus]
    if column.take == "first":
        known = found[np.isfinite(found)]
        if not len(known):
            raise InputError(f"{source}: {column.name}: {column.of} is empty")
        found = np.full(len(found), known[0])
    if column.filter is not None:
        found = low_passed(time, found, column.filter, f"{source}: {column.name}")
    if column.take == "rate":
        if len(time) < 3:
            raise InputError(f"{source}: {column.name}: {len(time)} rows, too few for a derivative")
        found, unit = np.gradient(found, time), RATES.get(unit, "")
    unit = si_unit(column.unit) if column.unit else unit
    if not unit:
        raise InputError(f"{source}: {column.name}: state its SI unit, `unit: ...`")
    return found * column.scale + column.offset, unit


def lag_of(moved: Track, fixed: Track, within: float, where: str) -> tuple[float, float]:
    """Lag of one signal behind another [s] and their correlation at that lag, by the largest cross-correlation.

    Each lag is judged on the same stretch of the fixed signal, by the correlation coefficient.

    Args:
        moved: signal that may be late.
        fixed: signal whose clock counts.
        within: largest lag either way [s].
        where: names both, for messages.

    Raises:
        InputError: if they do not overlap, do not move, or are not alike at any lag.
    """
    from scipy.signal import correlate

    a, b = known(moved), known(fixed)
    step = min(median_step(t.time) for t in (a, b))
    start = max(a.time[0] + within, b.time[0]) if len(a.time) and len(b.time) else np.inf
    end = min(a.time[-1] - within, b.time[-1]) if start < np.inf else -np.inf
    if not (step < np.inf and end - start > 2.0 * within):
        raise InputError(f"{where}: they overlap too little to be compared within {within:g} s")
    step = max(step, (end - start) / FINEST)
    reach = max(int(within / step), 1)
    times = start + step * np.arange(int((end - start) / step))
    wide = start + step * np.arange(-reach, len(times) + reach)
    late, here = np.interp(wide, a.time, a.values), np.interp(times, b.time, b.values)
    late, here = late - late.mean(), here - here.mean()
    ones = np.ones(len(here))
    sums, squares = (correlate(x, ones, mode="valid", method="fft") for x in (late, late**2))
    spread = np.sqrt(np.maximum(squares - sums**2 / len(here), 0.0)) * np.linalg.norm(here)
    if not spread.min() > 1e-9 * max(spread.max(), np.linalg.norm(here) ** 2 * 1e-9):
        raise InputError(f"{where}: one of them does not move")
    course = np.abs(correlate(late, here, mode="valid", method="fft")) / spread
    at = int(course.argmax())
    if course[at] < LEAST:
        raise InputError(f"{where}: correlation {course[at]:.2f} at best, so the lag is unknown")
    return (at + vertex(course, at) - reach) * step, float(course[at])


def vertex(course: np.ndarray, at: int) -> float:
    """Distance of a parabola's vertex from the largest sample of `course` (n,) [-] that it passes through."""
    if not 0 < at < len(course) - 1:
        return 0.0
    before, top, after = course[at - 1 : at + 2]
    bend = before - 2.0 * top + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def known(track: Track) -> Track:
    """The samples of a track that are there, in order of time."""
    order = np.argsort(track.time, kind="stable")
    order = order[np.isfinite(track.values[order])]
    return Track(track.time[order], track.values[order])


def synchronised(
    tracks: dict[str, Track], entries: tuple[Sync, ...], source: str
) -> tuple[dict[str, Track], list[str]]:
    """Tracks with the columns of each entry moved in time, and a note on each.

    InputError as `lag_of`.
    """
    moved, notes = dict(tracks), []
    for entry in entries:
        where = f"{source}: sync of {entry.by} with {entry.to}"
        lag, correlation = lag_of(moved[entry.by], moved[entry.to], entry.within, where)
        for name in entry.columns:
            moved[name] = Track(moved[name].time - lag, moved[name].values)
        names, shift = ", ".join(entry.columns), f"{-1e3 * lag:+.3g} ms"
        notes.append(
            f"{names}: moved by {shift} to fit {entry.to} (correlation {correlation:.3f}), so a delay between them, "
            "of a clock or real, is gone"
        )
    return moved, notes


def note_of(column: Column | Derived) -> str | None:
    """Note on the conversions of a column beyond its unit, in one sentence; None for none."""
    done = []
    if isinstance(column, Derived) and column.take != "first":
        minus = f" minus {column.minus}" if column.minus else ""
        word = "the derivative of " if column.take else ""
        done.append(f"{word}{column.of}{minus}")
    elif isinstance(column, Column) and column.wrap is not None:
        done.append(f"made continuous where readings start again after {column.wrap:g}")
    if getattr(column, "sign", 1.0) < 0.0:
        done.append("sign turned")
    if column.filter is not None:
        done.append(f"low-passed at {column.filter:g} Hz without phase, so its fast noise is not the sensor's")
    return f"{column.name}: {', '.join(done)}" if done else None
