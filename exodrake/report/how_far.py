"""Section "how far" of the report: curves of the held-out logs, the gap of each signal, what is left by frequency."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.diagnosis import regime
from exodrake.diagnosis.gap import SignalGap
from exodrake.diagnosis.result import Diagnosis
from exodrake.report import number_format as n, wording as w
from exodrake.report.blocks import Drawing, Table
from exodrake.report.curves import curves
from exodrake.report.simulated_logs import IMPROVED, NOMINAL, SimulatedLogs
from exodrake.report.svg import AFTER, BEFORE, RULE, SOFT, house_style, svg_of


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
