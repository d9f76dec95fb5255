"""Training data: rows of logs, each with the label of its sweep.

A sweep is one excursion of the tension references: from the end of the previous sweep, up, and down again. The wearer's
variation from sweep to sweep is common to all rows of one. So a sweep is held out whole or not at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import Log, check_columns

MIN_SWEEPS = 4  # fewer do not show the variation between sweeps
MIN_RAMP = 0.3  # s, a shorter rise or fall of a reference is a step between sweeps
MAX_STEP = 0.05  # of a reference's range in one frame: more is a jump, not a ramp
MIN_STEP = 1e-4  # of a reference's range in one frame: less is a hold


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Rows of several sweeps, with names of their wires, joints and logs."""

    inputs: np.ndarray  # (n, 2 x wires) tensions [N], then strokes [m]
    angle: np.ndarray  # (n, joints) joint angles [rad]
    sweep: np.ndarray  # (n,) label of the sweep
    time: np.ndarray  # (n,) time [s], compared within a sweep only
    wires: tuple[str, ...]
    joints: tuple[str, ...]
    logs: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def count(self) -> int:
        """Number of sweeps."""
        return len(np.unique(self.sweep))

    @property
    def tension(self) -> np.ndarray:
        """Tensions (n, wires) [N]."""
        return np.ascontiguousarray(self.inputs[:, : len(self.wires)])

    @property
    def stroke(self) -> np.ndarray:
        """Strokes (n, wires) [m]."""
        return np.ascontiguousarray(self.inputs[:, len(self.wires) :])

    def rows(self, which: np.ndarray) -> "Sweeps":
        """Select rows by a mask (n,) [-] or indices."""
        kept = {name: getattr(self, name)[which] for name in ("inputs", "angle", "sweep", "time")}
        return replace(self, **kept)

    def select_equispaced(self, count: int) -> "Sweeps":
        """Select at most `count` rows, equally spaced."""
        few = len(self) <= count
        return self if few else self.rows(np.linspace(0, len(self) - 1, count).round().astype(int))


def sweeps_from_logs(logs: Sequence[Log], one_per_log: Sequence[str] = ()) -> Sweeps:
    """Cut logs into sweeps and join them; logs whose label is in `one_per_log` are one sweep each.

    Raises:
        InputError: For no logs, logs of other wires or joints than the first, logs without angles, missing samples
            (NaN), and fewer than `MIN_SWEEPS` sweeps.
    """
    if not logs:
        raise InputError("no logs to train the estimator on")
    wires, joints = logs[0].names("tension"), logs[0].names("angle")
    rows, first = [], 0
    for log in logs:
        inputs, angle = read_columns(log, ("tension", "stroke"), wires), read_columns(log, ("angle",), joints)
        label = np.zeros(len(log), int) if log.label in one_per_log else cut(log.array("tension_ref", wires), log.dt)
        rows.append((inputs, angle, first + label, log.time))
        first += int(label[-1]) + 1
    if first < MIN_SWEEPS:
        raise InputError(
            f"{logs[0].label}: too few sweeps: {first} in {len(logs)} log(s), at least {MIN_SWEEPS} are needed"
        )
    arrays = map(np.concatenate, zip(*rows, strict=True))
    return Sweeps(*arrays, wires=wires, joints=joints, logs=tuple(log.label for log in logs))


def read_columns(log: Log, kinds: tuple[str, ...], channels: tuple[str, ...], complete: bool = True) -> np.ndarray:
    """Columns (n, kinds x channels) [SI]. InputError for other channels, or none, or missing samples if `complete`."""
    found = log.names(kinds[0])
    if not channels or set(found) != set(channels):
        have, wanted = ", ".join(found) or "none", ", ".join(channels) or "some"
        raise InputError(f"{log.label}: columns {kinds[0]}_... of {have}, the estimator needs {wanted}")
    if complete:
        check_columns(log, (), [f"{kind}_{channel}" for kind in kinds for channel in channels])
    return np.hstack([log.array(kind, channels) for kind in kinds])


def read_session(log: Log, wires: tuple[str, ...], joints: tuple[str, ...]) -> Sweeps:
    """Cut a log; angles that it lacks are NaN. InputError for other wires or joints, or missing tensions or strokes."""
    inputs, references = read_columns(log, ("tension", "stroke"), wires), set(log.names("tension_ref")) >= set(wires)
    label = cut(log.array("tension_ref", wires), log.dt) if references else np.zeros(len(log), int)
    angle = np.full((len(log), len(joints)), np.nan)
    if log.names("angle"):
        angle = read_columns(log, ("angle",), joints, complete=False)
    return Sweeps(inputs, angle, label, log.time, wires, joints, (log.label,))


def cut(reference: np.ndarray, dt: float) -> np.ndarray:
    """Label the rows of a log by sweep, (n,) from 0, by its tension references (n, wires) [N] and sampling interval.

    A ramp lasts at least `MIN_RAMP` with a monotonic reference and no jump. A sweep ends with the last ramp before a
    new rise that follows a fall, belongs to another wire, or starts lower than the last rise ended; the dwell between
    them belongs to the new sweep. A log without ramps (holds, steps) is one sweep.
    """
    label = np.zeros(len(reference), int)
    span = np.ptp(reference, axis=0)
    if len(reference) < 2 or not np.any(span > 0):
        return label
    step = np.diff(reference, axis=0) / np.where(span > 0, span, 1.0)
    jump, ramps = np.any(np.abs(step) > MAX_STEP, axis=1), []
    for way in (+1, -1):
        moving = np.any(way * step > MIN_STEP, axis=1) & ~jump
        edges = np.flatnonzero(np.diff(np.r_[False, moving, False])).reshape(-1, 2)
        ramps += [(int(a), int(b), way) for a, b in edges if (b - a) * dt >= MIN_RAMP]
    last, lead, height, fallen = 0, -1, 0.0, False
    for start, end, way in sorted(ramps):
        if way < 0:
            fallen, last = True, end
            continue
        wire = int(np.argmax(reference[end] - reference[start]))
        lower = wire == lead and reference[start, wire] < height - MAX_STEP * span[wire]
        if lead >= 0 and (fallen or lower or wire != lead):
            label[last + 1 :] += 1
        last, lead, height, fallen = end, wire, reference[end, wire], False
    return label
