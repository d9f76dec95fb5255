"""`docs/real.md` from the results."""

from __future__ import annotations

from exodrake.core.errors import markdown_table
from exodrake.diagnosis.result import Diagnosis, Interval
from studies.real_machines.exam import Mark, table
from studies.real_machines.study import Result

Texts = dict[str, dict[str, str]]


def page(results: list[Result], marks: list[Mark], texts: Texts) -> str:
    """The page in Markdown.

    Args:
        results: a section each.
        marks: of the exam.
        texts: of `texts.yaml`: set -> its title, published results and a remark; `page` -> head and last section.
    """
    agree, better = (sum(rows) for rows in ([m.agrees for m in marks], [m.no_worse for m in marks if m.errors]))
    counts = (
        f"{agree} of {len(marks)} answers agree; {better} of {sum(bool(m.errors) for m in marks)} predict no worse."
    )
    parts = [texts["page"]["head"], counts + "\n", table(marks) + "\n", texts["page"]["sets"]]
    for result in results:
        text = texts[result.name]
        parts += [f"## {text['title']}\n\n{text['published'].strip()}\n", verdict(result.diagnosis)]
        parts += [f"{title}:\n\n{markdown_table(rows[0], rows[1:])}\n" for title, rows in result.tables.items()]
        parts += [f"![{result.name}](real/{name})\n" for name in result.figures]
        parts.append(text.get("remark", "").strip() + "\n")
    parts.append(texts["page"]["shortcomings"])
    return "\n".join(parts).rstrip() + "\n"


def verdict(found: Diagnosis) -> str:
    """Verdict, place, effects with parameters, and closure."""
    place = ", ".join(found.where.joints)
    overall = found.closure.overall
    lines = [
        f"**{found.verdict}**, in the *{found.where.block}*" + (f" ({place})" if place else "") + ".",
        f"Closure on held-out logs {overall.value:.4f} ({overall.low:.4f} to {overall.high:.4f}), "
        f"{found.run_time:.0f} s.",
    ]
    lines += [f"Why: {reason}." for reason in found.reasons]
    rows: list[tuple[str, ...]] = [("effect", "parameter", "joint", "value", "90 % interval")]
    for effect in found.effects:
        for name, item in effect.parameters.items():
            channels = effect.channels.get(name, {}) or {"": item}
            rows += [(effect.id, name, channel, *cells(one)) for channel, one in channels.items()]
    return "\n".join([*lines, "", markdown_table(rows[0], rows[1:]) if len(rows) > 1 else "", ""])


def cells(item: Interval) -> tuple[str, str]:
    """Value with unit, and interval."""
    unit = "" if item.unit == "-" else f" {item.unit}"
    return f"{item.value:.4g}{unit}", f"{item.low:.4g} to {item.high:.4g}"
