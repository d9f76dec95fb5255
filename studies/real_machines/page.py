"""`docs/real.md` from the results."""

from __future__ import annotations

from exodrake.diagnosis.result import Diagnosis, Interval
from studies.real_machines.study import Result

HEAD = """# Real machines

Four recordings that other people made, each read by its importer and diagnosed by the command that serves the
Exo-Index: the same search, the same thresholds. The recordings are not in this repository; this page is written by

    python -m studies.real_machines --data DIR --out docs

A machine is a robot file (`exodrake/machines/NAME/robot.yaml`: numbers with sources, and which of them scatter) and a
table of its parts and effects (`exodrake/machines/NAME/machine.py`). To diagnose one by hand:

    exodrake import DIR/emps --from emps --out my_case
    exodrake diagnose my_case --robot emps --report report.html

Noise floors come from cycles that repeat (EMPS, sheath), from joints at rest (dVRK) or from the encoder's step
(SO-101), never from a model's residual; each robot file says which. A floor is a fraction of what any of these models
leaves: repeats are far better than the physics we write down. So `NAMED` here means that the effects remove all but a
small share of the gap, not that they reach the floor.
"""
FALLS_SHORT = "## What falls short\n\n"


def page(results: list[Result], words: dict[str, dict[str, str]]) -> str:
    """The page. words: set -> its title, what is published, and a remark; `short` -> the last section's remark."""
    parts = [HEAD]
    for result in results:
        said = words[result.name]
        parts += [f"## {said['title']}\n\n{said['published'].strip()}\n", verdict(result.diagnosis)]
        parts += [f"{title}:\n\n{table(rows)}\n" for title, rows in result.tables.items()]
        parts += [f"![{result.name}](real/{name})\n" for name in result.figures]
        parts.append(said.get("remark", "").strip() + "\n")
    parts.append(FALLS_SHORT + words["short"]["remark"])
    return "\n".join(parts).rstrip() + "\n"


def verdict(found: Diagnosis) -> str:
    """Verdict, place, effects with parameters, closure, in a few lines."""
    place = ", ".join(found.where.joints)
    shares = "; ".join(f"{s} {v:.0%}" for s, v in found.where.segments.items())
    lines = [
        f"**{found.verdict}**, in the *{found.where.block}*" + (f" ({place})" if place else "") + ".",
        f"Closure on held-out logs {found.closure.overall.value:.4f} "
        f"({found.closure.overall.low:.4f} to {found.closure.overall.high:.4f}), {found.seconds:.0f} s.",
    ]
    if shares:
        lines.append(f"Shares of the segments between measured wires: {shares}.")
    lines += [f"Why: {reason}." for reason in found.reasons]
    rows: list[tuple[str, ...]] = [("effect", "parameter", "joint", "value", "90 % interval")]
    for effect in found.effects:
        for name, item in effect.parameters.items():
            channels = effect.channels.get(name, {})
            rows += [(effect.id, name, channel, *cells(one)) for channel, one in channels.items()] or [
                (effect.id, name, "", *cells(item))
            ]
    return "\n".join([*lines, "", table(rows) if len(rows) > 1 else "", ""])


def cells(item: Interval) -> tuple[str, str]:
    """Value with unit, and interval."""
    unit = "" if item.unit == "-" else f" {item.unit}"
    return f"{item.value:.4g}{unit}", f"{item.low:.4g} to {item.high:.4g}"


def table(rows: list[tuple[str, ...]]) -> str:
    """A table in Markdown, the first row its header."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])
