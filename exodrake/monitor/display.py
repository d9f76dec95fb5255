"""Terminal output of the monitor: segments coloured by their gap, and the alarm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exodrake.monitor.alarm import Alarm, calibration, share_at_most
from exodrake.monitor.gap import SKIP, WINDOW, Reading
from exodrake.monitor.online_replay import LOOP
from exodrake.monitor.watcher import Monitor

if TYPE_CHECKING:
    from rich.console import RenderableType

WHOLE = "closed loop"
CALM, HIGH = 0.5, 1.0  # of the limit: below the first green, above the second red
BAR = 24  # characters
LARGE = 3.0  # noise standard deviations that a summary names though no alarm came: assumed
EVERY = 10  # s of the log between plain lines


def rate(monitor: Monitor) -> str:
    """The stated rate of false alarms, or why there is no alarm."""
    made = calibration(monitor.machine.name)
    if made is None:
        return f"no limits are calibrated for {monitor.machine.name}: gaps only, no alarm"
    share = share_at_most(made["robots"])
    return f"no alarm (at most {share:.0%} of healthy robots raise one in {made['minutes']:g} minutes)"


def named(segment: str) -> str:
    """Name of a segment in tables."""
    return WHOLE if segment == LOOP else segment


def sentence(monitor: Monitor, alarm: Alarm, path: Path) -> str:
    """An alarm in words."""
    contents = next((s.contents for s in monitor.machine.segments if s.name == alarm.channel.segment), "")
    where = f"{named(alarm.channel.segment)} ({contents})" if contents else named(alarm.channel.segment)
    more = f" and {alarm.above - 1} more" if alarm.above > 1 else ""
    rose = "there from the begin on" if alarm.second <= SKIP + WINDOW else "no sudden rise in the last minute"
    if alarm.rose is not None:
        rose = f"it rose between {alarm.rose[0]:.0f} s and {alarm.rose[1]:.0f} s"
    return (
        f"ALARM at {alarm.second} s: {where}, gap of {alarm.channel.column} is {alarm.gap:.1f} noise standard "
        f"deviations over {WINDOW} s (limit {alarm.limit:.1f}){more}; {rose}; for the cause: exodrake diagnose {path}"
    )


def worst(monitor: Monitor, values: np.ndarray, segment: str) -> tuple[str, float, float]:
    """A segment's worst channel: column, gap and share of the limit; "" and NaN if nothing is measured.

    The worst channel is the one nearest its limit, or the one of the largest gap on a machine without limits.
    """
    places = [k for k, c in enumerate(monitor.channels) if c.segment == segment and np.isfinite(values[k])]
    if not places:
        return "", float("nan"), float("nan")
    shares = values if monitor.limit is None else values / monitor.limit
    k = max(places, key=lambda i: shares[i])
    return monitor.channels[k].column, float(values[k]), float("nan" if monitor.limit is None else shares[k])


def screen(monitor: Monitor, path: Path) -> RenderableType:
    """The whole display: a row for each segment, coloured by its share of the limit, and the alarm's state below."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    notes, reading = [Text(note, style="dim") for note in monitor.notes[-3:]], monitor.reading
    if reading is None:
        state = "waiting for rows" if path.exists() else "waiting for the file"
        return Group(Text(f"{path}: {state}", style="dim"), *notes)
    table = Table(box=None, pad_edge=False, header_style="bold")
    nearest = "largest" if monitor.limit is None else "nearest its limit"
    for title in ("segment", f"{WINDOW} s", "so far", nearest, "gap"):
        table.add_column(title, justify="left" if title in ("segment", nearest) else "right")
    table.add_column("" if monitor.limit is None else "of the limit│", width=BAR)
    at = round(BAR * CALM)  # where the bar marks the limit
    for segment in monitor.segments:
        column, gap, share = worst(monitor, reading.recent, segment)
        style, bar = "default", ""
        if share == share:
            style = "green" if share < CALM else "yellow" if share <= HIGH else "bold red"
            full = min(round(share * at), BAR)
            bar = "".join("│" if k == at and k >= full else "█" if k < full else " " for k in range(BAR))
        means = (shown(monitor.rms(v, segment)) for v in (reading.recent, reading.overall))
        cells = (named(segment), *means, column or "not measured", shown(gap), bar)
        table.add_row(*(Text(c, style=style if column else "dim") for c in cells))
    if monitor.limit is None:
        state = Text(rate(monitor), style="dim")
    elif not reading.full:
        state = Text(f"the alarm begins after {SKIP + WINDOW} s", style="dim")
    elif monitor.alarm is not None:
        state = Text(sentence(monitor, monitor.alarm, path), style="bold red")
    elif monitor.alarms:
        last = sentence(monitor, monitor.alarms[-1], path)
        state = Text(f"no alarm now; {len(monitor.alarms)} so far, the last: {last}", style="yellow")
    else:
        state = Text(rate(monitor), style="green")
    cost = f"{1e3 * monitor.busy / max(monitor.frames, 1):.2f} of {1e3 * monitor.machine.frame:g} ms a frame"
    head = Text(f"{path}  {reading.second} s  gap in noise standard deviations  {cost}", style="bold")
    return Group(head, table, state, *notes)


def shown(value: float) -> str:
    """A gap with one digit."""
    return "-" if value != value else f"{value:.1f}"


def line(monitor: Monitor, reading: Reading) -> str:
    """A reading as one line of plain text."""
    gaps = "  ".join(f"{named(s)} {shown(monitor.rms(reading.recent, s)):>5s}" for s in monitor.segments)
    return f"{reading.second:6d} s  {gaps}"


def summary(monitor: Monitor, path: Path) -> list[str]:
    """Last lines of a run; a log too short for an alarm, and a large gap that raised none, say so."""
    needed = f"a gap needs more than {SKIP} s, and an alarm {SKIP + WINDOW} s"
    if monitor.reading is None:
        return [
            f"{path}: {monitor.frames} frames, {monitor.frames * monitor.machine.frame:.3g} s, are too few: {needed}"
        ]
    gaps = "  ".join(f"{named(s)} {shown(monitor.rms(monitor.reading.overall, s))}" for s in monitor.segments)
    duration, cost = monitor.frames * monitor.machine.frame, monitor.busy / max(monitor.frames, 1)
    lines = [
        f"{path}: {duration:.0f} s, {monitor.frames} frames, {1e3 * cost:.2f} ms each",
        f"gap since the start in noise standard deviations: {gaps}",
    ]
    if not monitor.alarms:
        at = int(np.nanargmax(monitor.reading.overall)) if np.isfinite(monitor.reading.overall).any() else 0
        gap, channel = float(monitor.reading.overall[at]), monitor.channels[at]
        if gap > LARGE:
            lines.append(
                f"the gap is large: {channel.column}, {named(channel.segment)}, {gap:.1f} noise standard deviations; "
                f"for the cause: exodrake diagnose {path}"
            )
        if not monitor.reading.full and monitor.limit is not None:
            return [*lines, f"no alarm is possible: the log is too short, {needed}"]
        return [*lines, rate(monitor)]
    return [*lines, f"{len(monitor.alarms)} alarms, the first: {sentence(monitor, monitor.alarms[0], path)}"]
