"""Sections of the page about place and cause: wiring, shares, regime; candidates, parameters, retuned numbers."""

from __future__ import annotations

import re

from exodrake.core.machine import Machine
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, UNKNOWN, Diagnosis, NamedEffect
from exodrake.report import markup as m
from exodrake.report import words as w
from exodrake.report.charts import MOST, bars_svg, condition_svg, ranking_svg
from exodrake.report.evidence import Evidence, changed_parameters, top_condition

SEGMENTS = {
    "motor": "motor: command to stroke",
    "tendon": "tendon: stroke to tension",
    "finger": "finger: tension to angle",
}
SURE = 0.999  # no probability is told as larger
FAR = 0.10  # relative change up to which a number is the nominal one (diagnosis.md, RETUNE)
TOLD = 12  # retuned numbers that are shown at once


def where(diagnosis: Diagnosis, evidence: Evidence) -> str:
    """Wiring with shares, block shares, Shapley shares of segments, regime."""
    found = diagnosis.where
    if found.block == "none":
        return ""
    place = w.seat(found.wires, found.joints)
    parts = [m.heading(2, "Where: the block, the wires and joints, the regime")]
    parts.append(m.paragraph(f"The gap arises in the {found.block}{f', on {place}' if place else ''}."))
    machine = evidence.problem.robot.machine
    parts.append(m.figure(wiring(machine, found.shares), WIRING, wide=True))
    left, right = "", ""
    if found.shares:
        left = m.heading(3, "Blocks") + m.figure(bars_svg(found.shares, "shares", "share of the gap [%]"), BLOCKS)
    if found.segments:
        named = {SEGMENTS.get(s, s): v for s, v in found.segments.items()}
        alone = w.list_words([f"{s} {w.digits(v, 2)}" for s, v in found.replay.items()])
        caption = f"{SHAPLEY} Error of each segment when fed what was measured: {alone} noise floors."
        right = m.heading(3, "Segments between measured wires") + m.figure(
            bars_svg(named, "segments", "Shapley share [%]"), caption
        )
    elif left and len(machine.segments) > 1:
        right = m.heading(3, "Segments between measured wires") + m.paragraph(NO_SEGMENTS)
    return "".join([*parts, m.pair(left, right), regime(diagnosis, evidence)])


WIRING = "The fuller a part's colour, the larger its share of the gap. Tendon and finger are one stiff part."
BLOCKS = "Share of each block: how much of the gap its best single effect removes."
NO_SEGMENTS = "No shares by replay: fed with what was measured, a segment runs away, or too little is left to share."
SHAPLEY = (
    "Exact Shapley shares of the closed-loop gap: a segment is mended by putting its measured output in its place."
)


def wiring(machine: Machine, shares: dict[str, float]) -> str:
    """The robot's wiring, parts coloured by their share; the schedule below it is cut off."""
    from exodrake.diagrams.block_diagram import wiring_svg

    svg = wiring_svg(machine, part_shares(machine, shares))
    frame = re.search(r'<text[^>]*\sy="([\d.]+)"[^>]*>One frame', svg)
    if frame:
        high = float(frame[1]) - 24.0
        svg = re.sub(
            r'(viewBox="0 0 [\d.]+) [\d.]+"([^>]*?) height="[\d.]+"', rf'\1 {high:g}"\2 height="{high:g}"', svg, count=1
        )
    return m.picture(svg, "wiring of the robot")


def part_shares(machine: Machine, shares: dict[str, float]) -> dict[str, float]:
    """Shares of blocks as the effects name them, as shares of the machine's parts that hold those effects."""
    found = {block.name: 0.0 for block in machine.parts}
    for name, value in shares.items():
        hosts = [b.name for b in machine.parts for e in machine.effects_on(b) if e.block == name]
        if hosts:
            found[max(set(hosts), key=hosts.count)] += value
    return found


