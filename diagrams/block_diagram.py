"""Draws a machine's signals and its schedule as SVG.

Parts stand on the diagonal. What a part writes leaves along its row, to the right or, against the stream, to the left;
what it reads arrives along its column. The label where row and column meet names the signals. Below, a frame of slots.
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from itertools import permutations

from exodrake.core.errors import argument
from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task

CELL, ROW, BOX, HIGH, MARGIN, TOP = 158, 92, 128, 58, 34, 92  # sizes [px]
STRIP, CHIP, LINE = 64, 30, 15
OUTSIDE, LOG = "outside", "log"
INK, SOFT, PAPER, EDGE = "#1f2933", "#7b8794", "#fdfcfa", "#9aa5b1"
HUES = ("#4c78a8", "#d9822b", "#3f9b7f", "#b65d86", "#8a6fb0", "#b8862e", "#5b8c3e", "#c0504d", "#4a9ca6", "#7a6a58")
STYLE = f"""text {{ font-family: 'Inter', 'Segoe UI', 'Helvetica Neue', Arial, sans-serif; fill: {INK}; }}
.title {{ font-size: 21px; font-weight: 650; }} .sub {{ font-size: 13px; fill: {SOFT}; }}
.part {{ font-size: 15px; font-weight: 650; text-anchor: middle; }} .when {{ font-size: 11px; text-anchor: middle; }}
.signal {{ font-size: 11.5px; text-anchor: middle; }} .unit {{ fill: {SOFT}; }}
.small {{ font-size: 11px; fill: {SOFT}; }}
.chip {{ font-size: 11px; fill: white; font-weight: 600; text-anchor: middle; }}
.mid {{ text-anchor: middle; }} .line {{ fill: none; stroke-width: 1.7; }}"""


def links(machine: Machine) -> dict[tuple[str, str], list[str]]:
    """(writer, reader) -> signals, with what comes from outside and what the log shows."""
    writer = {w: b.name for b in machine.parts for o in b.outputs for w in o.writes} | dict.fromkeys(
        machine.inputs, OUTSIDE
    )
    found: dict[tuple[str, str], list[str]] = {}
    reads = [(b.name, w) for b in machine.parts for item in (*b.tasks, *b.outputs) for w in item.reads]
    for reader, signal in [*reads, *((LOG, column.signal) for column in machine.columns)]:
        signals = found.setdefault((writer[signal], reader), [])
        if signal not in signals and writer[signal] != reader:
            signals.append(signal)
    return {pair: signals for pair, signals in found.items() if signals}


def stream_order(machine: Machine) -> list[str]:
    """Parts in the order of the signal: fewest links against the stream, then shortest; the machine's if too many."""
    names = [part.name for part in machine.parts]
    pairs = [(a, b) for a, b in links(machine) if a in names and b in names]

    def cost(order: tuple[str, ...]) -> tuple[int, int]:
        rank = {name: i for i, name in enumerate(order)}
        back = [pair for pair in pairs if rank[pair[0]] > rank[pair[1]]]
        return len(back), sum(abs(rank[a] - rank[b]) for a, b in pairs)

    return list(min(permutations(names), key=cost)) if len(names) <= 7 else names


