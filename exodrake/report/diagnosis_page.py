"""The report: a diagnosis as one HTML page that needs nothing from outside.

problem = make_problem(read_case(folder), load_robot())
write_text("report.html", report_html(diagnosis, problem))
"""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake import __version__
from exodrake.diagnosis.levels import decision_numbers
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import (
    AMBIGUOUS,
    NAMED,
    NO_GAP,
    RETUNE,
    UNKNOWN,
    Candidate,
    Diagnosis,
    NamedEffect,
    SignalGap,
)
from exodrake.report import number_format as n, wording as w
from exodrake.report.diagnosis_figures import MOST, bars_svg, condition_svg, ranking_svg, spectrum_svg
from exodrake.report.held_out_runs import HeldOutRuns, changed_parameters, simulate_held_out, top_condition
from exodrake.report.page import Block, Drawing, Table, render
from exodrake.report.signal_figures import signals_svg
from exodrake.report.svg import AFTER, BEFORE, MEASURED

COLOURS = {NO_GAP: "#18794e", RETUNE: "#0b7285", NAMED: "#1d4ed8", AMBIGUOUS: "#a15c00", UNKNOWN: "#b42318"}
SURE = 0.999  # no probability is printed as larger
SMALLEST_P = 1e-4  # p-values below it are not told apart
RETUNE_LIMIT = 0.10  # relative change up to which a retuned parameter counts as nominal (diagnosis.md, RETUNE)
AT_BOUND = 1e-3  # relative distance to the limit at which a change counts as limited
SHOWN = 12  # retuned parameters that are shown at once
CLOSE = 0.02  # candidates whose removed fraction is this close to the best are named as close


def report_html(diagnosis: Diagnosis, problem: Problem) -> str:
    """The page of a diagnosis.

    Args:
        diagnosis: the answer.
        problem: from `make_problem`; its held-out logs are simulated once more.
    """
    return page(diagnosis, simulate_held_out(diagnosis, problem))


def page(diagnosis: Diagnosis, runs: HeldOutRuns) -> str:
    """The page from a diagnosis and runs that were simulated already."""
    drawn, after = bool(runs.columns and runs.residuals), w.after_name(diagnosis)
    return render(
        "diagnosis.html",
        title=f"{diagnosis.case}: diagnosis", version=__version__, colour=COLOURS.get(diagnosis.verdict, "#1d4ed8"),
        found=diagnosis, runs=runs, w=w, n=n, tiles=key_values(diagnosis),
        legend=((MEASURED, "measured"), (BEFORE, "before: nominal robot"), (AFTER, f"after: {after}")),
        signals=signal_drawings(runs) if drawn else (), gaps=gap_table(diagnosis),
        spectrum=Drawing(spectrum_svg(runs), wide=True) if drawn else None,
        notched=bool(runs.problem.notched),
        effects=[(e, effect_table(e)) for e in diagnosis.effects], sure=SURE,
        candidates=candidate_blocks(diagnosis), retuned=retuned_tables(diagnosis), close=close_candidates(diagnosis),
        logs=log_table(runs), levels=level_table(runs), **where(diagnosis, runs),
    )  # fmt: skip


