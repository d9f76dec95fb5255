"""The report: a diagnosis as one HTML file that needs nothing from outside.

problem = make_problem(read_case(folder), load_robot())
write_text("report.html", report_html(diagnosis, problem))
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import welch

from exodrake import __version__
from exodrake.analysis.log_response import COLUMNS, LogResponse, block_responses, label_ticks, plot_responses
from exodrake.core.errors import InputError
from exodrake.data import plot
from exodrake.data.case import parse_date
from exodrake.data.plot import choose_stretch, envelope, new_figure
from exodrake.diagnosis import localise
from exodrake.diagnosis.change_point import STEP
from exodrake.diagnosis.isolation import SAMPLING
from exodrake.diagnosis.likelihood import CORRELATION
from exodrake.diagnosis.noise import mismatch
from exodrake.diagnosis.problem import NEGLIGIBLE, Problem, Trial
from exodrake.diagnosis.result import CAUSE, REFINEMENT, Diagnosis, Interval, SignalGap
from exodrake.diagnosis.search import GAIN, LARGE, LAW, NATS, SURE
from exodrake.diagnosis.verdict import CLEAR, EXPLAINED, MOST
from exodrake.diagrams.block_diagram import wiring_svg
from exodrake.model.display import PALETTE, SYMBOLS, find_display, shown_unit
from exodrake.report import blocks, wording as w
from exodrake.report.blocks import AFTER, BAND, LINE, RULE, SOFT, Bars, Drawing, Table, render, render_svg, timeline

if TYPE_CHECKING:
    from exodrake.diagnosis.discovery.discover import MissingLaw

NOMINAL, RETUNED, IMPROVED = "nominal", "retuned", "improved"
ROBOTS: tuple[str, ...] = (NOMINAL, RETUNED, IMPROVED)
CURVE_LEVELS = 65534  # of a curve; the next one marks a missing sample
SIZE = 900_000  # characters that all curves of a report may take
CHARACTERS = 8 / 3  # that a sample takes
FEWEST_SAMPLES, MOST_SAMPLES = 600, 8000  # samples of a curve: least, however many logs there are, and most
SECTIONS, SHORTEST = 8, 64  # of a log in a spectrum, and samples of one at least
NOISE_BAND = 2.0  # noise standard deviations to either side of no error
BINS = 14  # of a condition
DOTS = 2500  # of a scatter, at most
JITTER = 0.12  # half the width of a cloud of samples over one of a few levels
# conditions with two or three levels, and how these are called
LEVELS = {(0.0, 1.0): ("no", "yes"), (-1.0, 0.0, 1.0): ("negative", "at rest", "positive")}
SERIES = 6  # of quantities over sessions that are drawn
RELAXES = "relaxation"  # a law over time since a change
SHOWN = 5  # retuned parameters that are shown at once
LEAST = 0.005  # standard deviations of its tolerance: a smaller change is not listed
DIGITS = 12  # of a file's hash that are shown; the JSON has them all


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """A log and the same motion simulated."""

    trial: Trial
    simulated: dict[str, np.ndarray]  # robot -> (n, columns) [SI], noise-free and unquantised
    noise_std: np.ndarray  # (columns,) [SI]

    @cached_property
    def residuals(self) -> dict[str, np.ndarray]:
        """Robot -> normalised residuals (n, columns), NaN where nothing was measured or the robot diverged."""
        found = {name: (self.trial.measured - rows) / self.noise_std for name, rows in self.simulated.items()}
        return {name: np.where(np.isfinite(rows), rows, np.nan) for name, rows in found.items()}


@dataclass(frozen=True, eq=False)
class SimulatedLogs:
    """The logs of a problem and the same motion simulated; fitted ones, then held-out ones."""

    problem: Problem
    logs: tuple[SimulatedLog, ...]

    @property
    def closure_logs(self) -> tuple[SimulatedLog, ...]:
        """Logs that the closure is measured on; none where no column is compared."""
        names = {trial.name for trial in self.problem.judged}
        return tuple(log for log in self.logs if log.trial.name in names) if self.problem.columns else ()

    @property
    def period(self) -> float:
        """Length of a frame [s]."""
        return self.problem.robot.machine.frame

    @cached_property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Kind and channel of each column."""
        return tuple(w.split_column(column, self.problem.robot.machine) for column in self.problem.columns)

    @property
    def loop_answer(self) -> str:
        """Kind of signal by which the control loop answers an error of the plant; empty if the machine has none."""
        observer = self.problem.robot.machine.observer
        return observer.measured_input if observer else ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of signals, in the order of the columns; the loop's answer last."""
        kinds = dict.fromkeys(kind for kind, _ in self.parts)
        return tuple(sorted(kinds, key=lambda kind: kind == self.loop_answer))

    def rms(self, log: SimulatedLog, robot: str) -> float:
        """RMS error of a robot on a log [noise_std], in the band of a tremor its strength alone, as for the closure."""
        gaps = mismatch(log.trial.measured, log.simulated[robot], self.problem.notched, self.period) / log.noise_std
        return float(np.sqrt(np.nanmean(gaps**2))) if gaps.size else float("nan")


