"""A log: time and named columns in SI, measured and simulated alike. A missing sample is NaN.

A column's name is `kind_name`: `tension_AF` is the tension of tendon AF, `angle_PIP` the angle of joint PIP. A fault of
a recorded clock is mended by `regularise` where the answer is certain, and refused by name where it is not.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from exodrake.core.errors import InputError, MissingColumn, argument, nearest, require_extra
from exodrake.model.units import KINDS, check_unit, default_unit, find_kind, to_si

MODEL, CHANGED = 1, 2  # robots by which exodrake simulated a log: as its file states it; changed for the run
LARGEST = 1e12  # in SI: beyond any signal of a robot, and the square of a sum of squares is still finite
MAX_SAMPLES = 20_000_000  # assumed: an hour of 100 columns at 50 Hz
MAX_COLUMNS = 20_000  # assumed: a hundred times the widest recording
SHOWN = 60  # characters of a list of columns in a `repr`
LONGEST = 100  # rows to fill per row recorded; beyond, a clock has jumped or its unit is wrong
SMALLER = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}  # units that a clock may count in
RATE = 3e-3  # by which a clock may run fast or slow: assumed; those of computers keep to a tenth of it
STRETCH = 250  # rows over which a rate is measured; the shortest, so that jitter of a third of a frame is none
ALIKE = 1e-6  # s, clocks closer than this are the same
EXACT = 1e-6  # s; frame times closer to the grid than this are on it (files often round time to microseconds)
ORDER = 4  # differences that leave noise of what moves slowly (assumed)
ROBUST = 1.4826  # standard deviation of a normal law over its median absolute deviation
LIMIT = 3.0  # standard deviations at which deviations are clipped; efficiency of 0.99 for a normal law
WITHIN = 0.995  # variance of a normal law that is clipped so, over its variance
STEPS = 5  # of the iteration, which leave an error of 1e-5 where rounding is half of the noise


@dataclass(frozen=True, eq=False)
class Log:
    """Columns on a common clock.

    Attributes:
        time: (n,) instants of the samples [s].
        signals: column name -> (n,) float64 in SI, NaN where a sample is missing.
        units: column name -> SI unit; columns left out get the unit of their kind.
        source: file the log came from, or "".
        simulated: 0, or by which kind of robot exodrake simulated it (`MODEL`, `CHANGED`).

    Raises:
        InputError: for a column of another length than time, or a unit that does not suit its kind.

    Examples:
        >>> import numpy as np
        >>> Log(0.02 * np.arange(3), {"angle_MCP": np.zeros(3)})
        Log(log: 3 rows, 0 to 0.04 s; angle)
    """

    time: np.ndarray
    signals: dict[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)
    source: str = ""
    simulated: int = 0

    def __post_init__(self) -> None:
        time = _vector(self.time, "time", self.source)
        signals = {name: _vector(values, name, self.source) for name, values in self.signals.items()}
        for name, values in signals.items():
            if values.shape != time.shape:
                raise InputError(f"{self.label}: column {name!r} has {len(values)} samples, time has {len(time)}")
        units = {name: self.units[name] if name in self.units else default_unit(name) for name in signals}
        units = {name: check_unit(name, unit, f"{self.label}, column {name!r}") for name, unit in units.items()}
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "signals", signals)
        object.__setattr__(self, "units", units)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, column: str) -> np.ndarray:
        """One column (n,), or all of a kind (n, channels) in file order, such as `log["tension"]` [SI].

        InputError naming the column and the file when the log has none such.
        """
        if column == "time":
            return self.time
        if column in self.signals:
            return self.signals[column]
        return self.array(column)

    def __repr__(self) -> str:
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self) else "empty"
        listed = shorten(", ".join(self.kinds or self.columns), SHOWN, placeholder=" ...")
        return f"Log({self.label}: {len(self)} rows, {span}; {listed})"

    @property
    def label(self) -> str:
        """The source, or `log` when there is none: what messages call this log."""
        return self.source or "log"

    @property
    def nominal(self) -> bool:
        """Whether exodrake simulated it by a robot as its file states it."""
        return self.simulated == MODEL

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns but time, in file order."""
        return tuple(self.signals)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Known kinds present, in file order."""
        return tuple(dict.fromkeys(kind for kind in map(find_kind, self.signals) if kind))

    @property
    def dt(self) -> float:
        """Median step of the clock [s]. InputError for a log of fewer than two rows."""
        if len(self) < 2:
            raise InputError(f"{self.label}: {len(self)} rows, two are needed for a time step")
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """From the start of the first row to the end of the last [s]."""
        return float(self.time[-1] - self.time[0]) + self.dt

    def has(self, name: str) -> bool:
        """True if there is a column of this name, or any column of this kind."""
        return name in self.signals or bool(self.names(name))

    def names(self, kind: str) -> tuple[str, ...]:
        """Channels with this kind of column, in file order; `tension_ref_AF` is no `tension` of a channel `ref_AF`."""
        own = (column for column in self.signals if column.startswith(kind + "_"))
        return tuple(column[len(kind) + 1 :] for column in own if len(find_kind(column) or "") <= len(kind))

    def array(self, kind: str, names: Sequence[str] | None = None) -> np.ndarray:
        """Columns of one kind (n, len(names)) [SI]; all of them in file order if no names are given.

        InputError naming the column that is missing.
        """
        chosen = self.names(kind) if names is None else tuple(names)
        if not chosen:
            near, known = nearest(kind, list(self.signals)), ", ".join(self.signals)
            raise InputError(f"{self.label}: no column {kind!r}{near or f' (it has {known or "none"})'}")
        return np.column_stack([self[f"{kind}_{name}"] for name in chosen])

    def rows(self, which: slice | np.ndarray) -> Log:
        """Select rows by a slice, a mask (n,) [-] or indices."""
        picked = {name: values[which] for name, values in self.signals.items()}
        return replace(self, time=self.time[which], signals=picked)

    def between(self, start: float, end: float) -> Log:
        """Rows with start <= time < end [s], so that neighbouring spans share no row. The clock is not shifted."""
        return self.rows((self.time >= start) & (self.time < end))

    def only(self, columns: Iterable[str]) -> Log:
        """The log of these columns, in this order. InputError naming one it lacks."""
        chosen = {name: self[name] for name in columns}
        return replace(self, signals=chosen, units={name: self.units[name] for name in chosen})

    def with_signals(self, signals: Mapping[str, ArrayLike], units: Mapping[str, str] | None = None) -> Log:
        """A new log with columns added or replaced, (n,) each. An unknown kind needs its SI unit in `units`."""
        added = {name: np.asarray(values, dtype=float) for name, values in signals.items()}
        return replace(self, signals=self.signals | added, units=self.units | dict(units or {}))

    def with_array(self, kind: str, names: Sequence[str], values: np.ndarray) -> Log:
        """Add columns `kind_name` from values (n, len(names)) [SI]: the inverse of `array`."""
        if np.shape(values) != (len(self), len(names)):
            raise InputError(f"{kind}: array of shape {np.shape(values)}, wanted {(len(self), len(names))}")
        return self.with_signals({f"{kind}_{name}": values[:, i] for i, name in enumerate(names)})

    def equals(self, other: Log) -> bool:
        """True if clock, columns, order, units and every sample are the same to the last bit (NaN equals NaN)."""
        alike = self.columns == other.columns and self.units == other.units
        return alike and all(np.array_equal(self[n], other[n], equal_nan=True) for n in ("time", *self.columns))

    def to_pandas(self) -> Any:
        """The log as a DataFrame indexed by time [s]; `attrs` hold units and source. InputError without pandas."""
        with require_extra("pandas is not installed; pip install exodrake[pandas]"):
            import pandas  # pyright: ignore
        frame = pandas.DataFrame(dict(self.signals), index=pandas.Index(self.time, name="time"))
        frame.attrs = {"units": dict(self.units), "source": self.source}
        return frame

    @staticmethod
    def from_pandas(frame: Any, units: Mapping[str, str] | None = None, source: str = "") -> Log:
        """A log from a DataFrame.

        Args:
            frame: a column a signal, named `tension_AF` or `tension_AF [N]`; time [s] in a column `time`, or as index.
            units: of columns without one, such as `mm`; else those of `frame.attrs`, else SI by the kind.
            source: name for messages; else that of `frame.attrs`.
        """
        source = source or str(frame.attrs.get("source", "")) or "frame"
        columns = [(str(name), _vector(values, str(name), source)) for name, values in frame.items()]
        if not any(name.partition("[")[0].strip() == "time" for name, _ in columns):
            columns.insert(0, ("time", _vector(frame.index, "time", source)))
        log = log_from_columns(columns, source, {**frame.attrs.get("units", {}), **(units or {})})
        check_clock(log)
        return log

    def plot(self, *args: Any, **options: Any) -> Any:
        """Draw the log, a panel a kind: `exodrake.data.plot.plot_log`."""
        from exodrake.data.plot import plot_log  # matplotlib is heavy, and only a drawing needs it  # pyright: ignore

        return plot_log(self, *args, **options)

    def sample(self, column: str, time: np.ndarray) -> np.ndarray:
        """A column (n,) [its unit] at times (n,) [s], linear between samples, NaN outside the time of the log."""
        if len(self) == len(time) and np.abs(self.time - time).max() <= ALIKE:
            return self[column]
        inside = (time >= self.time[0] - ALIKE) & (time <= self.time[-1] + ALIKE)
        return np.where(inside, np.interp(time, self.time, self[column]), np.nan)

    def _repr_html_(self) -> str:
        from exodrake.data.plot import log_html  # pyright: ignore

        return log_html(self)


def find_first(rows: np.ndarray) -> int | None:
    """The first index at which a mask (n,) [-] is true; None if there is none."""
    return int(np.argmax(rows)) if rows.any() else None


def check_clock(log: Log) -> None:
    """InputError, naming row and times, unless time strictly increases."""
    if (row := find_first(~(np.diff(log.time) > 0))) is not None:
        here, after = log.time[row], log.time[row + 1]
        raise InputError(f"{log.label}: column 'time', row {row + 2}: {after:g} s does not come after {here:g} s")


def _vector(values: ArrayLike, name: str, source: str) -> np.ndarray:
    """A contiguous (n,) float64 array; time differences in s."""
    if getattr(getattr(values, "dtype", None), "kind", "") == "m":
        values = np.asarray(values) / np.timedelta64(1, "s")
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{source or 'log'}: column {name!r} is not numeric") from None
    if vector.ndim != 1 or np.ndim(values) != 1:
        raise InputError(f"{source or 'log'}: column {name!r} has shape {np.shape(values)}, wanted (n,)")
    return vector


def refuse_doubled(names: Iterable[str], source: str) -> None:
    """InputError for a column that comes twice, also where only signs that cannot be seen tell the two apart."""
    known: set[str] = set()
    for name in names:
        kinds = ((unicodedata.category(sign), sign) for sign in name)
        visible = "".join(" " if kind[0] == "Z" else sign for kind, sign in kinds if kind not in ("Cf", "Cc")).strip()
        if visible in known:
            raise InputError(f"{source}: column {visible!r} comes twice")
        known.add(visible)


def columns_in_si(
    columns: Iterable[tuple[str, np.ndarray]], source: str, units: Mapping[str, str] | None = None, before: int = 0
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Values (n,) [SI] by name, time among them, and their SI units, from pairs of heading and values (n,).

    A bare name takes its unit from `units` if that is given, else SI by its kind; `before`: rows before the first.
    """
    signals, known, plain = dict[str, np.ndarray](), dict[str, str](), dict[str, str]()
    for text, values in columns:
        name, bracket, rest = text.strip().partition("[")
        name, (unit, closing, tail) = name.strip(), rest.partition("]")
        if units is not None and not bracket:
            unit = units.get(name) or default_unit(name)
        elif not closing or tail.strip() or not name:
            wanted = "wanted a name and a unit in brackets, like 'tension_AF [N]'"
            raise InputError(f"{source}: column heading {text.strip()!r}: {wanted}")
        if name in signals:
            raise InputError(f"{source}: column {name!r} comes twice")
        if not name.isprintable():
            raise InputError(f"{source}: column {name!r}: its name holds a sign that cannot be seen")
        folded = unicodedata.normalize("NFKC", name).casefold()  # without capitals and other forms of Unicode
        if (other := plain.setdefault(folded, name)) != name:
            raise InputError(f"{source}: column {name!r} is {other!r} in other letters, so one of them is too much")
        if (kind := find_kind(folded)) is not None and find_kind(name) is None:
            raise InputError(f"{source}: column {name!r}: did you mean {kind + name[len(kind) :]!r}?")
        where = f"{source}, column {name!r}"
        known[name], signals[name] = check_unit(name, unit, where), to_si(values, unit, where)
        if (row := find_first(np.abs(signals[name]) > LARGEST)) is not None:
            value = signals[name][row]
            reason = "infinite" if np.isinf(value) else f"{value:g} in SI is beyond any signal"
            raise InputError(f"{where}, row {before + row + 1}: {reason}")
    return signals, known


