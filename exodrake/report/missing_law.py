"""Section "the missing law" of the report, and its lines in the terminal: a free law, where it acts, how sure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.diagnosis.result import Diagnosis
from exodrake.model.display import PALETTE, SYMBOLS, shown_unit
from exodrake.report import wording as w
from exodrake.report.blocks import RULE, SOFT, Drawing, Table, house_style, render_svg

if TYPE_CHECKING:
    from exodrake.diagnosis.discovery.discover import MissingLaw

RELAXES = "relaxation"  # a law over time since a change


def missing_law(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the section's template."""
    law = diagnosis.missing_law
    if law is None or not law.found:
        return {"law": law, "law_lines": law_lines(law), "law_figure": None}
    caption = (
        "The fitted law with its 90 % band; below it, where its variable was in the fitted logs. Where there are no "
        "data the curve is what smoothness makes of its neighbours."
    )
    rows = [(f"`{r.id}`", r.words, w.closure(r.share)) for r in law.others]
    header = ("Law at", "what over what", "share of the excess removed, fitted logs")
    lines = [line.strip() for line in law_lines(law)[1:]]
    return {
        "law": law,
        "law_lines": [line[:1].upper() + line[1:] + "." for line in lines],
        "law_figure": Drawing(figure_svg(law), caption, wide=len(law.curves) > 1),
        "law_table": Table(header, rows, words=2, wide=False),
        "law_module": law.text,
    }


def law_lines(law: MissingLaw | None) -> list[str]:
    """Result of a discovery in lines of text; nothing without one."""
    if law is None:
        return []
    if not law.found:
        return [f"law     none: {law.reason}"]
    seat = f" of {', '.join(law.channels)}" if law.channels else ""
    lines = [f"law     {law.id}: {law.words}{seat}", f"        {law.reason}"]
    if law.closure is not None and np.isfinite(law.closure.value):
        logs = "held-out logs" if law.held_out else "fitted logs"
        lines.append(f"        {w.closure_words(law.closure, 'what retuning leaves', f'on the {logs}')}")
    for name, curve in law.curves.items():
        if curve.formula:
            lines.append(f"        {name + ': ' if name else ''}{curve.formula}")
    if law.runner_up is not None:
        apart = "rejected" if law.distinguished else "not distinguished by these logs"
        other = f"{law.runner_up.id} ({law.runner_up.words}, {w.closure(law.runner_up.share)})"
        lines.append(
            f"        runner-up {other}: {apart} (the law takes up {w.percent(max(law.lead, 0.0))} of what it leaves)"
        )
    return lines


def figure_svg(law: MissingLaw) -> str:
    """The law of each channel over the density of its variable, a panel each."""
    fades = law.words.startswith(RELAXES)
    unit, factor = ("s", 1.0) if fades else shown_unit(law.unit)
    symbol = SYMBOLS.get(unit, unit)
    with house_style():
        figure = new_figure(3.4 * max(len(law.curves), 1.35), 3.0)
        panels = figure.subplots(2, len(law.curves), sharex="col", squeeze=False, height_ratios=(4, 1))
        for k, (name, curve) in enumerate(law.curves.items()):
            axes, below, colour = panels[0, k], panels[1, k], PALETTE[k % len(PALETTE)]
            u = np.arange(len(curve.u)) if fades else factor * curve.u
            axes.fill_between(u, curve.low, curve.high, color=colour, alpha=0.2, lw=0)
            axes.plot(u, curve.value, "o-", ms=3, lw=1.4, color=colour, mew=0)
            axes.axhline(0.0, color=SOFT, lw=0.4)
            axes.grid(color=RULE, lw=0.5)
            axes.set_title(name)
            if fades:
                below.set_visible(False)
                axes.set_xticks(u, [f"{value:.2g}" for value in curve.u])
                axes.tick_params(labelbottom=True)
                axes.set_xlabel("time constant [s]")
                continue
            edges = factor * curve.edges
            below.bar(edges[:-1], curve.counts, np.diff(edges), align="edge", color=SOFT, alpha=0.5, lw=0)
            below.set_yticks([])
            below.set_ylabel("data")
            below.set_xlabel(f"u [{symbol}]" if symbol else "u")
        panels[0, 0].set_ylabel("f(u), SI")
        return render_svg(figure, "missing_law", law.words)
