"""Changes over the cases of a robot: change points of each cause's amplitude from case to case.

A case that does not name the effect counts with the parameter's null value if it has no gap, retuning suffices or
another effect is named. Reciprocals are followed of a parameter whose null value is infinite, as a stiffness. A case
with an unknown or ambiguous cause does not count. Where there are more than `MOST` cases, medians of consecutive ones
are used, since a mean would turn a step into a slope. The scatter of the amplitudes is estimated. Their stated
intervals are not used, since these hold the error of the law, which is alike in all cases.

Null values have no scatter, so amplitudes with some among them are not normal: a single case that names an effect would
be a change beyond doubt if it is the last. The p-value of such a series is that of a permutation test (Fisher 1935),
exact for cases in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import DRAWS, LEAST, Change, ChangePoint
from exodrake.diagnosis.fleet import Row
from exodrake.diagnosis.result import NAMED, NO_GAP, RETUNE
from exodrake.diagnosis.sessions import DAY
from exodrake.machines.library import machine_named, machine_names

MOST = 60  # points of a series
TINY = 1e-6  # of the series' spread: below every scatter, which is then estimated alone
ALIKE = 1e-6  # relative difference of the ratios of two orders that are the same but for rounding


@dataclass(frozen=True, eq=False)
class Trend:
    """Trend of the amplitude of a cause over the cases of a robot.

    Attributes:
        serial: of the robot.
        effect, parameter, channel, unit: of the amplitude; `1 / stiffness` for a reciprocal.
        first: date of the first case.
        times, values: (points,) days since then, and amplitudes [unit].
        p: p-value of no change, corrected for the number of trends of the robot.
        change: None where p is above the level.
    """

    serial: str
    effect: str
    parameter: str
    channel: str
    unit: str
    first: datetime
    times: np.ndarray
    values: np.ndarray
    p: float
    change: Change | None

    def moment(self, time: float) -> str:
        """Day of a time [d]."""
        return (self.first + timedelta(days=float(time))).date().isoformat()


def trends(rows: Sequence[Row]) -> list[Trend]:
    """Trends of one robot's rows, the clearest change first; none with too few dated cases."""
    dated = [row for row in rows if row.date is not None]
    keys = dict.fromkeys((a.effect, a.parameter, a.channel, a.unit) for row in dated for a in row.amounts)
    series = {key: points(dated, key) for key in keys}
    series = {key: found for key, found in series.items() if len(found[0]) >= LEAST}
    made = [trend(rows[0].serial, key, dated[0].date, *found, len(series)) for key, found in series.items()]  # pyright: ignore
    return sorted(made, key=lambda t: (t.p, -(t.change.size if t.change else 0.0)))


@cache
def null_value(effect: str, parameter: str) -> float:
    """Value of an effect's parameter where the effect is absent; 0 of an effect that no machine has."""
    effects = (known for name in machine_names() for known in machine_named(name).effects if known.id == effect)
    return next((p.null for known in effects for p in known.parameters if p.name == parameter), 0.0)


def points(rows: Sequence[Row], key: tuple[str, str, str, str]) -> tuple[np.ndarray, np.ndarray, bool]:
    """Days since the first row, amplitudes (points,) of a cause, medians where there are too many, and any absence.

    Amplitudes are in their unit, or reciprocal where the null value is infinite.
    """
    first, null, found, missed = rows[0].date, null_value(*key[:2]), [], False
    for row in rows:
        own = [a.value for a in row.amounts if (a.effect, a.parameter, a.channel, a.unit) == key]
        absent = row.verdict in (NO_GAP, RETUNE, NAMED) and not own
        if (own and row.verdict == NAMED) or absent:
            value = own[0] if own else null
            value = 1.0 / value if np.isinf(null) and value != 0.0 else value
            found.append(((row.date - first).total_seconds() / DAY, value))  # pyright: ignore
            missed |= absent
    table = np.array(found).reshape(-1, 2)
    table = table[np.isfinite(table).all(axis=1)]
    days = np.unique(table[:, 0])
    means = np.array([table[table[:, 0] == day].mean(axis=0) for day in days]).reshape(-1, 2)
    groups = [g for g in np.array_split(means, min(MOST, max(len(means), 1))) if len(g)]
    return np.array([g[:, 0].mean() for g in groups]), np.array([np.median(g[:, 1]) for g in groups]), missed


def trend(
    serial: str, key: tuple[str, str, str, str], first: datetime, times: np.ndarray, values: np.ndarray, missed: bool,
    count: int,
) -> Trend:  # fmt: skip
    """A trend with its change; missed: whether null values are among them; count: trends that are tested beside it."""
    effect, parameter, channel, unit = key
    if np.isinf(null_value(effect, parameter)):
        parameter, unit = f"1 / {parameter}", f"1/({unit})"
    spread = float(np.ptp(values))
    if spread <= 0.0:
        return Trend(serial, effect, parameter, channel, unit, first, times, values, 1.0, None)
    scan = ChangePoint(times, (TINY * spread) ** 2 * np.eye(len(times)), grid=1)
    found = permuted(scan, values) if missed else float(scan.p_values(values[:, None])[0])
    p = min(1.0, found * count)
    change = scan(values, np.random.default_rng(len(times))) if p < ALPHA else None
    return Trend(serial, effect, parameter, channel, unit, first, times, values, p, change)


def permuted(scan: ChangePoint, values: np.ndarray) -> float:
    """p-value of no change in values (points,) of any law: share of their orders that show a change as clear."""
    rng = np.random.default_rng(len(values))
    orders = np.column_stack([values, *(rng.permutation(values) for _ in range(DRAWS))])
    ratios = scan.ratio(scan.centred(orders), 1.0)
    return float(np.mean(ratios >= ratios[0] * (1.0 - ALIKE)))
