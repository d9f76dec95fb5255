"""Draws a machine's signals and its schedule as SVG.

Parts stand on the diagonal. What a part writes leaves along its row, to the right or, against the stream, to the left;
what it reads arrives along its column. The label where row and column meet names the signals. Below, a frame of slots.
"""

from collections.abc import Mapping
from itertools import accumulate, groupby, permutations
from pathlib import Path

from exodrake.core.errors import argument
from exodrake.core.templates import render
from exodrake.model.machine import Machine

MARGIN, GAP, ROW, BOX, LINE, CHIP = 12, 12, 14, 42, 15, 34  # px: round all, between columns and rows, heights
LETTER = 6.1  # px, width of a letter of a signal
OUTSIDE, LOG = "outside", "log"
SOFT, EDGE, SHARE = "#5f6b7a", "#9aa5b1", "#f28e2b"
HUES = ("#4c78a8", "#c46f14", "#3f9b7f", "#b65d86", "#8a6fb0", "#a0731f", "#5b8c3e", "#c0504d", "#3d8e98", "#7a6a58")
TEMPLATES = Path(__file__).parent / "templates"


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
    order, joined = [OUTSIDE, *stream_order(machine), LOG], links(machine)
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
    texts = {pair: [(name, units[name]) for name in names] for pair, names in joined.items()}
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

    drawn = [
        {
            "x": x[reader], "y": y[writer], "way": (way := 1 if x[reader] > x[writer] else -1), "hue": hue[writer],
            "start": x[writer] + way * boxes[writer] / 2, "end": y[reader] - way * (BOX / 2 + 2),
            "width": labels[writer, reader][0], "height": labels[writer, reader][1], "lines": texts[writer, reader],
        }
        for writer, reader in joined
    ]  # fmt: skip
    blocks = [
        {"name": name, "note": notes[name], "x": x[name], "y": y[name], "width": boxes[name], "fill": fills[name],
         "hue": hue[name], "part": name in order[1:-1]}
        for name in order
    ]  # fmt: skip
    found = [
        [(p.name, f"{t.function} {machine.channels(t.reads[0])[t.slots.index(k)] if t.per_channel else ''}".strip())
         for p in machine.parts for t in p.tasks if k in t.slots]
        for k in range(machine.slots if schedule else 0)
    ]  # fmt: skip
    runs = [list(run) for _, run in groupby(range(len(found)), found.__getitem__)]  # neighbours with the same tasks
    letters = max((len(word) for tasks in found for word in ("slots 00-00", *sum(tasks, ()))), default=0)
    below, step = top + grid + 26, max(LETTER * letters + 16, (width - 2 * MARGIN) / max(len(runs), 1))
    width, slots = max(width, 2 * MARGIN + step * len(runs)), []
    for k, run in enumerate(runs):
        ends = list(dict.fromkeys((run[0], run[-1])))
        name = f"slot{'s' * (len(ends) > 1)} {'–'.join(map(str, ends))}"
        time = "–".join(f"{1e3 * machine.slot * (end + 0.5):g}" for end in ends) + " ms"
        slots.append({"x": MARGIN + step * (k + 0.5), "tasks": found[run[0]], "name": name, "time": time})
    most = max((len(slot["tasks"]) for slot in slots), default=0)
    chips = CHIP + (CHIP + 4) * (most - 1) + 8 if most else 0
    height = below + 64 + chips + MARGIN if schedule else top + grid + MARGIN
    return render(
        "block_diagram.html", TEMPLATES, width=f"{width:.0f}", height=f"{height:.0f}",
        markers=sorted(set(hue.values())), links=drawn, boxes=blocks,
        machine=machine if schedule else None, slots=slots, top=below, step=step, hue=hue,
        ticking=", ".join(b.name for b in machine.parts if any(not t.slots for t in b.tasks)),
        margin=MARGIN, line=LINE, box=BOX, chip=CHIP, soft=SOFT, edge=EDGE,
    ) + "\n"  # fmt: skip


def blend(colour: str, share: float) -> str:
    """A colour between white and another."""
    return "#" + "".join(f"{round(255 + share * (int(colour[i : i + 2], 16) - 255)):02x}" for i in (1, 3, 5))
