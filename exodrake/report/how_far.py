"""Sections of the page about size: the verdict with its numbers, measured against simulated, gaps and spectra."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.line import TREMOR
from exodrake.diagnosis.result import NAMED, NO_GAP, Diagnosis
from exodrake.report import markup as m
from exodrake.report import words as w
from exodrake.report.drawing import AFTER, BEFORE, MEASURED
from exodrake.report.evidence import Evidence
from exodrake.report.series import signals_svg


def verdict_box(diagnosis: Diagnosis) -> str:
    """The verdict, what it means, and its numbers."""
    parts = [f'<span class="tag">{m.text(w.TITLES.get(diagnosis.verdict, diagnosis.verdict))}</span>']
    parts.append(m.paragraph(w.headline(diagnosis), "headline"))
    parts += [m.paragraph(f"`{e.id}`: {w.summary_of(diagnosis, e.id)}.") for e in diagnosis.effects]
    parts += [m.paragraph(f"Why this verdict: {reason}.") for reason in diagnosis.reasons]
    return f'<section class="verdict">{"".join(parts)}{m.tiles(key_numbers(diagnosis))}</section>'


def key_numbers(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Large numbers of the verdict box."""
    where, overall = diagnosis.where, diagnosis.closure.overall
    before, after = total(diagnosis, "before"), total(diagnosis, "after")
    sizes = f"{w.digits(before, 2)} → {w.digits(after, 2)}"
    found = [(sizes, "error in noise floors (RMS) on held-out logs, before → after")]
    if diagnosis.verdict != NO_GAP:
        span = f"{w.share(overall.low).removesuffix(' %')} to {w.share(overall.high)}"
        found.append(
            (w.share(overall.value), f"of the gap closed by the {w.after_name(diagnosis)}; 90 % interval {span}")
        )
    if where.block != "none":
        found.insert(0, (where.block, w.seat(where.wires, where.joints) or "where the gap arises"))
    if diagnosis.verdict == NAMED and diagnosis.effects:
        noise_inputs = min(e.probability for e in diagnosis.effects)
        found.append((w.share(min(noise_inputs, SURE)), "probability of this explanation among those tried"))
    return found


def total(diagnosis: Diagnosis, which: str) -> float:
    """RMS gap over all signals in floors."""
    return float(np.sqrt(np.mean([(getattr(s, which) / s.floor) ** 2 for s in diagnosis.closure.signals.values()])))


def how_far(diagnosis: Diagnosis, evidence: Evidence) -> str:
    """Measured against simulated, gap table, spectra."""
    from exodrake.report.charts import spectrum_svg

    after = w.after_name(diagnosis)
    names = w.list_words([f"`{t.name}`" for t in evidence.problem.holdout])
    parts = [m.heading(2, "How far: before and after, on motion the fit never saw")]
    shown = f" Shown: `{evidence.trial.name}`." if len(evidence.problem.holdout) > 1 else ""
    parts.append(m.paragraph(f"Held out: {names}. {HELD_OUT}{shown}"))
    marks = [(MEASURED, "measured"), (BEFORE, "before: nominal robot"), (AFTER, f"after: {after}")]
    parts.append(m.legend(marks, "twice the noise floor, below: measured − simulated"))
    parts += [
        m.figure(signals_svg(evidence, kind), wide=True)
        for kind in w.KINDS
        if evidence.of_kind(kind) and kind != "speed_cmd"
    ]
    if evidence.of_kind("speed_cmd"):
        drawing = m.figure(signals_svg(evidence, "speed_cmd"), wide=True)
        parts.append(m.folded("Speed command: the loop's answer to an error of the plant", drawing))
    parts += [m.heading(3, "Gap of every signal"), gap_table(diagnosis)]
    parts += [m.heading(3, "What is left, by frequency"), m.figure(spectrum_svg(evidence), SPECTRUM, wide=True)]
    return "".join(parts)


HELD_OUT = "Only the references are given; the whole robot is simulated in closed loop."
SPECTRUM = (
    "Power of the error on held-out logs, averaged over wires or joints, before and after. Dashed: a white error of "
    "one noise floor. What stays above it at low frequency is physics that is still missing; what lies on it is noise."
)


def gap_table(diagnosis: Diagnosis) -> str:
    """Gap of each signal and kind: nominal, retuned, after, floor, closure."""
    header = ("Signal", "Nominal", "Retuned", "After", "Noise floor", "After / floor", "Closure")
    rows = []
    for name, s in diagnosis.closure.signals.items():
        kind, channel = name.rsplit("_", 1)
        rows.append(
            (f"{w.KINDS.get(kind, kind)} {channel}", *row_of(s.before, s.retuned, s.after, s.floor, s.closure, s.unit))
        )
    sums = [
        (f"{w.KINDS[g.kind]}, all", *row_of(g.before, g.retuned, g.after, g.floor, g.closure, g.unit))
        for g in w.kind_gaps(diagnosis)
    ]
    shaken = any(effect.id == TREMOR for effect in diagnosis.effects)
    return m.table(header, [*rows, *sums], sums=len(sums)) + m.paragraph(GAPS + SHAKEN if shaken else GAPS)


GAPS = (
    "Gap: RMS of measured − simulated. Closure: the share of the gap above the noise floor that is gone; 100 % is down "
    "to the floor. It says little where the gap was near the floor to begin with (“–”)."
)
SHAKEN = (
    " A tremor’s phase wanders: in its band, gaps compare its strength only, while curves and spectra show the whole "
    "difference."
)
SURE = 0.999  # no probability is told as larger
SMALL = 1.1  # floors: a gap below it has nothing to close


def row_of(before: float, retuned: float, after: float, floor: float, closure: float, unit: str) -> tuple[str, ...]:
    """Cells of a row of the gap table."""
    gaps = [w.quantity(x, unit) for x in (before, retuned, after, floor)]
    closed = w.share(closure) if before > SMALL * floor and np.isfinite(closure) else "–"
    return (*gaps, f"{after / floor:.2f}", closed)
