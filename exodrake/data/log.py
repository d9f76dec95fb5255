"""A log: time and named columns in SI. Measured and simulated alike.

A column's name is `kind_name`: `tension_AF` is the tension of tendon AF, `angle_PIP` the angle of joint PIP.
The file's header says which tendons and joints there are. A missing sample is NaN.

    log = read_log("sweeps.csv.gz")
    log.array("tension", ("AF", "MF", "AE"))    # (n, 3) N
    log["tension"]                              # the same: all columns of the kind
    log["angle_MCP"], log.time, log.dt          # (n,) rad, (n,) s, s
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import check_unit, default_unit, kind_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Log:
    """Columns on a common clock.

    Attributes:
        time: (n,) instants of the samples [s].
        signals: column name -> (n,) float64 in SI, NaN where a sample is missing.
        units: column name -> SI unit; columns left out get the unit of their kind.
        source: file the log came from, or "".
        simulated: 0, or by which kind of robot exodrake simulated it (`data.simulated`).

    Raises:
        InputError: for a column of another length than time, or a unit that does not suit its kind.
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
        given = self.units
        units = {
            name: check_unit(name, given[name], f"{self.label}, column {name!r}")
            if name in given
            else default_unit(name)
            for name in signals
        }
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
        if self.names(column):
            return self.array(column)
        raise InputError(f"{self.label}: no column {column!r} (it has {', '.join(self.signals) or 'none'})")

    def __repr__(self) -> str:
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self) else "empty"
        listed = ", ".join(self.kinds or self.columns)
        return f"Log({self.label}: {len(self)} rows, {span}; {listed if len(listed) <= 80 else listed[:77] + '...'})"

    @property
    def label(self) -> str:
        """The source, or `log` when there is none: what messages call this log."""
        return self.source or "log"

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns but time, in file order."""
        return tuple(self.signals)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Known kinds present, in file order."""
        return tuple(dict.fromkeys(kind for kind in map(kind_of, self.signals) if kind))

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
        """Channels with this kind of column, in file order, such as `AF`, `MF`, `AE` for `tension`."""
        return tuple(column[len(kind) + 1 :] for column in self.signals if _is_of_kind(column, kind))

    def array(self, kind: str, names: Sequence[str] | None = None) -> np.ndarray:
        """Columns of one kind (n, len(names)) [SI]; all of them in file order if no names are given.

        InputError naming the column that is missing.
        """
        chosen = self.names(kind) if names is None else tuple(names)
        if not chosen:
            raise InputError(f"{self.label}: no column of kind {kind!r} (it has {', '.join(self.signals) or 'none'})")
        return np.column_stack([self[f"{kind}_{name}"] for name in chosen])

    def rows(self, which: slice | np.ndarray) -> "Log":
        """Select rows by a slice, a mask (n,) [-] or indices."""
        picked = {name: values[which] for name, values in self.signals.items()}
        return replace(self, time=self.time[which], signals=picked)

    def between(self, start: float, end: float) -> "Log":
        """Rows with start <= time < end [s], so that neighbouring spans share no row. The clock is not shifted."""
        return self.rows((self.time >= start) & (self.time < end))

    def only(self, columns: Iterable[str]) -> "Log":
        """The log of these columns, in this order. InputError naming one it lacks."""
        chosen = {name: self[name] for name in columns}
        return replace(self, signals=chosen, units={name: self.units[name] for name in chosen})

    def with_signals(self, signals: Mapping[str, "ArrayLike"], units: Mapping[str, str] | None = None) -> "Log":
        """A new log with columns added or replaced, (n,) each. An unknown kind needs its SI unit in `units`."""
        added = {name: np.asarray(values, dtype=float) for name, values in signals.items()}
        return replace(self, signals=self.signals | added, units=self.units | dict(units or {}))

    def with_array(self, kind: str, names: Sequence[str], values: np.ndarray) -> "Log":
        """Add columns `kind_name` from values (n, len(names)) [SI]: the inverse of `array`."""
        if np.shape(values) != (len(self), len(names)):
            raise InputError(f"{kind}: array of shape {np.shape(values)}, wanted {(len(self), len(names))}")
        return self.with_signals({f"{kind}_{name}": values[:, i] for i, name in enumerate(names)})

    def equals(self, other: "Log") -> bool:
        """True if clock, columns, order, units and every sample are the same to the last bit (NaN equals NaN)."""
        return (
            self.columns == other.columns
            and self.units == other.units
            and np.array_equal(self.time, other.time)
            and all(np.array_equal(self[name], other[name], equal_nan=True) for name in self.columns)
        )

    def to_pandas(self) -> Any:
        """The log as a DataFrame indexed by time [s]; `attrs` hold units and source. InputError without pandas."""
        from exodrake.data.pandas_frame import frame_of

        return frame_of(self)

    @staticmethod
    def from_pandas(frame: Any, units: Mapping[str, str] | None = None, source: str = "") -> "Log":
        """A log from a DataFrame.

        Args:
            frame: a column a signal, named `tension_AF` or `tension_AF [N]`; time [s] in a column `time`, or as index.
            units: of columns without one, such as `mm`; else those of `frame.attrs`, else SI by the kind.
            source: name for messages; else that of `frame.attrs`.
        """
        from exodrake.data.pandas_frame import columns_of

        source = source or str(frame.attrs.get("source", "")) or "frame"
        signals, known = columns_of(frame, {**frame.attrs.get("units", {}), **(units or {})}, source)
        log = Log(signals.pop("time"), signals, {name: known[name] for name in signals}, source)
        check_clock(log)
        return log

    def plot(self, *args: Any, **options: Any) -> Any:
        """Draw the log, a panel a kind: `exodrake.data.plot.plot_log`."""
        from exodrake.data.plot import plot_log  # matplotlib is heavy, and only a drawing needs it  # pyright: ignore

        return plot_log(self, *args, **options)


def check_clock(log: Log) -> None:
    """InputError, naming row and times, unless time strictly increases."""
    backward = np.flatnonzero(~(np.diff(log.time) > 0))
    if len(backward):
        row = int(backward[0])
        here, after = log.time[row], log.time[row + 1]
        raise InputError(f"{log.label}: column 'time', row {row + 2}: {after:g} s does not come after {here:g} s")


def _is_of_kind(column: str, kind: str) -> bool:
    """A longer known kind claims its columns: `tension_ref_AF` is no `tension` of a channel `ref_AF`."""
    if not column.startswith(kind + "_"):
        return False
    known = kind_of(column)
    return known is None or len(known) <= len(kind)


def _vector(values: "ArrayLike", name: str, source: str) -> np.ndarray:
    """A contiguous (n,) float64 array."""
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{source or 'log'}: column {name!r} is not numeric") from None
    if vector.ndim != 1 or np.ndim(values) != 1:
        raise InputError(f"{source or 'log'}: column {name!r} has shape {np.shape(values)}, wanted (n,)")
    return vector