def headings(log: Log) -> list[str]:
    """Headings of time and all columns, in order."""
    return ["time [s]", *(f"{name} [{log.units[name]}]" for name in log.columns)]


def log_from_columns(
    columns: Iterable[tuple[str, np.ndarray]], source: str, units: Mapping[str, str] | None = None
) -> Log:
    """A log from pairs of heading and values (n,) [its unit], as `columns_in_si`; refuses no time and no rows."""
    signals, known = columns_in_si(columns, source, units)
    if "time" not in signals:
        found = ", ".join(signals) or "no columns"
        raise MissingColumn(f"{source}: required column 'time [s]' is missing (found {found})")
    time = signals.pop("time")
    if not len(time):
        raise InputError(f"{source}: no rows")
    if (row := find_first(np.isnan(time))) is not None:
        raise InputError(f"{source}: column 'time', row {row + 1}: empty")
    return Log(time, signals, {name: known[name] for name in signals}, source)


def check_columns(log: Log, required: Sequence[str], complete: Sequence[str] = ()) -> None:
    """InputError naming a required column that is missing or empty, or a missing sample in a complete one."""
    names = list(dict.fromkeys(name for kind in required for name in log.names(kind)))
    wanted: list[str] = []
    for item in required:
        alone = item not in KINDS or item in log.signals or item == "time"
        wanted += [item] if alone else [f"{item}_{name}" for name in names] or [f"{item}_..."]
    for column in wanted:
        where = f"{log.label}: required column {column!r} is"
        if column != "time" and column not in log.signals:
            raise MissingColumn(f"{where} missing (found time, {', '.join(log.columns)})")
        if np.isnan(log[column]).all():
            raise MissingColumn(f"{where} empty")
    for item in complete:
        for column in [item] if item in log.signals else [f"{item}_{name}" for name in log.names(item)]:
            if (row := find_first(~np.isfinite(log[column]))) is not None:
                where = f"{log.label}: column {column!r}, row {row + 1}"
                raise InputError(f"{where}: a missing sample is not allowed here")