def regime(diagnosis: Diagnosis, evidence: Evidence) -> str:
    """What the gap depends on: explained variance, and residual against the strongest condition."""
    if not diagnosis.where.regime:
        return ""
    bars = m.figure(bars_svg(diagnosis.where.regime, "regime", "variance of the error explained [%]"), REGIME)
    condition = top_condition(diagnosis, evidence)
    right = ""
    if condition is not None:
        caption = (
            f"Error of `{condition.signal}`: retuned numbers, {w.after_name(diagnosis)}; lines join means of bins."
        )
        right = m.figure(condition_svg(condition, "retuned numbers", w.after_name(diagnosis)), caption)
    return m.heading(3, "Regime: what the error depends on") + m.pair(bars, right)


REGIME = "Conditions overlap, so the shares need not add up to 100 %. Taken from the error that retuned numbers leave."


def which(diagnosis: Diagnosis) -> str:
    """Candidates, the effects with their parameters, the nominal numbers that moved."""
    parts = [m.heading(2, "Which: the effect")]
    for effect in diagnosis.effects:
        parts.append(effect_table(diagnosis, effect))
    if diagnosis.candidates:
        chosen = (
            {*diagnosis.equivalents, *(e.id for e in diagnosis.effects)}
            if diagnosis.verdict in (NAMED, AMBIGUOUS)
            else set()
        )
        parts += [
            m.heading(3, "Candidates"),
            m.figure(ranking_svg(diagnosis.candidates, chosen), RANKING, wide=True),
            candidate_table(diagnosis),
        ]
    parts.append(retuned_table(diagnosis))
    return "".join(parts) if len("".join(parts)) > len(parts[0]) else ""


RANKING = (
    "Every candidate is fitted together with small errors of the nominal numbers and judged on all logs; in colour "
    "what the verdict names. 100 %: down to the noise floor."
)


def effect_table(diagnosis: Diagnosis, effect: NamedEffect) -> str:
    """Parameters of an effect with intervals, channel by channel where they differ."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        several = len(channels) > 1
        rows.append((f"`{name}`{' (common value)' if several else ''}", *w.interval_words(item)))
        rows += [(f"`{name}` {channel}", *w.interval_words(one)) for channel, one in channels.items() if several]
    place = w.seat(effect.wires, effect.joints)
    title = f"{w.name_of(effect.id).capitalize()}{f' on {place}' if place else ''}"
    about = (
        f"`{effect.id}`: {w.summary_of(diagnosis, effect.id)}. Probability {w.share(min(effect.probability, SURE))}."
    )
    return m.heading(3, title) + m.paragraph(about) + m.table(("Parameter", "Value", "90 % interval"), rows, wide=False)


def candidate_table(diagnosis: Diagnosis) -> str:
    """Misfits of all candidates, behind a line that opens them."""
    rows = [
        (f"`{c.id}`", f"{100 * c.score:.1f} %", w.digits(c.chi2), w.digits(c.holdout_chi2))
        for c in diagnosis.candidates
    ]
    header = ("Candidate", "Explained", "Misfit, fitted logs [floor²]", "Misfit, held-out logs [floor²]")
    return m.folded(
        f"All {len(rows)} candidates in numbers (the figure shows {min(MOST, len(rows))})", m.table(header, rows)
    )


def retuned_table(diagnosis: Diagnosis) -> str:
    """Nominal numbers that the last robot changes."""
    rows = []
    for name, unit, before, after in changed_parameters(diagnosis):
        change = f"{100 * (after / before - 1):+.1f} %" if abs(before) > abs(after - before) else "–"
        if before and abs(after / before - 1) > 0.999 * FAR and unit != "rad":
            change += " (as far as a fit may go)"
        rows.append((f"`{name}`", w.quantity(before, unit), w.quantity(after, unit), change))
    if not rows:
        return ""
    header = ("EffectParameter", "Nominal", "Retuned", "Change")
    rest = (
        m.folded(f"{len(rows) - TOLD} smaller changes", m.table(header, rows[TOLD:], wide=False))
        if len(rows) > TOLD
        else ""
    )
    words = (
        RETUNED
        if diagnosis.verdict != UNKNOWN
        else f"{RETUNED} They belong to the best candidate, which is not accepted."
    )
    return (
        m.heading(3, "Nominal numbers that moved along")
        + m.paragraph(words)
        + m.table(header, rows[:TOLD], wide=False)
        + rest
    )


RETUNED = (
    "Small errors of the nominal numbers are fitted along, each held near its nominal value; largest changes first."
)
