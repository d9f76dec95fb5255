"""A diagnosis in words: verdict, place, effects, what to measure next; and its gap per kind of signal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from exodrake.core.display import Display, display_of
from exodrake.core.machine import Machine
from exodrake.diagnosis.result import AMBIGUOUS, NO_GAP, RETUNE, UNKNOWN, Diagnosis, NamedEffect, SignalGap
from exodrake.report.number_format import digits, listed

MOST_MOVED = 4  # parameters that the terminal lists
SMALL = 1.1  # noise standard deviations: a gap below it leaves nothing to close


@dataclass(frozen=True)
class KindGap:
    """RMS over the signals of one kind on held-out logs [SI]: gaps, noise; closure; how the kind is shown."""

    kind: str
    display: Display
    gap: SignalGap


def machine_of(diagnosis: Diagnosis) -> Machine | None:
    """The machine of the diagnosed robots."""
    return next((robot.machine for robot in diagnosis.robots.values()), None)


def split_column(name: str, machine: Machine | None) -> tuple[str, str]:
    """Kind and channel of a column: `speed_cmd_AF` -> (`speed_cmd`, `AF`)."""
    kinds = [c.kind for c in machine.columns if name.startswith(f"{c.kind}_")] if machine else []
    kind = max(kinds, key=len) if kinds else name.rsplit("_", 1)[0]
    return kind, name[len(kind) + 1 :]


def seat(tendons: tuple[str, ...], joints: tuple[str, ...]) -> str:
    """Tendons and joints in words; empty if there are none."""
    parts = [
        f"{axis if len(names) == 1 else axis + 's'} {listed(names)}"
        for axis, names in (("tendon", tendons), ("joint", joints))
        if names
    ]
    return " and ".join(parts)


def name_of(identity: str) -> str:
    """`tendon.capstan_friction` -> `capstan friction`."""
    return " + ".join(part.strip().split(".")[-1].replace("_", " ") for part in identity.split("+"))


def summary_of(diagnosis: Diagnosis, identity: str) -> str:
    """What an effect is, from the effect library of the machine; empty if the library lacks it."""
    machine = machine_of(diagnosis)
    return next((e.summary for e in machine.effects if e.id == identity), "") if machine else ""


def effect_words(effect: NamedEffect) -> str:
    """An effect with its place: `capstan friction on tendons AF and MF`."""
    place = seat(effect.wires, effect.joints)
    return name_of(effect.id) + (f" on {place}" if place else f" in the {effect.id.split('.')[0]}")


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    where = diagnosis.where
    if diagnosis.verdict == NO_GAP:
        return "The nominal robot is consistent with noise on every signal."
    if diagnosis.verdict == RETUNE:
        return "Nominal parameters within their tolerances explain every signal; no effect is needed."
    if diagnosis.verdict == UNKNOWN:
        place = seat(where.wires, where.joints)
        within = f" in the {where.block}" if where.block != "none" else ""
        return f"There is a gap{within}{f' ({place})' if place else ''} that no effect of the library explains."
    if diagnosis.verdict == AMBIGUOUS:
        return f"The logs cannot tell apart: {listed([name_of(i) for i in class_of(diagnosis)], 'or')}."
    text = " and ".join(effect_words(e) for e in diagnosis.effects)
    closed = "" if diagnosis.closure.overall.value > 0.0 else ": the cause is found, the gap is not closed"
    return f"{text[:1].upper()}{text[1:]}{closed}."


def class_of(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the class of an ambiguous verdict, best first and each once."""
    return tuple(dict.fromkeys((*diagnosis.equivalents, *(e.id for e in diagnosis.effects))))


def after_name(diagnosis: Diagnosis) -> str:
    """What the last of the three robots is."""
    names = {NO_GAP: "nominal robot", RETUNE: "retuned robot", UNKNOWN: "best candidate (not accepted)"}
    return names.get(diagnosis.verdict, "improved robot")


def kind_gaps(diagnosis: Diagnosis) -> list[KindGap]:
    """Gap per kind of signal, from the gaps of its signals."""
    machine = machine_of(diagnosis)
    by_kind: dict[str, list[SignalGap]] = {}
    for name, gap in diagnosis.closure.signals.items():
        by_kind.setdefault(split_column(name, machine)[0], []).append(gap)
    found = []
    for kind, gaps in by_kind.items():
        rows = np.array([[s.before, s.retuned, s.after, s.floor] for s in gaps])
        excess = np.mean((rows[:, :3] / rows[:, 3:]) ** 2, axis=0) - 1.0
        closed = 1.0 - max(excess[2], 0.0) / excess[0] if excess[0] > 0.0 else math.nan
        before, retuned, after, noise_std = np.sqrt(np.mean(rows**2, axis=0)).tolist()
        total = SignalGap(before, retuned, after, noise_std, float(closed), gaps[0].unit)
        found.append(KindGap(kind, display_of(kind, machine), total))
    return found


def rms_error(diagnosis: Diagnosis, robot: str) -> float:
    """RMS error over all signals on held-out logs [noise standard deviations]; robot: before, retuned or after."""
    squares = [(getattr(s, robot) / s.floor) ** 2 for s in diagnosis.closure.signals.values()]
    return float(np.sqrt(np.mean(squares))) if squares else math.nan


def experiment_words(diagnosis: Diagnosis) -> str:
    """What to measure next; empty if nothing is proposed."""
    found = diagnosis.next_experiment
    if not found:
        return ""
    text = (
        f"Run the protocol “{found['protocol']}” for {found['seconds']:.0f} s: the closest two of the class then "
        f"differ by {digits(found['difference_in_floors'], 2)} noise standard deviations."
    )
    return text if found.get("enough", True) else f"{text} That is too little; {found.get('advice', '')}."


def moved_words(diagnosis: Diagnosis) -> list[str]:
    """What retuning moved, and the effects that alone explain as much; nothing where it moved nothing."""
    found = diagnosis.retune
    lines = []
    if found.moved:
        shown = [f"{m.name} {digits(m.nominal, 3)} -> {digits(m.value, 3)} {m.unit}" for m in found.moved[:MOST_MOVED]]
        rest = len(found.moved) - len(shown)
        lines.append("; ".join(shown) + (f"; and {rest} more" if rest > 0 else ""))
    if found.alike:
        shares = [f"{identity} ({share:.0%})" for identity, share in found.alike.items()]
        lines.append(f"one effect alone would explain as much: {', '.join(shares)}")
    return lines
