"""Changes over the cases of a robot: change points of each cause's amplitude from case to case.

A case that does not name the effect counts as amplitude 0 if it has no gap or retuning suffices. A case with an unknown
or ambiguous cause does not count. Where there are more than `MOST` cases, medians of consecutive ones are used, since a
mean would turn a step into a slope. The scatter of the amplitudes is estimated. Their stated intervals are not used,
since these hold the error of the law, which is alike in all cases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import LEAST, Change, ChangePoint
from exodrake.diagnosis.fleet import Row
from exodrake.diagnosis.result import NAMED, NO_GAP, RETUNE
from exodrake.diagnosis.sessions import DAY

MOST = 60  # points of a series
TINY = 1e-6  # of the series' spread: below every scatter, which is then estimated alone


@dataclass(frozen=True, eq=False)
class Trend:
    """Trend of the amplitude of a cause over the cases of a robot.

    Attributes:
        serial: of the robot.
        effect, parameter, channel, unit: of the amplitude.
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


def points(rows: Sequence[Row], key: tuple[str, str, str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Days since the first row and amplitudes (points,) [unit] of a cause, medians where there are too many."""
    first, found = rows[0].date, []
    for row in rows:
        own = [a.value for a in row.amounts if (a.effect, a.parameter, a.channel, a.unit) == key]
        absent = row.verdict in (NO_GAP, RETUNE, NAMED) and not own
        if (own and row.verdict == NAMED) or absent:
            found.append(((row.date - first).total_seconds() / DAY, own[0] if own else 0.0))  # pyright: ignore
    table = np.array(found).reshape(-1, 2)
    table = table[np.isfinite(table).all(axis=1)]
    days = np.unique(table[:, 0])
    means = np.array([table[table[:, 0] == day].mean(axis=0) for day in days]).reshape(-1, 2)
    groups = np.array_split(means, min(MOST, max(len(means), 1)))
    return np.array([g[:, 0].mean() for g in groups if len(g)]), np.array(
        [np.median(g[:, 1]) for g in groups if len(g)]
    )


def trend(
    serial: str, key: tuple[str, str, str, str], first: datetime, times: np.ndarray, values: np.ndarray, count: int
) -> Trend:
    """A trend with its change; count: trends that are tested beside it."""
    spread = float(np.ptp(values))
    if spread <= 0.0:
        return Trend(serial, *key, first, times, values, 1.0, None)
    scan = ChangePoint(times, (TINY * spread) ** 2 * np.eye(len(times)), grid=1)
    p = min(1.0, float(scan.p_values(values[:, None])[0]) * count)
    change = scan(values, np.random.default_rng(len(times))) if p < ALPHA else None
    return Trend(serial, *key, first, times, values, p, change)
