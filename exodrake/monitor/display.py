"""Terminal output of the monitor: segments coloured by their gap, and the alarm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exodrake.model.display import percent
from exodrake.monitor.alarm import SKIP, WINDOW, Alarm, Reading, read_calibration, share_at_most
from exodrake.monitor.watcher import Monitor
from exodrake.simulation.segments import LOOP

if TYPE_CHECKING:
    from rich.console import RenderableType

CALM, HIGH = 0.5, 1.0  # of the limit: below the first green, above the second red
BAR = 24  # characters
LARGE = 3.0  # noise standard deviations that a summary names though no alarm came: assumed


def describe_rate(monitor: Monitor) -> str:
    """The stated rate of false alarms, or why there is no alarm."""
    made = read_calibration(monitor.machine.name)
    if made is None:
        return f"no limits are calibrated for {monitor.machine.name}: gaps only, no alarm"
    share = share_at_most(made["robots"])
    return f"no alarm (at most {percent(share)} of healthy robots raise one in {made['minutes']:g} minutes)"


def name_segment(segment: str) -> str:
    """Name of a segment in tables."""
    return "closed loop" if segment == LOOP else segment


def describe_alarm(monitor: Monitor, alarm: Alarm, path: Path) -> str:
    """An alarm in words."""
    contents = next((s.contents for s in monitor.machine.segments if s.name == alarm.channel.segment), "")
    where = name_segment(alarm.channel.segment) + (f" ({contents})" if contents else "")
    more = f" and {alarm.above - 1} more" if alarm.above > 1 else ""
    rose = "there from the begin on" if alarm.second <= SKIP + WINDOW else "no sudden rise in the last minute"
    if alarm.rose is not None:
        rose = f"it rose between {alarm.rose[0]:.0f} s and {alarm.rose[1]:.0f} s"
    return (
        f"ALARM at {alarm.second} s: {where}, gap of {alarm.channel.column} is {alarm.gap:.1f} noise standard "
        f"deviations over {WINDOW} s (limit {alarm.limit:.1f}){more}; {rose}; for the cause: exodrake diagnose {path}"
    )


def draw_screen(monitor: Monitor, path: Path) -> RenderableType:
    """The whole display: a row for each segment, coloured by its share of the limit, and the alarm's state below."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    notes, reading, limit = [Text(note, style="dim") for note in monitor.notes[-3:]], monitor.reading, monitor.limit
    if reading is None:
        state = "waiting for rows" if path.exists() else "waiting for the file"
        return Group(Text(f"{path}: {state}", style="dim"), *notes)
    table = Table(box=None, pad_edge=False, header_style="bold")
    nearest = "largest" if limit is None else "nearest its limit"
    for title in ("segment", f"{WINDOW} s", "so far", nearest, "gap"):
        table.add_column(title, justify="left" if title in ("segment", nearest) else "right", overflow="fold")
    table.add_column("" if limit is None else "of the limit│", width=BAR)
    shares = reading.recent if limit is None else reading.recent / limit
    at = round(BAR * CALM)  # where the bar marks the limit
    for segment in monitor.segments:
        means = [format_gap(monitor, values, segment) for values in (reading.recent, reading.overall)]
        own = [k for k, c in enumerate(monitor.channels) if c.segment == segment and np.isfinite(shares[k])]
        if not own:
            table.add_row(name_segment(segment), *means, "not measured", "-", "", style="dim")
            continue
        k, style, bar = max(own, key=lambda i: shares[i]), "default", ""
        if limit is not None:
            style = "green" if shares[k] < CALM else "yellow" if shares[k] <= HIGH else "bold red"
            full = min(round(shares[k] * at), BAR)
            bar = "".join("█" if i < full else "│" if i == at else " " for i in range(BAR))
        cells = (name_segment(segment), *means, monitor.channels[k].column, f"{reading.recent[k]:.1f}", bar)
        table.add_row(*cells, style=style)
    if limit is not None and not reading.full:
        state = Text(f"the alarm begins after {SKIP + WINDOW} s", style="dim")
    elif monitor.alarm is not None:
        state = Text(describe_alarm(monitor, monitor.alarm, path), style="bold red")
    elif monitor.alarms:
        last = describe_alarm(monitor, monitor.alarms[-1], path)
        state = Text(f"no alarm now; {len(monitor.alarms)} so far, the last: {last}", style="yellow")
    else:
        state = Text(describe_rate(monitor), style="dim" if limit is None else "green")
    cost = f"{1e3 * monitor.busy / max(monitor.frames, 1):.2f} of {1e3 * monitor.machine.frame:g} ms a frame"
    head = Text(f"{path}  {reading.second} s  gap in noise standard deviations  {cost}", style="bold")
    return Group(head, table, state, *notes)


def format_gap(monitor: Monitor, values: np.ndarray, segment: str) -> str:
    """RMS of gaps (channels,) [noise standard deviations] over a segment's channels; `-` if none is measured."""
    own = values[[c.segment == segment and np.isfinite(v) for c, v in zip(monitor.channels, values)]]
    return f"{np.sqrt(np.mean(own**2)):.1f}" if len(own) else "-"


def describe_reading(monitor: Monitor, reading: Reading) -> str:
    """A reading as one line of plain text."""
    gaps = (f"{name_segment(s)} {format_gap(monitor, reading.recent, s):>5s}" for s in monitor.segments)
    return f"{reading.second:6d} s  {'  '.join(gaps)}"


def summarise(monitor: Monitor, path: Path) -> list[str]:
    """Last lines of a run; a log too short for an alarm, and a large gap that raised none, say so."""
    reading, frames, duration = monitor.reading, monitor.frames, monitor.frames * monitor.machine.frame
    needed = f"a gap needs more than {SKIP} s, and an alarm {SKIP + WINDOW} s"
    if reading is None:
        return [f"{path}: {frames} frames, {duration:.3g} s, are too few: {needed}"]
    gaps = "  ".join(f"{name_segment(s)} {format_gap(monitor, reading.overall, s)}" for s in monitor.segments)
    lines = [
        f"{path}: {duration:.0f} s, {frames} frames, {1e3 * monitor.busy / max(frames, 1):.2f} ms each",
        f"gap since the start in noise standard deviations: {gaps}",
    ]
    if monitor.alarms:
        first = describe_alarm(monitor, monitor.alarms[0], path)
        return [*lines, f"{len(monitor.alarms)} alarms, the first: {first}"]
    at = int(np.argmax(np.nan_to_num(reading.overall)))
    if reading.overall[at] > LARGE:
        channel = monitor.channels[at]
        lines.append(
            f"the gap is large: {channel.column}, {name_segment(channel.segment)}, {reading.overall[at]:.1f} noise "
            f"standard deviations; for the cause: exodrake diagnose {path}"
        )
    if not reading.full and monitor.limit is not None:
        return [*lines, f"no alarm is possible: the log is too short, {needed}"]
    return [*lines, describe_rate(monitor)]
