"""Draws a machine's signals and its schedule as SVG.

Parts stand on the diagonal. What a part writes leaves along its row, to the right or, against the stream, to the left;
what it reads arrives along its column. The label where row and column meet names the signals. Below, a frame of slots.
"""

from collections.abc import Mapping
from html import escape
from itertools import accumulate, permutations, starmap

from exodrake.core.errors import argument
from exodrake.core.machine import Machine

MARGIN, GAP, ROW, BOX, LINE, CHIP = 12, 12, 14, 42, 15, 34  # px: round all, between columns and rows, heights
LETTER = 6.1  # px, width of a letter of a signal
OUTSIDE, LOG = "outside", "log"
INK, SOFT, EDGE, SHARE = "#1f2933", "#5f6b7a", "#9aa5b1", "#f28e2b"
HUES = ("#4c78a8", "#c46f14", "#3f9b7f", "#b65d86", "#8a6fb0", "#a0731f", "#5b8c3e", "#c0504d", "#3d8e98", "#7a6a58")
STYLE = f"""text {{ font: 12px 'Inter', 'Segoe UI', 'Helvetica Neue', 'Liberation Sans', Arial, sans-serif; fill: {INK};
text-anchor: middle; }}
.left {{ text-anchor: start; }} .title {{ font-size: 20px; font-weight: 650; }}
.part {{ font-size: 14px; font-weight: 650; }}
.soft {{ fill: {SOFT}; }} .chip {{ fill: white; font-weight: 600; }} .line {{ fill: none; stroke-width: 1.6; }}"""


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


def part_shares(machine: Machine, shares: Mapping[str, float]) -> dict[str, float]:
    """Shares by part: a name that is no part's is a prefix of effects and is split over the parts that carry them."""
    parts = {part.name: shares.get(part.name, 0.0) for part in machine.parts}
    for name in set(shares) - set(parts):
        carried = {b.name: sum(e.block == name for e in machine.effects_on(b)) for b in machine.parts}
        for part, count in carried.items():
            parts[part] += shares[name] * count / max(sum(carried.values()), 1)
    return parts


