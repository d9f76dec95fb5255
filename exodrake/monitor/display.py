"""What a terminal shows: blocks coloured by their gap, and the alarm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exodrake.monitor.alarm import Alarm, calibration
from exodrake.monitor.calibrate import share_at_most
from exodrake.monitor.companion import LOOP
from exodrake.monitor.gap import SKIP, WINDOW, Reading
from exodrake.monitor.watcher import BLOCKS, Watch

if TYPE_CHECKING:
    from rich.console import RenderableType

NAMES = {LOOP: "whole loop"}
HOLDS = {
    "controller": "controller",
    "motor": "motor (bus, drive, encoder)",
    "tendon": "tendon (wire, load cell)",
    "finger": "finger (sheath, joints, motion capture)",
    LOOP: "whole loop, no block alone",
}
CALM, HIGH = 0.5, 1.0  # of the limit: below the first green, above the second red
BAR = 24  # characters
EVERY = 10  # s of the log between plain lines


def rate() -> str:
    """The stated rate of false alarms."""
    made = calibration()
    return f"at most {share_at_most(made['robots']):.0%} of healthy robots raise one in {made['minutes']:g} minutes"


def sentence(alarm: Alarm, path: Path) -> str:
    """An alarm in words."""
    where = HOLDS[alarm.channel.segment]
    more = f" and {alarm.above - 1} more" if alarm.above > 1 else ""
    return (
        f"ALARM at {alarm.second} s: {where}, {alarm.channel.column} is {alarm.gap:.1f} floors off over {WINDOW} s "
        f"(limit {alarm.limit:.1f}){more}; for the cause: exodrake diagnose {path}"
    )


def worst(watch: Watch, values: np.ndarray, block: str) -> tuple[str, float, float]:
    """A block's channel that is nearest its limit: column, gap [floors], share of the limit; ("", nan, nan) if nothing
    is measured."""
    places = [k for k, c in enumerate(watch.listed) if c.segment == block and np.isfinite(values[k])]
    if not places:
        return "", float("nan"), float("nan")
    k = max(places, key=lambda i: values[i] / watch.limit[i])
    return watch.listed[k].column, float(values[k]), float(values[k] / watch.limit[k])


def colour(share: float) -> str:
    """Colour of a share of the limit."""
    return "dim" if share != share else "green" if share < CALM else "yellow" if share <= HIGH else "bold red"


def bar(share: float) -> str:
    """A share of the limit as a bar; the mark stands at the limit."""
    if share != share:
        return ""
    at = round(BAR * CALM)  # of the limit
    full = min(round(share * at), BAR)
    return "".join("│" if k == at and k >= full else "█" if k < full else " " for k in range(BAR))


def screen(watch: Watch, path: Path) -> RenderableType:
    """The whole display."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    if watch.reading is None:
        what = "waiting for rows" if path.exists() else "waiting for the file"
        return Group(Text(f"{path}: {what}", style="dim"), *footer(watch))
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title, side in (
        ("block", "left"),
        (f"{WINDOW} s", "right"),
        ("so far", "right"),
        ("nearest its limit", "left"),
    ):
        table.add_column(title, justify=side)  # pyright: ignore
    table.add_column("floors", justify="right")
    table.add_column("of the limit│", width=BAR)
    for block in BLOCKS:
        column, gap, share = worst(watch, watch.reading.recent, block)
        tint = colour(share)
        cells = [
            NAMES.get(block, block),
            *(shown(watch.block(v, block)) for v in (watch.reading.recent, watch.reading.overall)),
        ]
        table.add_row(*(Text(c, style=tint) for c in (*cells, column or "not measured", shown(gap), bar(share))))
    return Group(Text(head(watch, path), style="bold"), table, *verdict(watch, path), *footer(watch))


def verdict(watch: Watch, path: Path) -> list[RenderableType]:
    """The alarm that is on, the last that was, or the rate that is to be expected."""
    from rich.text import Text

    if watch.reading is not None and not watch.reading.full:
        return [Text(f"the alarm begins after {SKIP + WINDOW} s", style="dim")]
    if watch.alarm is not None:
        return [Text(sentence(watch.alarm, path), style="bold red")]
    if watch.alarms:
        return [
            Text(f"quiet now; {len(watch.alarms)} so far, the last: {sentence(watch.alarms[-1], path)}", style="yellow")
        ]
    return [Text(f"no alarm ({rate()})", style="green")]


def footer(watch: Watch) -> list[RenderableType]:
    """Notes on what happened to the log."""
    from rich.text import Text

    return [Text(note, style="dim") for note in watch.notes[-3:]]


def head(watch: Watch, path: Path) -> str:
    """File, time in the log, and what a frame costs."""
    second = watch.reading.second if watch.reading else 0
    frame = watch.robot.machine.frame
    cost = watch.busy / max(watch.frames, 1)
    return f"{path}  {second} s  gap in floors (1 = sensor noise)  {1e3 * cost:.2f} of {1e3 * frame:g} ms a frame"


def shown(value: float) -> str:
    """A gap with one digit."""
    return "-" if value != value else f"{value:.1f}"


def line(watch: Watch, reading: Reading) -> str:
    """A reading as one line of plain text."""
    blocks = "  ".join(f"{NAMES.get(b, b)} {shown(watch.block(reading.recent, b)):>5s}" for b in BLOCKS)
    return f"{reading.second:6d} s  {blocks}"


def summary(watch: Watch, path: Path) -> list[str]:
    """What is said in the end."""
    if watch.reading is None:
        return [f"{path}: {watch.frames} frames, too short for a gap"]
    blocks = "  ".join(f"{NAMES.get(b, b)} {shown(watch.block(watch.reading.overall, b))}" for b in BLOCKS)
    seconds = watch.frames * watch.robot.machine.frame
    said = [f"{path}: {seconds:.0f} s, {watch.frames} frames, {1e3 * watch.busy / max(watch.frames, 1):.2f} ms each"]
    said += [f"gap since the start in floors: {blocks}"]
    if not watch.alarms:
        return [*said, f"no alarm ({rate()})"]
    return [*said, f"{len(watch.alarms)} alarms, the first: {sentence(watch.alarms[0], path)}"]