def how_far(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template; rows of `errors` from the nominal robot to noise: RMS, closures."""
    closure, robots = diagnosis.closure, w.list_robots(diagnosis)
    drawn = dict([(NOMINAL, plot.NOMINAL), (IMPROVED, plot.IMPROVED)][: len(robots)])
    largest = max((closure.rms[key] for key in robots if np.isfinite(closure.rms[key])), default=1.0)
    closed = {"retuned": closure.retune, "after": closure.overall}
    step = {"after": closure.effect} if np.isfinite(closure.effect.value) else {}
    sizes, in_noise = w.robot_errors(diagnosis)
    rows = [(key, name, sizes[key], closure.rms[key]) for key, name in robots.items()]
    rows += [("noise", "noise alone", "1.00", 1.0)] if in_noise else []
    errors = [
        {"key": key, "name": name, "rms": size, "length": min(rms / largest, 1.0)}
        | {"overall": closed.get(key), "effect": step.get(key)}
        for key, name, size, rms in rows
    ]
    gaps, titles = w.kind_gaps(diagnosis), w.robot_titles(diagnosis)
    header = ("Signal", *titles, "Noise std", f"{titles[-1]} / noise std", *(["Closure"] if len(robots) > 1 else []))

    def gap_row(title: str, gap: SignalGap, unit: str) -> tuple[str, ...]:
        sizes = [getattr(gap, name) for name in robots]
        known = gap.before > w.SMALL * gap.noise_std and np.isfinite(gap.closure)
        cells = [w.quantity(x, gap.unit, unit) for x in (*sizes, gap.noise_std)]
        closed = [w.closure(gap.closure) if known else "–"] if len(robots) > 1 else []
        return (title, *cells, f"{sizes[-1] / gap.noise_std:.2f}", *closed)

    rows = []  # of each signal, behind a fold
    for name, gap in closure.signals.items():
        kind, channel = w.split_column(name, diagnosis.machine)
        display, _ = gaps[kind]
        rows.append(gap_row(f"{display.label} {channel}", gap, display.unit))
    totals = [gap_row(display.label, gap, display.unit) for display, gap in gaps.values()]
    tables = [Table(header, totals)]
    if len(rows) > len(totals):  # else each kind has one signal, and its row says it
        tables.append(Table(header, rows, folded=f"Each of the {len(rows)} signals"))
    unit = "noise standard deviations: 1 is noise alone" if in_noise else "per cent of the nominal robot's"
    answer: dict[str, Any] = {"errors": errors, "error_unit": unit, "curves": None, "gaps": tables, "spectrum": None}
    if not runs.closure_logs:
        return answer
    with blocks.house_style():  # a panel of spectra for each kind of signal, each robot in its style
        figure = new_figure(9.6, 2.35)
        panels = figure.subplots(1, len(runs.kinds), sharey=True, squeeze=False)[0]
        white = 2.0 * runs.period  # density of white noise of unit variance up to the Nyquist frequency
        for axes, kind in zip(panels, runs.kinds):
            indices = [i for i, (own, _) in enumerate(runs.parts) if own == kind]
            axes.axhline(white, color=SOFT, lw=0.9, zorder=1)
            for robot, style in drawn.items():  # mean of Welch's estimates over the logs; some may be shorter
                columns = [np.nan_to_num(log.residuals[robot][:, i]) for log in runs.closure_logs for i in indices]
                found = [welch(c, 1.0 / runs.period, nperseg=max(SHORTEST, len(c) // SECTIONS)) for c in columns]
                frequency = min((frequency for frequency, _ in found), key=len)
                power = np.mean([power for _, power in found if len(power) == len(frequency)], axis=0)
                axes.loglog(frequency[1:], power[1:], **style)
            axes.set(title=find_display(kind, diagnosis.machine).label, xlabel="Frequency [Hz]")
            axes.grid(color=RULE, lw=0.5)
            label_ticks(axes.xaxis)
        panels[0].set_ylabel("Density [1/Hz]")
        svg = render_svg(figure, "spectrum", "power density of normalised residuals")
    return answer | {"curves": curves(runs, list(drawn)), "spectrum": Drawing(svg, wide=True)}


def curves(runs: SimulatedLogs, robots: Sequence[str]) -> dict[str, Any]:
    """Curves of the report over time: for each judged log what was measured, and each robot with its error.

    Returns:
        Plain data: `kinds` (name, label, unit), `robots`, and `logs` (name, samples, step [s], stretch, columns). A
        column has each curve as least value, height of a level, and levels in base 64; NaN is the one after the last.
    """
    count = (1 + 2 * len(robots)) * max(len(runs.problem.columns), 1) * max(len(runs.closure_logs), 1)
    most = int(np.clip(SIZE / (CHARACTERS * count), FEWEST_SAMPLES, MOST_SAMPLES))
    displays, logs = {kind: find_display(kind, runs.problem.robot.machine) for kind in runs.kinds}, []
    for log in runs.closure_logs:
        stretch = choose_stretch(len(log.trial.measured), most)
        rows = {"measured": log.trial.measured}
        for name in robots:
            rows[name] = np.where(np.isfinite(log.simulated[name]), log.simulated[name], np.nan)
            rows[f"error_{name}"] = log.residuals[name] * log.noise_std
        short, columns = {name: envelope(values, stretch) for name, values in rows.items()}, []
        for i, (kind, channel) in enumerate(runs.parts):
            factor = displays[kind].factor
            column = {"kind": kind, "channel": channel, "band": NOISE_BAND * factor * float(log.noise_std[i])}
            for name, values in short.items():
                curve = factor * values[:, i]
                known = np.isfinite(curve)
                least = float(curve[known].min()) if known.any() else 0.0
                height = float(curve[known].max() - least) / CURVE_LEVELS if known.any() else 0.0
                levels = np.full(len(curve), CURVE_LEVELS + 1, "<u2")
                levels[known] = np.round((curve[known] - least) / (height or 1.0))
                column[name] = {"least": least, "height": height, "levels": b64encode(levels.tobytes()).decode()}
            columns.append(column)
        logs.append({
            "name": log.trial.name, "samples": len(short["measured"]), "stretch": stretch,
            "step": runs.period * (stretch / 2 if stretch > 1 else 1), "columns": columns,
        })  # fmt: skip
    return {
        "kinds": [{"name": kind, "label": d.label, "unit": d.symbol} for kind, d in displays.items()],
        "robots": list(robots),
        "logs": logs,
    }


def where(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template; nothing where there is no place."""
    found = diagnosis.where
    if found.block == "none":
        return {}
    drawn = wiring_svg(runs.problem.robot.machine, found.shares, schedule=False)
    largest = max([*found.regime.values(), 1e-9])  # shares of the variance, over the width of the largest
    ordered = sorted(found.regime.items(), key=lambda item: -item[1])
    rows = [(name, max(v, 0.0) / largest, f"{100 * v:.0f} %", v == largest) for name, v in ordered]
    return {
        "wiring": Drawing(drawn, wide=True, alt="parts and signals of the robot"),
        "responses": response_figure(diagnosis, runs),
        "conditions": Bars(rows) if rows else None,
        "condition": condition_figure(diagnosis, runs),
    }


def response_figure(diagnosis: Diagnosis, runs: SimulatedLogs) -> Drawing | None:
    """Frequency response of each block: measured, nominal and improved, in the channel of the largest gap.

    None where the estimate makes no sense: logs without the references of the machine, too short or with too many
    missing samples, a robot that diverges on them, and no frequency at which a response is resolved.
    """
    robots = {name: diagnosis.robots[name] for name in (NOMINAL, IMPROVED)}
    machine = robots[NOMINAL].machine
    try:
        found = block_responses(runs.problem.case, robots) if machine.references else []
    except InputError:
        return None

    def gap(one: LogResponse) -> float:
        """Mean square of the relative error of the nominal response, weighted by power; 0 at unresolved lines."""
        error = np.where(one.resolved, np.abs(one.models[NOMINAL] / one.response - 1.0), 0.0)
        return float(np.average(error**2, weights=one.power))

    lines = [one for one in found if one.resolved.sum() > 1]  # a single one shows no course
    drawable = [one for one in lines if all(np.isfinite(m).all() for m in one.models.values())]
    kinds = {one.output: w.split_column(one.output, machine)[0] for one in drawable}
    by_block = {s.name: [one for one in drawable if kinds[one.output] == s.output] for s in machine.segments}
    chosen = {name: sorted(each, key=gap)[::-1] for name, each in by_block.items() if each}
    if not chosen:
        return None
    chosen = {name: each[: max(1, COLUMNS // len(chosen))] for name, each in chosen.items()}
    figure = plot_responses([one for each in chosen.values() for one in each], style=blocks.STYLE)
    label = "frequency responses of the blocks, measured, nominal and improved"
    parts = w.join_words([f"{name} ({w.join_words([one.output for one in each])})" for name, each in chosen.items()])
    caption = (
        f"Frequency response from the signal before each block to its own, before any effect is named: {parts}, "
        "each in the channels of its largest gap. Band: 90 %. Where coherence is low, noise or a nonlinearity acts."
    )
    return Drawing(render_svg(figure, "response", label), caption, wide=True)


def condition_figure(diagnosis: Diagnosis, runs: SimulatedLogs) -> Drawing | None:
    """Residuals of the worst signal of the worst judged log against the condition of largest correlation ratio."""
    if not diagnosis.where.regime or not runs.closure_logs:
        return None
    log = max(runs.closure_logs, key=lambda log: np.nanmean(log.residuals[NOMINAL] ** 2))
    power = np.nanmean(log.residuals[RETUNED] ** 2, axis=0)
    plain = [i for i, (kind, _) in enumerate(runs.parts) if kind != runs.loop_answer]  # which is no error
    column = max(plain or range(len(power)), key=lambda i: power[i])
    signal = runs.problem.columns[column]
    before, after = (log.residuals[robot][:, column] for robot in (RETUNED, IMPROVED))
    known = np.isfinite(before) & np.isfinite(after)
    table = localise.conditions(runs.problem, log.trial, localise.channel_index(runs.problem, signal))
    best = max(table, key=lambda condition: localise.explain_variance(before[known], table[condition][known]))
    declared, label, factor = diagnosis.machine.regime, best, 1.0
    if best.startswith("time"):
        label = f"{best} [s]"
    elif declared is not None and best in ("load", "joint angle", "speed"):
        kind = {"load": declared.load, "joint angle": declared.joint}.get(best, declared.position)
        shown = find_display(kind, diagnosis.machine)
        label, factor = f"{best} [{shown.symbol}{'/s' if best == 'speed' else ''}]", shown.factor
    at, before, after = factor * table[best][known], before[known], after[known]
    levels = tuple(np.unique(at).tolist())
    few, step = len(levels) <= max(map(len, LEVELS)), max(1, len(at) // DOTS)
    # bins of equal count, or of equal condition, where it has few values
    bins = np.array_split(np.argsort(at, kind="stable"), BINS)
    bins = [np.flatnonzero(at == level) for level in levels] if len(levels) <= BINS else bins
    dots = at + np.random.default_rng(0).uniform(-JITTER, JITTER, len(at)) if few else at
    with blocks.house_style():
        figure = new_figure(4.2, 2.6)
        axes = figure.subplots()
        axes.axhspan(-2.0, 2.0, color=BAND, lw=0)
        for values, colour, name in ((before, LINE, "retuned robot"), (after, AFTER, w.last_robot(diagnosis))):
            axes.plot(dots[::step], values[::step], ".", ms=1.6, mew=0, color=colour, alpha=0.35, rasterized=True)
            means = [[rows[one].mean() for one in bins] for rows in (at, values)]
            axes.plot(*means, "o-", ms=3, lw=1.2, color=colour, label=name, mew=0)
        axes.axhline(0.0, color=SOFT, lw=0.4)
        limit = 1.1 * max(np.percentile(np.abs(np.concatenate([before, after])), 99.5), 3.0)
        axes.set_ylim(-limit, limit)
        if levels in LEVELS:
            axes.set_xticks(levels, LEVELS[levels])
        axes.set_xlabel(label)
        axes.set_ylabel(f"error of {signal} / noise std")
        figure.legend(loc="outside upper left", ncols=2, handlelength=1.6)
        svg = render_svg(figure, "condition", f"error of {signal} against {label}")
    return Drawing(svg)


def which(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template."""

    def bar(name: str, length: float, text: str, strong: bool = False) -> tuple[str, float, str, bool]:
        return name, float(np.clip(np.nan_to_num(length), 0.0, 1.0)), text, strong

    # each cause with its rivals beneath, the refinements, and what remains; parameters of each
    bars, described, left = [], {CAUSE: [], REFINEMENT: []}, diagnosis.remainder
    for effect in (*w.causes(diagnosis), *w.causes(diagnosis, REFINEMENT)):
        bars.append(bar(f"`{effect.id}`", effect.share.value, w.share_span(effect.share), effect.role == CAUSE))
        bars += [bar(f"or `{r.id}`", r.share.value, w.share(r.share.value)) for r in effect.rivals]
        rows = []
        for name, item in effect.parameters.items():
            channels = effect.channels.get(name, {})
            several = len(channels) > 1
            if not several or np.isfinite(item.value):
                rows.append((f"`{name}`{' (common value)' if several else ''}", *w.interval(item)))
            rows += [(f"`{name}` {channel}", *w.interval(one)) for channel, one in channels.items() if several]
        table = Table(("Parameter", "Value", "90 % interval"), rows, wide=False)
        described[effect.role].append((effect, w.find_effect(diagnosis, effect.id), table))
    noise = f", {w.digits(left.noise_std, 2)} noise std" if np.isfinite(left.noise_std) else ""
    bars.append(bar("remains", left.value, w.share(left.value) + noise))
    sets = []
    for one in diagnosis.candidates:
        chi2 = [w.digits(x) if np.isfinite(x) else "–" for x in (one.chi2, one.prediction_chi2)]
        evidence = f"{one.evidence:,.1f}" if np.isfinite(one.evidence) else "–"
        sets.append((f"`{one.id or 'retune'}`", w.closure(one.share), *chi2, evidence))
    header = ("Effects", "Explains", "chi-square, closed loop", "chi-square, prediction error", "Evidence [nats]")
    rows = []
    for p, x in w.list_changes(diagnosis):
        if abs(x) > LEAST * p.prior_std:
            *cells, limit = w.describe_change(runs.problem.robot.machine, p, x)
            rows.append((f"`{p.name}`", *cells, f"{x / p.prior_std:+.2f}{limit}"))
    titles, rest = ("Parameter", "Nominal", "Fitted", "Change in std of its tolerance"), rows[SHOWN:]
    retuned = [Table(titles, rows[:SHOWN], wide=False)] if rows else []
    retuned += [Table(titles, rest, wide=False, folded=f"{len(rest)} smaller changes")] if rest else []
    return {
        "shares": Bars(bars) if len(bars) > 1 else None,
        "causes": described[CAUSE],
        "refinements": described[REFINEMENT],
        "sets": Table(header, sets, folded=f"All {len(sets)} fitted sets in numbers") if sets else None,
        "retuned": retuned,
    }


def since(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the section's template; nothing for a case without sessions."""
    found = diagnosis.since
    if found is None:
        return {"since": None, "timelines": []}
    first = parse_date(found.sessions[0]) if found.unit == "d" else None
    timelines, rows = [], []
    for one in found.series:
        name, change, cells = w.name_series(one), one.change, ("–",) * 4
        lines = {"values": one.values, "low": one.low, "high": one.high}
        timelines.append(timeline(name, first, one.unit, found.times, lines, change))
        if change is not None:
            before, after = (w.interval(Interval(*item, one.unit))[0] for item in (change.before, change.after))
            rate = "–" if change.shape == STEP else w.change_rate(found, one, change)
            cells = (w.change_date(found, change), before, after, rate)
        rows.append((name, *cells[:1], w.percent(one.p), *cells[1:]))
    header = ("Quantity", "Change began", "Constant by evidence", "Before", "Last", "Rate")
    table = Table(header, rows, words=2, folded=f"All {len(rows)} quantities in numbers") if rows else None
    return {"since": w.since_words(diagnosis), "timelines": timelines[:SERIES], "changes": table}


def missing_law(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the section's template."""
    law = diagnosis.missing_law
    if law is None or not law.found:
        return {"law": law, "law_lines": w.law_lines(law), "law_figure": None}
    rows = [(f"`{r.id}`", r.words, w.closure(r.share)) for r in law.others]
    header = ("Law at", "what over what", "share of the excess removed, fitted logs")
    lines = [line.strip() for line in w.law_lines(law)[1:]]
    return {
        "law": law,
        "law_lines": [line[:1].upper() + line[1:] + "." for line in lines],
        "law_figure": law_figure(law),
        "law_table": Table(header, rows, words=2, wide=False),
        "law_module": law.text,
    }


def law_figure(law: MissingLaw) -> Drawing:
    """The law of each channel over the density of its variable, a panel each."""
    fades = law.words.startswith(RELAXES)
    unit, factor = ("s", 1.0) if fades else shown_unit(law.unit)
    symbol = SYMBOLS.get(unit, unit)
    with blocks.house_style():
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
        svg = render_svg(figure, "missing_law", law.words)
    return Drawing(svg, wide=len(law.curves) > 1)


def list_assumptions(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template: every log with role, length, missing samples, RMS errors, hash; provenance."""
    case, simulated = runs.problem.case, {log.trial.name: log for log in runs.logs}
    titles, rows = w.robot_titles(diagnosis), []
    for item in case.logs:
        log, role = simulated.get(item.file), "held out: closure" if item.role == "holdout" else "fitted"
        role = f"noise: repeats {item.repeats}" if case.is_copy(item) else role
        errors = ["–" if log is None else w.digits(runs.rms(log, robot)) for robot in ROBOTS[: len(titles)]]
        samples = [item.log[column] for column in runs.problem.columns]
        lost = float(np.mean(~np.isfinite(samples))) if samples else 0.0
        missing = f"{100 * lost:.2g} %" if lost else "none"
        digest = f"`{case.hashes[item.file][:DIGITS]}`" if case.hashes.get(item.file) else "–"
        rows.append((f"`{item.file}`", role, f"{len(item.log) * runs.period:.0f} s", missing, *errors, digest))
    logs = Table(("Log", "Role", "Length", "Missing", *titles, "SHA-256"), rows, words=2)
    decided = decision_numbers(runs.problem.negligible)
    numbers = Table(("Number", "Value"), decided, folded="The numbers of the decisions")
    made, provenance = diagnosis.provenance, None
    if made is not None:
        rows = [
            ("Date", made.date.replace("T", " ").replace("+00:00", " UTC")),
            ("Command", f"`{made.command}`" if made.command else "called from Python"),
            ("exodrake", f"{made.version}, code `{made.code}`"),
            ("Robot", f"`{made.robot}`, parameters `{made.parameters}`"),
            ("Calibration", made.calibration),
        ]
        provenance = Table((), rows, words=2, wide=False, folded="Date, version, command, robot and calibration")
    return {"logs": logs, "numbers": numbers, "provenance": provenance}


def decision_numbers(negligible: float = NEGLIGIBLE) -> list[tuple[str, str]]:
    """Each number of the search and of the verdict: its meaning and value with unit."""
    return [
        ("a gap is negligible below, in every channel", f"{negligible:g} noise standard deviations RMS beyond noise"),
        ("and below, so that sampling shows no gap", f"{SAMPLING:g} standard errors of a mean square"),
        ("one effect more adds evidence of at least", f"{NATS:g} nats and the logarithm of the number of effects"),
        ("and takes up of what is left at least", w.percent(GAIN)),
        ("one in the place of what retuning moved spares of the tolerances at least", f"{SURE:g} nats"),
        ("what a model leaves counts as one sample for at most", f"{CORRELATION:g} s"),
        ("two explanations are as likely within", f"{NATS:g} nats"),
        ("a cause takes up of the gap at least", w.percent(LARGE)),
        ("or of what is left without it at least", w.percent(MOST)),
        ("a law of an effect may err by", w.percent(LAW)),
        ("a channel shows a small cause above what remains there by a factor (RMS) of", f"{CLEAR:g}"),
        ("causes are named that explain of the gap at least", w.percent(EXPLAINED)),
        ("causes explain part of it (PARTLY) from", w.percent(MOST)),
    ]


def report_html(diagnosis: Diagnosis, problem: Problem) -> str:
    """The report of a diagnosis; the logs of the problem are simulated with the nominal, retuned and improved robot."""
    plain = replace(problem, detected=())  # the robots hold what was detected
    rows = np.array([plain.silent(diagnosis.robots[name]) for name in ROBOTS])
    runs = ((t, dict(zip(ROBOTS, problem.predict(rows, t)))) for t in (*problem.fit, *problem.holdout))
    logs = tuple(SimulatedLog(t, simulated, problem.noise_std) for t, simulated in runs)
    return render_report(diagnosis, SimulatedLogs(problem, logs))


def render_report(diagnosis: Diagnosis, runs: SimulatedLogs) -> str:
    """The report from a diagnosis and logs that were simulated already."""
    sections = how_far(diagnosis, runs) | where(diagnosis, runs) | which(diagnosis, runs) | since(diagnosis)
    sections |= missing_law(diagnosis) | list_assumptions(diagnosis, runs)
    head = {"title": f"{diagnosis.case}: diagnosis", "version": __version__, "colour": w.COLOURS[diagnosis.verdict]}
    return render("diagnosis.html", found=diagnosis, runs=runs, w=w, **head, **sections)