def check_size(samples: int, source: str) -> None:
    """InputError for a log that would fill the memory."""
    if samples > MAX_SAMPLES:
        raise InputError(f"{source}: {samples} samples, more than {MAX_SAMPLES}; cut it into several logs")


def regularise(log: Log, period: float = 0.02) -> tuple[Log, list[str]]:
    """One row per frame of `period` [s], and notes on what was changed (empty, and the same log, if nothing was).

    Rows that repeat the one before, time included, are dropped. Frames that are absent become rows of NaN. Times off
    the grid are set on it, since row n is frame n.

    Raises:
        InputError: naming the row, for a clock that steps backwards or jumps, the same time with other values, and rows
            that come faster than the frame; naming the unit that a clock seems to have, and the frame that it seems to
            count where that is another one.

    Examples:
        >>> import numpy as np
        >>> import exodrake as exo
        >>> mended, notes = regularise(exo.Log(np.array([0.0, 0.02, 0.06]), {"stroke_AF": np.zeros(3)}))
        >>> len(mended), notes
        (4, ['log: 1 missing frames, the first at 0.04 s (longest gap 1 frames), left empty'])
    """
    table, name = np.column_stack([argument("log", log, Log).time, *log.signals.values()]), log.label
    same = ((table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))).all(axis=1)
    if (row := find_first(~(np.diff(log.time) > 0) & ~same)) is not None:
        here, after = log.time[row], log.time[row + 1]
        back = f"the clock steps backwards by {here - after:.6g} s"
        fault = back if here != after else "the same time with other values"
        raise InputError(f"{name}: at row {row + 2}, {after:g} s after {here:g} s: {fault}; cut the log there")
    if not (np.isfinite(period) and period > 0):
        raise InputError(f"frame period {period!r} s: wanted a positive number")
    notes, single = [], log
    if (row := find_first(same)) is not None:
        single, at = log.rows(np.concatenate([[True], ~same])), log.time[row + 1]
        notes = [f"{name}: {same.sum()} repeated rows dropped, the first is row {row + 2} at {at:g} s"]
    time, gaps = single.time, np.diff(single.time)
    middle = float(np.quantile(gaps, 0.5, method="lower")) if len(gaps) else 0.0
    if middle > LONGEST * period:  # its unit is a smaller one, in which the median step is nearest to the period
        unit = min(SMALLER, key=lambda unit: abs(np.log(to_si(middle, unit) / period)))
        apart = f"its rows are {middle:g} apart, a frame is {period:g} s; say 'time [{unit}]'"
        raise InputError(f"{name}: column 'time' looks like {SMALLER[unit]}, not seconds: {apart}")
    steps = np.rint(gaps / period)  # one by one, so that a clock 0.1 % fast does not lose a frame in a minute
    if (at := find_first(steps < 1)) is not None:
        raise InputError(f"{name}: two rows {gaps[at]:.3g} s apart at {time[at]:g} s, but a frame is {period:g} s")
    if steps.sum() > LONGEST * (len(single) + LONGEST):
        at = int(np.argmax(gaps))
        raise InputError(f"{name}: a gap of {gaps[at]:.6g} s at {time[at]:g} s is no missing frame; cut the log there")
    frames = np.concatenate([[0], np.cumsum(steps.astype(int))]) if len(single) else np.zeros(0, dtype=int)
    if (found := other_rate(time, frames, period)) is not None:
        apart = found[1] * float(np.median(np.diff(frames)))
        raise InputError(
            f"{name}: from {found[0]:g} s on its rows are {apart * 1e3:.4g} ms apart, no multiple of the frame of "
            f"{period * 1e3:g} ms: its clock or the `period` is wrong; `exodrake import` puts another rate on frames"
        )
    if not len(single):
        return single, notes
    grid = time[0] + period * np.arange(frames[-1] + 1)
    deviation = float(np.max(np.abs(time - grid[frames])))
    if deviation > max(EXACT, period * 1e-3):
        notes.append(f"{name}: frame times up to {deviation * 1e3:.3g} ms off the {period * 1e3:g} ms grid, set on it")
    if deviation <= EXACT:  # times that are on the grid keep their bits
        grid[frames] = time
    absent, holes = len(grid) - len(single), np.diff(frames)
    if not absent:
        return single if deviation <= EXACT else replace(single, time=grid), notes
    gap = f"the first at {grid[frames[np.argmax(holes > 1)] + 1]:g} s (longest gap {holes.max() - 1} frames)"
    notes.append(f"{name}: {absent} missing frames, {gap}, left empty")
    signals = {column: np.full(len(grid), np.nan) for column in single.signals}
    for column, values in single.signals.items():
        signals[column][frames] = values
    return replace(single, time=grid, signals=signals), notes


