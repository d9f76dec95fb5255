"""Curves of measured and simulated signals as compact data for `templates/curves.js`, which draws them with uPlot.

A sample takes two bytes: its level between the least and the largest value of its curve, in base 64. Logs that are too
long for the report are given by their envelope, so that no peak is lost.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np

from exodrake.core.display import SYMBOLS
from exodrake.data.plot import envelope, stretch_of
from exodrake.report.simulated_logs import SimulatedLog, SimulatedLogs

LEVELS = 65534  # of a curve; the next one marks a missing sample
SIZE = 900_000  # characters that all curves of a report may take
CHARACTERS = 8 / 3  # that a sample takes
LEAST, MOST = (
    600,
    8000,
)  # samples of a curve: so few are drawn at least, however many logs there are, and so many at most
BAND = 2.0  # noise standard deviations to either side of no error


def curves(runs: SimulatedLogs, robots: Sequence[str]) -> dict[str, Any]:
    """Curves of the report over time: for each judged log what was measured, and each robot with its error.

    Returns:
        Plain data: `kinds` (name, label, unit), `robots`, and `logs` (name, samples, step [s], stretch, columns).
    """
    count = (1 + 2 * len(robots)) * max(len(runs.problem.columns), 1) * max(len(runs.judged), 1)
    most = int(np.clip(SIZE / (CHARACTERS * count), LEAST, MOST))
    shown = {kind: runs.display(kind) for kind in runs.kinds}
    return {
        "kinds": [{"name": k, "label": d.label, "unit": SYMBOLS.get(d.unit, d.unit)} for k, d in shown.items()],
        "robots": list(robots),
        "logs": [log_curves(runs, log, robots, most) for log in runs.judged],
    }


def log_curves(runs: SimulatedLogs, log: SimulatedLog, robots: Sequence[str], most: int) -> dict[str, Any]:
    """The curves of a log, of at most so many samples each."""
    stretch = stretch_of(len(log.trial.measured), most)
    rows = {"measured": log.trial.measured}
    for name in robots:
        rows[name] = np.where(np.isfinite(log.simulated[name]), log.simulated[name], np.nan)
        rows[f"error_{name}"] = log.residuals[name] * log.noise_std
    short = {name: envelope(values, stretch) for name, values in rows.items()}
    columns = []
    for i, (kind, channel) in enumerate(runs.parts):
        factor = runs.display(kind).factor
        found = {name: packed(factor * values[:, i]) for name, values in short.items()}
        columns.append({"kind": kind, "channel": channel, "band": BAND * factor * float(log.noise_std[i]), **found})
    return {
        "name": log.trial.name, "samples": len(short["measured"]), "stretch": stretch,
        "step": runs.period * (stretch / 2 if stretch > 1 else 1), "columns": columns,
    }  # fmt: skip


def packed(values: np.ndarray) -> dict[str, Any]:
    """A curve (n,) as least value, height of a level, and levels in base 64; NaN is the level after the last."""
    known = np.isfinite(values)
    least = float(values[known].min()) if known.any() else 0.0
    height = float(values[known].max() - least) / LEVELS if known.any() else 0.0
    levels = np.full(len(values), LEVELS + 1, "<u2")
    levels[known] = np.round((values[known] - least) / (height or 1.0))
    return {"least": least, "height": height, "levels": b64encode(levels.tobytes()).decode()}
