"""A diagnosis in words: verdict, place, effects, what to measure next; and its gap per kind of signal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from exodrake.core.display import Display, display_of
from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.core.plural import plural
from exodrake.diagnosis.gap import SignalGap
from exodrake.diagnosis.result import AMBIGUOUS, NO_GAP, RETUNE, UNKNOWN, Diagnosis, NamedEffect
from exodrake.report.number_format import closure, digits, interval, listed, percent

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
        f"{plural(len(names), axis)} {listed(names)}"
        for axis, names in (("tendon", tendons), ("joint", joints))
        if names
    ]
    return " and ".join(parts)


def name_of(identity: str) -> str:
    """`tendon.capstan_friction` -> `capstan friction`."""
    return " + ".join(part.strip().split(".")[-1].replace("_", " ") for part in identity.split("+"))


def effect_of(diagnosis: Diagnosis, identity: str) -> Effect | None:
    """An effect of the library of the machine; None if the library lacks it."""
    machine = machine_of(diagnosis)
    return next((e for e in machine.effects if e.id == identity), None) if machine else None


def summary_of(diagnosis: Diagnosis, identity: str) -> str:
    """Summary of an effect in one sentence; empty if the library lacks it."""
    effect = effect_of(diagnosis, identity)
    return effect.summary if effect else ""


def effect_words(effect: NamedEffect) -> str:
    """An effect with its place: `capstan friction on tendons AF and MF`."""
    place = seat(effect.wires, effect.joints)
    return name_of(effect.id) + (f" on {place}" if place else f" in the {effect.id.split('.')[0]}")


def parameter_values(effect: NamedEffect) -> list[tuple[str, str, str]]:
    """Name, value with unit and 90 % interval of each parameter; channel by channel where their values disagree."""
    found = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        alike = all(item.low <= one.value <= item.high for one in channels.values())
        several = {} if alike else {f"{name} {channel}": one for channel, one in channels.items()}
        found += [(title, *interval(one)) for title, one in (several or {name: item}).items()]
    return found


def value_words(effect: NamedEffect) -> str:
    """The parameters of an effect in a sentence: `mu_phi 0.31 (90 %: 0.28 to 0.34)`."""
    return ", ".join(f"{name} {value} (90 %: {span})" for name, value, span in parameter_values(effect))


def headline(diagnosis: Diagnosis, values: bool = True) -> str:
    """The verdict in one sentence, with or without the values of the named effects' parameters."""
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
        names = listed([name_of(i) for i in class_of(diagnosis)], "or")
        return f"The logs cannot tell apart: {names}{unconfirmed(diagnosis)}."
    words = [effect_words(e) + (f": {value_words(e)}" if values else "") for e in diagnosis.effects]
    text = ("; and " if values else " and ").join(words)
    closed = "" if diagnosis.closure.overall.value > 0.0 else ": the cause is found, the gap is not closed"
    return f"{text[:1].upper()}{text[1:]}{unconfirmed(diagnosis)}{closed}."


def unconfirmed(diagnosis: Diagnosis) -> str:
    """Says of effects that held-out motion does not confirm them; empty of others."""
    return ", which held-out motion does not confirm" if diagnosis.confirmed is False else ""


def class_of(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the class of an ambiguous verdict, best first and each once."""
    return tuple(dict.fromkeys((*diagnosis.equivalents, *(e.id for e in diagnosis.effects))))


def tested_words(diagnosis: Diagnosis) -> str:
    """The explanation behind the verdict."""
    if diagnosis.verdict == NO_GAP:
        return "the nominal robot"
    if diagnosis.verdict == RETUNE:
        return "the robot with retuned parameters and no effect"
    if diagnosis.verdict == UNKNOWN:
        return "the best explanation that was tried"
    return f"the robot with {listed([effect_words(e) for e in diagnosis.effects])}"


def robots_of(diagnosis: Diagnosis) -> dict[str, str]:
    """The robots that the answer compares: their key among the gaps of a signal -> what they are."""
    robots = {"before": "nominal robot", "retuned": "retuned robot", "after": "improved robot"}
    if diagnosis.verdict == UNKNOWN:
        return robots | {"after": "best candidate (not accepted)"}
    return dict(list(robots.items())[: {NO_GAP: 1, RETUNE: 2}.get(diagnosis.verdict, 3)])


def last_robot(diagnosis: Diagnosis) -> str:
    """Description of the last of these robots."""
    return list(robots_of(diagnosis).values())[-1]


def robot_titles(diagnosis: Diagnosis) -> list[str]:
    """Titles of columns of these robots: `Nominal`, `Retuned`, `Improved`."""
    return [name.removesuffix(" robot").partition(" (")[0].capitalize() for name in robots_of(diagnosis).values()]


def kind_gaps(diagnosis: Diagnosis) -> list[KindGap]:
    """Gap per kind of signal, from the gaps of its signals."""
    machine = machine_of(diagnosis)
    by_kind: dict[str, list[SignalGap]] = {}
    for name, gap in diagnosis.closure.signals.items():
        by_kind.setdefault(split_column(name, machine)[0], []).append(gap)
    found = []
    for kind, gaps in by_kind.items():
        rows = np.array([[s.before, s.retuned, s.after, s.noise_std] for s in gaps])
        excess = np.mean((rows[:, :3] / rows[:, 3:]) ** 2, axis=0) - 1.0
        closed = 1.0 - max(excess[2], 0.0) / excess[0] if excess[0] > 0.0 else math.nan
        before, retuned, after, noise_std = np.sqrt(np.mean(rows**2, axis=0)).tolist()
        total = SignalGap(before, retuned, after, noise_std, float(closed), gaps[0].unit)
        found.append(KindGap(kind, display_of(kind, machine), total))
    return found


def motion_words(diagnosis: Diagnosis) -> str:
    """Kinds of motion that the closure was measured on, and closures of kinds left out of the fit."""
    found = diagnosis.closure
    if not found.motions or not diagnosis.effects:
        return ""
    each = ", ".join(f"{kind} {closure(c.value)}" for kind, c in found.motions.items())
    return f"measured on {', '.join(found.measured_on)}; kinds of motion left out of the fit, one at a time: {each}"


def experiment_words(diagnosis: Diagnosis) -> str:
    """The command that designs the motion by which the explanations still in play differ; empty without any."""
    if not diagnosis.rivals:
        return ""
    return "`exodrake experiment CASE --out reference.csv` designs the motion that tells them apart"


def moved_words(diagnosis: Diagnosis) -> list[str]:
    """Parameters that retuning moved, and the effects that alone explain as much; nothing where it moved nothing."""
    found = diagnosis.retune
    lines = []
    if found.moved:
        shown = [f"{m.name} {digits(m.nominal, 3)} -> {digits(m.value, 3)} {m.unit}" for m in found.moved[:MOST_MOVED]]
        rest = len(found.moved) - len(shown)
        lines.append("; ".join(shown) + (f"; and {rest} more" if rest > 0 else ""))
    if found.alike:
        shares = [f"{identity} ({percent(share)} of that)" for identity, share in found.alike.items()]
        lines.append(f"one effect alone, with nominal parameters, closes as much: {', '.join(shares)}")
    return lines
