"""Section "how far" of the report: curves of the held-out logs, the gap of each signal, what is left by frequency.

Curves are compact data for `templates/curves.js`, which draws them with uPlot. A sample takes two bytes: its level
between the least and the largest value of its curve, in base 64. Logs that are too long for the report are given by
their envelope, so that no peak is lost.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np

from exodrake.core.display import SYMBOLS
from exodrake.data.plot import envelope, new_figure, stretch_of
from exodrake.diagnosis import regime
from exodrake.diagnosis.gap import SignalGap
from exodrake.diagnosis.result import Diagnosis
from exodrake.report import number_format as n, wording as w
from exodrake.report.blocks import Drawing, Table
from exodrake.report.simulated_logs import IMPROVED, NOMINAL, SimulatedLog, SimulatedLogs
from exodrake.report.svg import AFTER, BEFORE, RULE, SOFT, house_style, svg_of

LEVELS = 65534  # of a curve; the next one marks a missing sample
SIZE = 900_000  # characters that all curves of a report may take
CHARACTERS = 8 / 3  # that a sample takes
LEAST, MOST = 600, 8000  # samples of a curve: least, however many logs there are, and most
BAND = 2.0  # noise standard deviations to either side of no error


def how_far(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template."""
    drawn = dict([(NOMINAL, BEFORE), (IMPROVED, AFTER)][: len(w.robots_of(diagnosis))])
    return {
        "errors": error_by_robot(diagnosis),
        "curves": curves(runs, list(drawn)) if runs.judged else None,
        "gaps": gap_table(diagnosis),
        "spectrum": Drawing(spectrum_svg(runs, drawn), wide=True) if runs.judged else None,
    }


def error_by_robot(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Rows from the nominal robot to noise: RMS error [noise_std] with its share of the largest, and closures."""
    closure, robots, rms = diagnosis.closure, w.robots_of(diagnosis), diagnosis.closure.rms
    overall = {"retuned": closure.retune, "after": closure.overall}
    effect = {"after": closure.effect} if np.isfinite(closure.effect.value) else {}
    largest = max((rms[key] for key in robots if np.isfinite(rms[key])), default=1.0)
    rows = [(key, name, rms[key]) for key, name in robots.items()] + [("noise", "noise alone", 1.0)]
    return [
        {"key": key, "name": name, "rms": n.digits(value), "length": min(value / largest, 1.0)}
        | {"overall": overall.get(key), "effect": effect.get(key)}
        for key, name, value in rows
    ]


def gap_table(diagnosis: Diagnosis) -> Table:
    """Gap of each signal and of each kind with each robot, noise, closure."""
    machine, robots = w.machine_of(diagnosis), list(w.robots_of(diagnosis))
    kinds = {found.kind: found for found in w.kind_gaps(diagnosis)}
    rows = []
    for name, gap in diagnosis.closure.signals.items():
        kind, channel = w.split_column(name, machine)
        rows.append(gap_row(f"{kinds[kind].display.label} {channel}", gap, kinds[kind].display.unit, robots))
    totals = [gap_row(f"{k.display.label}, all", k.gap, k.display.unit, robots) for k in kinds.values()]
    titles = w.robot_titles(diagnosis)
    header = ("Signal", *titles, "Noise std", f"{titles[-1]} / noise std", *(["Closure"] if len(robots) > 1 else []))
    return Table(header, [*rows, *totals], totals=len(totals))


def gap_row(title: str, gap: SignalGap, unit: str, robots: list[str]) -> tuple[str, ...]:
    """Cells of a row of the gap table."""
    gaps = [getattr(gap, name) for name in robots]
    closed = n.closure(gap.closure) if gap.before > w.SMALL * gap.noise_std and np.isfinite(gap.closure) else "–"
    cells = [n.quantity(x, gap.unit, unit) for x in (*gaps, gap.noise_std)]
    return (title, *cells, f"{gaps[-1] / gap.noise_std:.2f}", *([closed] if len(robots) > 1 else []))


def spectra(runs: SimulatedLogs, robot: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and mean power density [1/Hz] of the normalised residuals of one kind, over judged logs."""
    columns = [log.residuals[robot][:, i] for log in runs.judged for i in runs.of_kind(kind)]
    found = [regime.spectrum(np.nan_to_num(column), runs.period) for column in columns]
    frequency = min((frequency for frequency, _ in found), key=len)
    return frequency, np.mean([power for _, power in found if len(power) == len(frequency)], axis=0)


def spectrum_svg(runs: SimulatedLogs, drawn: dict[str, str]) -> str:
    """Spectra of the normalised residuals of robots, each in its colour, a panel per kind of signal."""
    with house_style():
        figure = new_figure(9.6, 2.35)
        panels = figure.subplots(1, len(runs.kinds), sharey=True, squeeze=False)[0]
        white = 2.0 * runs.period  # density of white noise of unit variance up to the Nyquist frequency
        for axes, kind in zip(panels, runs.kinds):
            for robot, colour in drawn.items():
                frequency, power = spectra(runs, robot, kind)
                axes.loglog(frequency[1:], power[1:], color=colour, lw=1.2)
            axes.axhline(white, color=SOFT, lw=0.9, ls=(0, (4, 2)))
            axes.set_title(runs.display(kind).label)
            axes.set_xlabel("Frequency [Hz]")
            axes.grid(color=RULE, lw=0.5)
        panels[0].set_ylabel("Density [1/Hz]")
        return svg_of(figure, "spectrum", "power density of normalised residuals")


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