def key_values(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Large values of the verdict's box with what each means."""
    where, overall = diagnosis.where, diagnosis.closure.overall
    before, after = (n.digits(w.rms_error(diagnosis, robot), 2) for robot in ("before", "after"))
    found = [(f"{before} → {after}", "RMS error in noise standard deviations, before → after")]
    if diagnosis.verdict != NO_GAP:
        text = f"closure: excess error removed by the {w.after_name(diagnosis)}; 90 % interval"
        found.append((n.percent(overall.value), f"{text} {n.percent_span(overall)}"))
        effect = diagnosis.closure.effect
        if diagnosis.effects and np.isfinite(effect.value):
            found.append((n.percent(effect.value), f"of what retuning alone leaves; {n.percent_span(effect)}"))
    if where.block != "none":
        found.insert(0, (where.block, w.seat(where.wires, where.joints) or "where the gap arises"))
    if diagnosis.verdict == NAMED and diagnosis.effects:
        least = min(e.probability for e in diagnosis.effects)
        found.append((n.percent(min(least, SURE)), "probability of this explanation among those tried"))
    return found


def signal_drawings(runs: HeldOutRuns) -> list[Drawing]:
    """Measured and simulated signals, a drawing per kind; the controller's output last and folded."""
    kinds = sorted(runs.kinds, key=lambda kind: kind == runs.controller_output)
    folded = {runs.controller_output: "the loop's answer to an error of the plant"} if len(kinds) > 1 else {}
    titles = {k: f"{runs.display(k).label}: {text}" for k, text in folded.items() if k in kinds}
    return [Drawing(signals_svg(runs, kind), wide=True, folded=titles.get(kind, "")) for kind in kinds]


def gap_table(diagnosis: Diagnosis) -> Table:
    """Gap of each signal and of each kind: nominal, retuned, after, noise, closure."""
    machine = w.machine_of(diagnosis)
    kinds = {found.kind: found for found in w.kind_gaps(diagnosis)}
    rows = []
    for name, gap in diagnosis.closure.signals.items():
        kind, channel = w.split_column(name, machine)
        rows.append(gap_row(f"{kinds[kind].display.label} {channel}", gap, kinds[kind].display.unit))
    totals = [gap_row(f"{found.display.label}, all", found.gap, found.display.unit) for found in kinds.values()]
    header = ("Signal", "Nominal", "Retuned", "After", "Noise std", "After / noise std", "Closure")
    return Table(header, [*rows, *totals], totals=len(totals))


def gap_row(title: str, gap: SignalGap, unit: str) -> tuple[str, ...]:
    """Cells of a row of the gap table."""
    gaps = [n.quantity(x, gap.unit, unit) for x in (gap.before, gap.retuned, gap.after, gap.floor)]
    closed = n.percent(gap.closure) if gap.before > w.SMALL * gap.floor and np.isfinite(gap.closure) else "–"
    return (title, *gaps, f"{gap.after / gap.floor:.2f}", closed)


def where(diagnosis: Diagnosis, runs: HeldOutRuns) -> dict[str, Any]:
    """Drawings about the place of the gap; none where there is no place."""
    if diagnosis.where.block == "none":
        return {"wiring": None, "blocks": None, "segments": None, "regime": ()}
    return {
        "wiring": wiring(diagnosis, runs), "blocks": blocks(diagnosis), "segments": segments(diagnosis, runs),
        "regime": regime(diagnosis, runs),
    }  # fmt: skip


def wiring(diagnosis: Diagnosis, runs: HeldOutRuns) -> Drawing:
    """The machine's parts and signals, parts coloured by their share."""
    from exodrake.diagrams.block_diagram import wiring_svg

    svg = wiring_svg(runs.problem.robot.machine, diagnosis.where.shares, schedule=False)
    caption = "The fuller the colour of a part, the larger its share of the gap."
    return Drawing(svg, caption, wide=True, alt="parts and signals of the robot")


def blocks(diagnosis: Diagnosis) -> Drawing | None:
    """Bars of the shares of blocks."""
    if not diagnosis.where.shares:
        return None
    caption = "How much of the gap the best single effect of each block removes."
    return Drawing(bars_svg(diagnosis.where.shares, "shares", "excess chi-square removed [%]"), caption)


def segments(diagnosis: Diagnosis, runs: HeldOutRuns) -> Drawing | None:
    """Bars of the Shapley shares of segments between measured signals."""
    found, before = diagnosis.where, "input"
    if not found.segments:
        return None
    titles = {}
    for segment in runs.problem.robot.machine.segments:
        if segment.name in found.segments:
            label = runs.display(segment.output).label.lower()
            titles[segment.name], before = f"{segment.name}: {before} to {label}", label
    named = {titles.get(s, s): v for s, v in found.segments.items()}
    alone = n.listed([f"{s} {n.digits(v, 2)}" for s, v in found.replay.items()])
    caption = (
        "Exact Shapley shares of the closed-loop gap; a segment is mended by replacing its output by the measured one. "
        f"RMS error of each segment alone, driven by measured inputs: {alone} noise standard deviations."
    )
    return Drawing(bars_svg(named, "segments", "Shapley share [%]"), caption)


def regime(diagnosis: Diagnosis, runs: HeldOutRuns) -> list[Drawing]:
    """How the residual depends on conditions; residual against the strongest condition."""
    if not diagnosis.where.regime:
        return []
    caption = (
        "Fraction of the residual's variance that goes with each condition (correlation ratio), for the retuned robot. "
        "Conditions overlap, so the fractions need not add up to 100 %."
    )
    found = [Drawing(bars_svg(diagnosis.where.regime, "regime", "variance that goes with it [%]"), caption)]
    condition = top_condition(diagnosis, runs)
    if condition is not None:
        after = w.after_name(diagnosis)
        caption = f"Error of `{condition.signal}` in noise standard deviations; lines join means of bins."
        found.append(Drawing(condition_svg(condition, "retuned robot", after), caption))
    return found


def effect_table(effect: NamedEffect) -> Table:
    """Parameters of an effect with intervals, channel by channel where they differ."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        several = len(channels) > 1
        rows.append((f"`{name}`{' (common value)' if several else ''}", *n.interval(item)))
        rows += [(f"`{name}` {channel}", *n.interval(one)) for channel, one in channels.items() if several]
    return Table(("Parameter", "Value", "90 % interval"), rows, wide=False)


def candidate_blocks(diagnosis: Diagnosis) -> list[Block]:
    """The ranking of candidates as a drawing, and all of them in numbers, folded."""
    if not diagnosis.candidates:
        return []
    named = diagnosis.verdict in (NAMED, AMBIGUOUS)
    chosen = {*diagnosis.equivalents, *(e.id for e in diagnosis.effects)} if named else set()
    rows = [
        (f"`{c.id}`", f"{100 * c.score:.1f} %", n.digits(c.chi2), shown(c.prediction_chi2), p_value(c.fit), kept(c))
        for c in diagnosis.candidates
    ]
    header = (
        "Candidate",
        "Excess removed",
        "chi-square, closed loop",
        "chi-square, prediction error",
        "p of the fit",
        "",
    )
    title = f"All {len(rows)} candidates in numbers (the figure shows {min(MOST, len(rows))})"
    label = "excess chi-square of the retuned robot that the candidate removes [%]"
    caption = (
        "Each candidate is fitted on the fit logs together with the nominal parameters, in closed loop and as "
        "prediction error; in blue what the verdict names. 100 %: reduced chi-square of 1, as of noise alone. A candidate "
        "that is far behind after two steps is not fitted to the end."
    )
    drawing = Drawing(ranking_svg(diagnosis.candidates, chosen, label), caption, wide=True)
    return [drawing, Table(header, rows, folded=title)]


def shown(value: float) -> str:
    """A number, or a dash for none."""
    return n.digits(value) if np.isfinite(value) else "–"


def p_value(value: float) -> str:
    """A p-value; one below the level of the tests by far is not resolved."""
    return f"{value:.2g}" if value >= SMALLEST_P else f"< {SMALLEST_P:g}"


def kept(candidate: Candidate) -> str:
    """What the tests say of a candidate."""
    return "not rejected" if candidate.left else "rejected"


def retuned_tables(diagnosis: Diagnosis) -> list[Table]:
    """Nominal parameters that the last robot changes; the smaller changes folded."""
    rows = []
    for name, unit, before, after in changed_parameters(diagnosis):
        change = f"{100 * (after / before - 1):+.1f} %" if abs(before) > abs(after - before) else "–"
        if before and unit != "rad" and abs(abs(after / before - 1) / RETUNE_LIMIT - 1) < AT_BOUND:
            change += " (at its bound)"
        rows.append((f"`{name}`", n.quantity(before, unit), n.quantity(after, unit), change))
    header, rest = ("Parameter", "Nominal", "Retuned", "Change"), rows[SHOWN:]
    tables = [Table(header, rows[:SHOWN], wide=False)] if rows else []
    return tables + ([Table(header, rest, wide=False, folded=f"{len(rest)} smaller changes")] if rest else [])


def close_candidates(diagnosis: Diagnosis) -> str:
    """Candidates that come near the named one, in a list; empty if there are none."""
    named = {e.id for e in diagnosis.effects}
    best = diagnosis.candidates[0].score if diagnosis.candidates else 1.0
    near = [c.id for c in diagnosis.candidates if not named & set(c.id.split(" + ")) and c.score > best - CLOSE]
    return n.listed([f"`{identity}`" for identity in near])


def log_table(runs: HeldOutRuns) -> Table:
    """Name, role, length and missing samples of each log."""
    rows = []
    for t in (*runs.problem.fit, *runs.problem.holdout):
        missing = float(np.mean(~np.isfinite(t.measured))) if t.measured.size else 0.0
        lacking = "none" if missing == 0.0 else f"{100 * missing:.2g} %"
        rows.append((t.name, t.role, f"{len(t.reference) * runs.period:.0f} s", lacking))
    return Table(("Log", "Role", "Length", "Missing samples"), rows, words=2, wide=False)


def level_table(runs: HeldOutRuns) -> Table:
    """Each number of the tests with its meaning and provenance."""
    rows = decision_numbers(runs.problem.robot.machine)
    return Table(("Number", "Value", "Source"), rows, words=3, folded="The numbers of the tests")