def wiring_svg(machine: Machine, shares: Mapping[str, float] | None = None, schedule: bool = True) -> str:
    """The drawing as SVG text.

    Args:
        machine: what is drawn.
        shares: part -> 0 .. 1, how much of something (a gap, say) it accounts for: colours the parts, written in them.
            The prefix of effects (`tendon`, `timing`) counts for the parts that these sit on.
        schedule: whether there is a title above, and the slots of a frame below.

    Examples:
        >>> import exodrake as exo
        >>> wiring_svg(exo.load_robot().machine)[:4]
        '<svg'
    """
    machine = argument("machine", machine, Machine)
    order, found = [OUTSIDE, *stream_order(machine), LOG], links(machine)
    hue = {name: HUES[i % len(HUES)] for i, name in enumerate(order[1:-1])} | {OUTSIDE: SOFT, LOG: SOFT}
    notes, fills = {OUTSIDE: "a row a frame", LOG: "end of frame"}, {name: blend(hue[name], 0.16) for name in order}
    for part in machine.parts:  # when its tasks run
        slots = sorted({slot for task in part.tasks for slot in task.slots})
        run = len(slots) > 1 and slots == list(range(slots[0], slots[-1] + 1))
        parts = ["every tick"] if any(not task.slots for task in part.tasks) else []
        parts += [f"slots {slots[0]}–{slots[-1]}" if run else "slot " + ", ".join(map(str, slots))] if slots else []
        notes[part.name] = ", ".join(parts)
    if shares is not None:
        within = dict.fromkeys(order, 0.0) | part_shares(machine, shares)
        within = {name: min(max(share, 0.0), 1.0) for name, share in within.items()}
        notes |= {part.name: f"{100 * within[part.name]:.0f} %" for part in machine.parts}
        fills = {name: blend(SHARE, share) for name, share in within.items()}
    units = {signal.name: "" if signal.unit == "-" else signal.unit for signal in machine.signals}
    texts = {pair: [(name, units[name]) for name in names] for pair, names in found.items()}
    labels = {  # widths and heights
        pair: (LETTER * max(len(f"{name} {unit}".strip()) for name, unit in lines) + 15, LINE * len(lines) + 8)
        for pair, lines in texts.items()
    }
    boxes = {name: max(1.5 * LETTER * len(name), LETTER * len(notes[name])) + 16 for name in order}
    widths = [max([boxes[name], *(w for (_, to), (w, _) in labels.items() if to == name)]) + GAP for name in order]
    heights = [max([BOX, *(h for (by, _), (_, h) in labels.items() if by == name)]) + ROW for name in order]
    top, width, grid = MARGIN + 58 * schedule, 2 * MARGIN + sum(widths), sum(heights)
    x = {name: MARGIN + end - size / 2 for name, end, size in zip(order, accumulate(widths), widths)}
    y = {name: top + end - size / 2 for name, end, size in zip(order, accumulate(heights), heights)}

    def link(writer: str, reader: str) -> str:
        way, colour, r = 1 if x[reader] > x[writer] else -1, hue[writer], 8
        start, end = x[writer] + way * boxes[writer] / 2, y[reader] - way * (BOX / 2 + 2)
        d = f"M{start:.1f},{y[writer]:.1f} H{x[reader] - way * r:.1f} "
        d += f"Q{x[reader]:.1f},{y[writer]:.1f} {x[reader]:.1f},{y[writer] + way * r:.1f} V{end:.1f}"
        return f'<path class="line" d="{d}" stroke="{colour}" marker-end="url(#a{colour[1:]})"/>'

    def label(writer: str, reader: str) -> str:
        w, h = labels[writer, reader]
        left, above = x[reader] - w / 2, y[writer] - h / 2
        lines = [rectangle(left, above, w, h, "white", hue[writer])]
        for k, (name, unit) in enumerate(texts[writer, reader]):
            span = f' <tspan class="soft">{escape(unit)}</tspan>' if unit else ""
            lines.append(text(x[reader], above + 15 + LINE * k, escape(name) + span))
        return "\n".join(lines)

    def box(name: str) -> str:
        extra = 'stroke-width="2"' + ("" if name in order[1:-1] else ' stroke-dasharray="5 4"')
        left, above = x[name] - boxes[name] / 2, y[name] - BOX / 2
        drawn = rectangle(left, above, boxes[name], BOX, fills[name], hue[name], extra)
        return f"{drawn}\n{text(x[name], y[name] - 2, escape(name), 'part')}{text(x[name], y[name] + 15, notes[name])}"

    body = [*starmap(link, found), *starmap(label, found), *map(box, order)]
    height = top + grid + MARGIN
    if schedule:
        title = f"{machine.name.replace('_', '-')}: parts and signals"
        how = f"A part writes along its row and reads along its column. Frame {1e3 * machine.frame:g} ms."
        body += [text(MARGIN, MARGIN + 20, escape(title), "left title"), text(MARGIN, MARGIN + 42, how, "left soft")]
        strip, height = draw_frame(machine, hue, top + grid + 26, width - 2 * MARGIN)
        body += strip
    arrow = 'viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto"'
    arrow += '><path d="M0,.6 L7.4,4 L0,7.4 z"'
    markers = "".join(f'<marker id="a{c[1:]}" {arrow} fill="{c}"/></marker>' for c in sorted(set(hue.values())))
    size = f'viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<style>{STYLE}</style>\n<defs>{markers}</defs>'
    return "\n".join([head, f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>', *body, "</svg>"]) + "\n"


def rectangle(x: float, y: float, width: float, height: float, fill: str, edge: str, more: str = "") -> str:
    """A rectangle with round corners."""
    place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
    return f'<rect {place} rx="5" fill="{fill}" stroke="{edge}" {more}/>'


def text(x: float, y: float, content: str, style: str = "") -> str:
    """A line of text at its middle, or at its left end by the style `left`."""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="{style}">{content}</text>'


def blend(colour: str, share: float) -> str:
    """A colour between white and another."""
    return "#" + "".join(f"{round(255 + share * (int(colour[i : i + 2], 16) - 255)):02x}" for i in (1, 3, 5))


def draw_frame(machine: Machine, hue: Mapping[str, str], top: float, width: float) -> tuple[list[str], float]:
    """One frame of slots with their tasks in the middle and the plant's ticks between, and its lower end [px]."""
    step, base = width / machine.slots, top + 64
    ticking = ", ".join(b.name for b in machine.parts if any(not t.slots for t in b.tasks))
    note = f"▲ tick of the plant ({escape(ticking)}), before the task in the middle of its slot"
    lines = [text(MARGIN, top, "One frame", "left part"), text(MARGIN + 84, top, note, "left soft")]
    end = base
    for slot in range(machine.slots):
        x = MARGIN + step * (slot + 0.5)
        shade = "#ffffff" if slot % 2 else "#f3f4f6"
        lines += [
            rectangle(x - step / 2, top + 16, step, 48, shade, EDGE, 'stroke-width="0.6"'),
            text(x, top + 34, f"slot {slot}"),
            text(x, top + 51, f"{1e3 * machine.slot * (slot + 0.5):g} ms", "soft"),
            f'<path d="M{x - step / 4 - 5:.1f},{base} h10 l-5,-9 z" fill="{SOFT}"/>',
        ]
        tasks = [(part, task) for part in machine.parts for task in part.tasks if slot in task.slots]
        for k, (part, task) in enumerate(tasks):
            channel = machine.channels(task.reads[0])[task.slots.index(slot)] if task.per_channel else ""
            y = base + 8 + (CHIP + 4) * k
            lines.append(rectangle(x - step / 2 + 3, y, step - 6, CHIP, hue[part.name], "none"))
            lines.append(text(x, y + 14, escape(part.name), "chip"))
            lines.append(text(x, y + 28, escape(f"{task.function} {channel}".strip()), "chip"))
            end = max(end, y + CHIP)
    return lines, end + MARGIN