def merge_notes(done: Mapping[str, Sequence[str]], everything: str = "all logs") -> list[str]:
    """Notes on several logs or columns as sentences, each once with the names of all that it is true of.

    everything: what stands in place of the names where these are all of several; they are listed if it is empty.
    """
    names: dict[str, list[str]] = {}
    for name, lines in done.items():
        for line in lines:
            names.setdefault(line, []).append(name)
    whole = {line: everything if 1 < len(done) == len(some) else "" for line, some in names.items()}
    return [f"{whole[line] or ', '.join(some)}: {line}" for line, some in names.items()]


def other_rate(time: np.ndarray, frames: np.ndarray, period: float) -> tuple[float, float] | None:
    """Time [s] from which a clock (n,) [s] runs at another rate than its frames (n,), and its frame [s]; or None."""
    for rows in np.array_split(np.arange(len(time)), max(1, len(time) // STRETCH)):
        span = float(frames[rows[-1]] - frames[rows[0]]) if len(rows) > 2 else 0.0
        if span:
            numbers = frames[rows] - frames[rows].mean()
            off = float(numbers @ (time[rows] - time[rows].mean()) / (numbers @ numbers)) / period - 1.0
            if abs(off) > RATE and abs(off) * span > 0.5:
                return float(time[rows[0]]), period * (1.0 + off)
    return None


@dataclass(frozen=True)
class Difference:
    """Second log less first in one signal [unit], over the samples that both have; `largest` is at `at` [s]."""

    unit: str
    rms: float
    mean: float
    largest: float
    at: float
    samples: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two logs.

    Attributes:
        names: names of both logs.
        start: start of the time that both cover [s].
        end: end of the time that both cover [s].
        signals: column -> difference.
        notes: what was left out, a sentence each.

    Examples:
        >>> import exodrake as exo
        >>> robot = exo.load_robot()
        >>> found = exo.compare(exo.simulate(robot, "caging"), exo.simulate(robot, "caging:hold=4"))
        >>> print(f"{found.start:g} to {found.end:g} s, largest: {found.signals['tension_AF'].largest:.1f} N")
        0 to 5.48 s, largest: 6.5 N
    """

    names: tuple[str, str]
    start: float
    end: float
    signals: dict[str, Difference]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        listed = ", ".join(f"{name} {s.largest:.3g} {s.unit}" for name, s in self.signals.items())
        listed = shorten(listed, SHOWN, placeholder=" ...")
        return f"Comparison({' and '.join(self.names)}: {self.start:g} to {self.end:g} s; up to {listed})"


def compare(first: Log, second: Log) -> Comparison:
    """Compare two logs in the columns and over the time that both have.

    Args:
        first: whose clock counts.
        second: read between its samples where its clock differs.

    Raises:
        InputError: if they have no column or no time in common.

    Examples:
        >>> import exodrake as exo
        >>> robot = exo.load_robot()
        >>> rusty = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3}, channels=["AF"])
        >>> found = exo.compare(exo.simulate(robot, "caging"), exo.simulate(rusty, "caging"))
        >>> print(round(found.signals["angle_PIP"].largest, 2), found.signals["angle_PIP"].unit)
        0.17 rad
    """
    first, second = argument("first", first, Log), argument("second", second, Log)
    common = [name for name in first.columns if name in second.signals]
    start, end = max(first.time[0], second.time[0]), min(first.time[-1], second.time[-1])
    inside = (first.time >= start - ALIKE) & (first.time <= end + ALIKE)
    if not common or not inside.any():
        lack = "column" if not common else "time"
        raise InputError(f"{first.label} and {second.label}: no {lack} in common, so there is nothing to compare")
    notes = []
    for one, other in ((first, second), (second, first)):
        alone = ", ".join(name for name in one.columns if name not in other.signals)
        notes += [f"{alone} only in {one.label}"] if alone else []
    if not inside.all() or second.time[0] < start - ALIKE or second.time[-1] > end + ALIKE:
        notes.append(f"compared from {start:g} to {end:g} s, which both cover")
    time, found = first.time[inside], {}
    for name in common:
        if first.units[name] != second.units[name]:
            notes.append(f"{name} is in [{first.units[name]}] and in [{second.units[name]}], and left out")
            continue
        error = second.sample(name, time) - first[name][inside]
        known = np.flatnonzero(np.isfinite(error))
        if not len(known):
            notes.append(f"{name} has no sample that both have")
            continue
        worst = known[np.abs(error[known]).argmax()]
        rms, mean = float(np.sqrt(np.mean(error[known] ** 2))), float(error[known].mean())
        found[name] = Difference(first.units[name], rms, mean, float(abs(error[worst])), float(time[worst]), len(known))
    return Comparison((first.label, second.label), float(start), float(end), found, tuple(notes))


def fill_gaps(values: np.ndarray) -> np.ndarray:
    """Samples (n,) [their unit], a missing one replaced by the last known, the first ones by the first known."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.nan_to_num(values[last], nan=values[known][0])


def fill_columns(rows: np.ndarray) -> np.ndarray:
    """Signals (n, columns) [their units], each filled."""
    return np.column_stack([fill_gaps(column) for column in rows.T])


def robust_std(values: np.ndarray) -> float:
    """Standard deviation [their unit] of values (n,), rare ones clipped (proposal 2 of Huber 1964).

    Its iteration begins at the median absolute deviation, which itself is too coarse where values are rounded, and is 0
    where most are equal.
    """
    deviations = np.abs(values - np.median(values))
    std = ROBUST * float(np.median(deviations))
    for _ in range(STEPS):
        std = float(np.sqrt(np.mean(np.minimum(deviations, LIMIT * std) ** 2) / WITHIN))
    return std


def fast_noise(values: np.ndarray, order: int = ORDER) -> float:
    """Standard deviation [its unit] of white noise in a slow signal (n,), by differences of an order; 0 if rounding.

    Differences of order k raise white noise by the sum of squared binomial coefficients, (2k over k).
    """
    if len(values) <= order:
        return 0.0
    found = robust_std(np.diff(values, order)) / np.sqrt(comb(2 * order, order))
    return 0.0 if found <= np.finfo(float).eps * np.nanmax(np.abs(values), initial=0.0) else found
