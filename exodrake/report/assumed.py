"""Last sections of the page: what the logs cannot separate, what to measure next, and what was assumed."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN, Diagnosis
from exodrake.report import markup as m
from exodrake.report import words as w
from exodrake.report.evidence import Evidence

NEAR = 0.02  # candidates whose score is this close to the best are told as close seconds


def next_steps(diagnosis: Diagnosis) -> str:
    """What could not be separated, and what to measure next."""
    parts = [m.heading(2, "What could not be separated, and what to measure next")]
    if diagnosis.verdict == AMBIGUOUS:
        parts.append(m.paragraph("These effects explain the logs equally well, so no one of them is named:"))
        parts.append(m.bullets(f"`{i}`: {w.summary_of(diagnosis, i)}" for i in w.class_of(diagnosis)))
        parts.append(m.paragraph(w.experiment_words(diagnosis), "note"))
    elif diagnosis.verdict == UNKNOWN:
        parts.append(m.paragraph(UNKNOWN_NEXT))
    elif diagnosis.verdict == NAMED:
        parts.append(m.paragraph(close_seconds(diagnosis)))
    else:
        parts.append(
            m.paragraph(
                "Nothing is left to separate: no effect is needed. Motion that these logs lack may still show one."
            )
        )
    return "".join(parts)


UNKNOWN_NEXT = (
    "No candidate is accepted, so none is named. The regime above says when the error arises: repeat that motion "
    "slowly, then quickly, with the finger clamped and free, to see whether the error follows wire, joint or clock."
)


SEPARATED = (
    "Every other single candidate explains clearly less of the gap, so these logs do separate the effect from the "
    "rest of the effect library."
)


def close_seconds(diagnosis: Diagnosis) -> str:
    """Candidates that come near the named one, in a sentence."""
    named = {e.id for e in diagnosis.effects}
    best = diagnosis.candidates[0].score if diagnosis.candidates else 1.0
    near = [c.id for c in diagnosis.candidates if not named & set(c.id.split(" + ")) and c.score > best - NEAR]
    if not near:
        return SEPARATED
    names = w.list_words([f"`{n}`" for n in near])
    return f"Close, but predicting the logs significantly worse than what is named: {names}."


def assumed(diagnosis: Diagnosis, evidence: Evidence) -> str:
    """Logs, notes of the reader, thresholds, and what cruder methods would have said."""
    problem = evidence.problem
    parts = [m.heading(2, "What was assumed")]
    logs = [
        (t.name, t.role, f"{len(t.reference) * evidence.period:.0f} s", missing(t.measured))
        for t in (*problem.fit, *problem.holdout)
    ]
    parts += [m.heading(3, "Logs"), m.table(("Log", "Role", "Length", "Missing samples"), logs, words=2, wide=False)]
    parts.append(m.bullets(diagnosis.notes))
    parts.append(m.paragraph(FLOORS))
    if diagnosis.baselines:
        said = "; ".join(f"{BASELINES.get(k, k)}: `{v}`" for k, v in diagnosis.baselines.items())
        parts.append(m.paragraph(f"For comparison, cruder rules on the same fits would have said: {said}."))
    parts += [m.heading(3, "Thresholds of the verdict"), m.paragraph(THRESHOLDS)]
    parts.append(m.table(("Name", "Meaning", "Value"), threshold_rows(), words=2, wide=False))
    return "".join(parts)


FLOORS = (
    "Noise floors come from trials that repeat one reference, or from the sensors’ numbers where those are larger, "
    "never from the model’s own errors. The nominal numbers may err by a few per cent in every explanation. Logs "
    "marked “fit” set the parameters; closure is measured on held-out logs only, in the Drake diagram."
)
BASELINES = {"replay": "smallest residual alone", "bic": "raw BIC, every sample counted as independent"}
THRESHOLDS = "Calibrated on simulated robots, the same for every case:"


def missing(measured: np.ndarray) -> str:
    """Share of samples that a log lacks."""
    part = float(np.mean(~np.isfinite(measured)))
    return "none" if part == 0.0 else f"{100 * part:.2g} %"


def threshold_rows() -> list[tuple[str, str, str]]:
    """Name, meaning and value of each threshold, from the file that holds them."""
    rows = []
    for line in (files("exodrake.diagnosis") / "thresholds.yaml").read_text().splitlines():
        setting, _, meaning = line.partition("#")
        name, colon, value = setting.partition(":")
        if colon:
            rows.append((f"`{name.strip()}`", meaning.strip(), value.strip()))
    return rows