def wiring_svg(machine: Machine, shares: Mapping[str, float] | None = None, schedule: bool = True) -> str:
    """The drawing as SVG text.

    Args:
        machine: what is drawn.
        shares: part -> 0 .. 1, how much of something (a gap, say) it accounts for: colours the parts, written in them.
            The prefix of effects (`tendon`, `timing`) counts for the parts that these sit on.
        schedule: whether the slots of a frame are drawn below.
    """
    machine = argument("machine", machine, Machine)
    shares = None if shares is None else part_shares(machine, shares)
    order = [OUTSIDE, *stream_order(machine), LOG]
    hue = {name: HUES[i % len(HUES)] for i, name in enumerate(order[1:-1])} | {OUTSIDE: SOFT, LOG: SOFT}
    width = 2 * MARGIN + CELL * len(order)
    grid = TOP + ROW * len(order)
    chips = max(len(tasks_in(machine, slot)) for slot in range(machine.slots))
    height = grid + (96 + STRIP + (CHIP + 4) * chips if schedule else 16)
    body = [
        f'<text class="title" x="{MARGIN}" y="42">{escape(machine.name.replace("_", "-"))}: parts and signals</text>',
        f'<text class="sub" x="{MARGIN}" y="64">A part writes along its row and reads along its column. '
        f"Frame {1e3 * machine.frame:g} ms, {machine.slots} slots.</text>",
        *(draw_link(order, hue, pair) for pair in links(machine)),
        *(draw_label(machine, order, hue, pair, signals) for pair, signals in links(machine).items()),
        *(draw_part(machine, order, hue, name, shares) for name in order),
        *(draw_strip(machine, hue, grid + 40, width - 2 * MARGIN) if schedule else ()),
    ]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
    markers = "".join(arrow(colour) for colour in sorted(set(hue.values())))
    paper = f'<rect width="{width}" height="{height}" fill="{PAPER}"/>'
    return "\n".join([head, f"<style>{STYLE}</style>", f"<defs>{markers}</defs>", paper, *body, "</svg>"]) + "\n"


def part_shares(machine: Machine, shares: Mapping[str, float]) -> dict[str, float]:
    """Shares by part: a name that is no part's is a prefix of effects and is split over the parts that carry them."""
    parts = {part.name: shares.get(part.name, 0.0) for part in machine.parts}
    for name in set(shares) - set(parts):
        carried = {b.name: sum(e.block == name for e in machine.effects_on(b)) for b in machine.parts}
        for part, count in carried.items():
            parts[part] += shares[name] * count / max(sum(carried.values()), 1)
    return parts


def arrow(colour: str) -> str:
    """An arrowhead of a colour."""
    return (
        f'<marker id="a{colour[1:]}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto">'
        f'<path d="M0,0.6 L7.4,4 L0,7.4 z" fill="{colour}"/></marker>'
    )


def centre(order: list[str], name: str) -> tuple[float, float]:
    """Middle of a part's box [px]."""
    i = order.index(name)
    return MARGIN + CELL * (i + 0.5), TOP + ROW * (i + 0.5)


def draw_link(order: list[str], hue: Mapping[str, str], pair: tuple[str, str]) -> str:
    """A line along the writer's row, then along the reader's column, with a rounded corner."""
    (x0, y0), (x1, y1) = centre(order, pair[0]), centre(order, pair[1])
    way = 1 if x1 > x0 else -1
    colour, r = hue[pair[0]], 10
    d = f"M{x0 + way * BOX / 2},{y0} H{x1 - way * r} Q{x1},{y0} {x1},{y0 + way * r} V{y1 - way * (HIGH / 2 + 2)}"
    return f'<path class="line" d="{d}" stroke="{colour}" marker-end="url(#a{colour[1:]})"/>'


def draw_label(
    machine: Machine, order: list[str], hue: Mapping[str, str], pair: tuple[str, str], signals: list[str]
) -> str:
    """Names and units of the signals where row and column meet."""
    x, y = centre(order, pair[1])[0], centre(order, pair[0])[1]
    units = {signal: machine.signal[signal].unit for signal in signals}
    longest = max(len(signal) + (len(unit) + 2 if unit != "-" else 0) for signal, unit in units.items())
    w, h = 6.3 * longest + 14, LINE * len(signals) + 8
    lines = [
        f'<rect x="{x - w / 2}" y="{y - h / 2}" width="{w}" height="{h}" rx="5" fill="white" stroke="{hue[pair[0]]}"/>'
    ]
    for k, signal in enumerate(signals):
        unit = f' <tspan class="unit">{escape(units[signal])}</tspan>' if units[signal] != "-" else ""
        lines.append(f'<text class="signal" x="{x}" y="{y - h / 2 + 15 + LINE * k}">{escape(signal)}{unit}</text>')
    return "\n".join(lines)


