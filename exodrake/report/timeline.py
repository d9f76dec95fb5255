"""A quantity over time with its change, as plain data for `templates/timeline.js`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from exodrake.core.display import SYMBOLS, shown_unit
from exodrake.diagnosis.change_point import Change


def timeline(
    head: Mapping[str, Any],
    unit: str,
    times: Sequence[float],
    rows: Mapping[str, Sequence[float]],
    change: Change | None,
    clock: Callable[[Sequence[float]], list[float]],
) -> dict[str, Any]:
    """Plain data of a quantity.

    Args:
        head: `title`, and `dates`: whether the clock gives POSIX times.
        unit: of the values.
        times: (n,) of the values and of the change [their unit].
        rows: `values`, `low` and `high` (n,) [unit].
        change: its change point; None without.
        clock: times as they are shown [s].
    """
    name, factor = shown_unit(unit)
    shown = {key: [factor * float(value) for value in values] for key, values in rows.items()}
    found = {**head, "unit": SYMBOLS.get(name, name), **shown, "times": clock(times)}
    if change is None:
        return found
    path = [[*clock([t]), factor * y] for t, y in change.path(times[0], times[-1])]
    return found | {"began": clock(change.began), "path": path}