def draw_part(
    machine: Machine, order: list[str], hue: Mapping[str, str], name: str, shares: Mapping[str, float] | None
) -> str:
    """A part's box: name, when it runs, how many effects it may carry; filled by its share."""
    x, y = centre(order, name)
    part = next((b for b in machine.parts if b.name == name), None)
    share = min(max((shares or {}).get(name, 0.0), 0.0), 1.0)
    fill = blend("#ffffff", "#f28e2b", share) if shares is not None else blend("#ffffff", hue[name], 0.16)
    dash = "" if part else ' stroke-dasharray="5 4"'
    box = (
        f'<rect x="{x - BOX / 2}" y="{y - HIGH / 2}" width="{BOX}" height="{HIGH}" rx="9" fill="{fill}" '
        f'stroke="{hue[name]}" stroke-width="2"{dash}/>'
    )
    under = when(part) if part else {OUTSIDE: "one row a frame", LOG: "end of the frame"}[name]
    tone = "when" if shares is not None else "when unit"
    if shares is not None and part:
        under = f"{100 * share:.0f} %"
    return (
        f'{box}\n<text class="part" x="{x}" y="{y - 2}">{escape(name)}</text>'
        f'<text class="{tone}" x="{x}" y="{y + 16}">{escape(under)}</text>'
    )


def when(part: Part) -> str:
    """Slots in which a part's tasks run, in words."""
    slots = sorted({slot for task in part.tasks for slot in task.slots})
    parts = ["every tick"] if any(not task.slots for task in part.tasks) else []
    if slots:
        run = slots == list(range(slots[0], slots[-1] + 1)) and len(slots) > 1
        parts.append(f"slots {slots[0]}–{slots[-1]}" if run else "slot " + ", ".join(map(str, slots)))
    return ", ".join(parts)


def blend(light: str, dark: str, share: float) -> str:
    """A colour between two."""
    pairs = ((int(light[i : i + 2], 16), int(dark[i : i + 2], 16)) for i in (1, 3, 5))
    return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in pairs)


def tasks_in(machine: Machine, slot: int) -> list[tuple[Part, Task]]:
    """Tasks that run in a slot."""
    return [(part, task) for part in machine.parts for task in part.tasks if slot in task.slots]


def draw_strip(machine: Machine, hue: Mapping[str, str], top: float, width: float) -> list[str]:
    """One frame: slots with their tasks in the middle, and the plant's ticks between them."""
    step, base = width / machine.slots, top + STRIP
    ticking = ", ".join(b.name for b in machine.parts if any(not t.slots for t in b.tasks))
    lines = [
        f'<text class="part" style="text-anchor:start" x="{MARGIN}" y="{top}">One frame</text>',
        f'<text class="small" x="{MARGIN + 84}" y="{top}">▲ tick of the plant ({escape(ticking)}), '
        "before the task in the middle of its slot</text>",
    ]
    for slot in range(machine.slots):
        x = MARGIN + step * slot
        shade = "#ffffff" if slot % 2 else "#f1efea"
        here, at = tasks_in(machine, slot), 1e3 * machine.slot * (slot + 0.5)
        lines += [
            f'<rect x="{x}" y="{top + 18}" width="{step}" height="{STRIP - 18}" fill="{shade}" stroke="{EDGE}" '
            'stroke-width="0.6"/>',
            f'<text class="when" x="{x + step / 2}" y="{top + 36}">slot {slot}</text>',
            f'<text class="small mid" x="{x + step / 2}" y="{top + 53}">{at:g} ms</text>',
            f'<path d="M{x + step / 4 - 5},{base} h10 l-5,-9 z" fill="{SOFT}"/>',
        ]
        for k, (part, task) in enumerate(here):
            lines.append(
                draw_chip(machine, hue, part, task, slot, (x + step / 2, base + 8 + (CHIP + 4) * k), step - 10)
            )
    return lines


def draw_chip(
    machine: Machine,
    hue: Mapping[str, str],
    part: Part,
    task: Task,
    slot: int,
    place: tuple[float, float],
    width: float,
) -> str:
    """A task in its slot; a task over channels names its channel."""
    x, y = place
    channel = machine.channels(task.reads[0])[task.slots.index(slot)] if task.per_channel else ""
    text = escape(" ".join(filter(None, (part.name, task.function, channel))))
    return (
        f'<rect x="{x - width / 2}" y="{y}" width="{width}" height="{CHIP}" rx="6" fill="{hue[part.name]}"/>'
        f'<text class="chip" x="{x}" y="{y + 19}">{text}</text>'
    )
