"""A diagnosis in words: verdicts, places, quantities with the unit a person thinks in, gaps per kind of signal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from exodrake.core.units import UNITS
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN, Diagnosis, Interval, NamedEffect

PERSONAL = {"m": "mm", "m/s": "mm/s", "rad": "deg", "rad/s": "deg/s", "N/m": "N/mm", "N m": "mN m", "A": "mA"}
SIGNS = {"deg": "°", "deg/s": "°/s", "-": ""}
KINDS = {
    "tension": "Tension", "stroke": "Stroke", "speed_cmd": "Speed command", "angle": "Joint angle", "position":
    "Position", "force": "Force",
}  # fmt: skip
COLOURS = {NO_GAP: "#18794e", RETUNE: "#0b7285", NAMED: "#1d4ed8", AMBIGUOUS: "#a15c00", UNKNOWN: "#b42318"}
TITLES = {
    NO_GAP: "No gap",
    RETUNE: "Retune",
    NAMED: "Named",
    AMBIGUOUS: "Ambiguous",
    UNKNOWN: "Unknown",
}
NEARLY = 0.99  # a share above it is told to a tenth of a per cent
DIGITS = 3  # significant digits of a gap


@dataclass(frozen=True)
class KindGap:
    """RMS gap over the signals of one kind on held-out logs [SI], their floor, and the closure of this kind."""

    kind: str
    before: float
    retuned: float
    after: float
    floor: float
    closure: float
    unit: str


def personal(unit: str) -> tuple[str, float]:
    """The unit a person thinks in, and its factor from SI: "rad" -> ("deg", 57.3)."""
    name = PERSONAL.get(unit, unit)
    if name == unit:
        return unit, 1.0
    _, up, down = UNITS[name]
    return name, float(down / up)


def sign_of(unit: str) -> str:
    """A unit as it is printed: deg -> °, - -> nothing."""
    return SIGNS.get(unit, unit)


def with_unit(number: str, unit: str) -> str:
    """A printed number with its unit."""
    sign = sign_of(unit)
    return f"{number}{sign}" if sign.startswith("°") else f"{number} {sign}".rstrip()


def digits(value: float, count: int = DIGITS) -> str:
    """A number with `count` significant digits and no exponent where that is readable."""
    if not math.isfinite(value):
        return "none" if math.isnan(value) else "∞" if value > 0 else "-∞"
    if value == 0.0:
        return "0"
    places = count - 1 - math.floor(math.log10(abs(value)))
    if not -count < places < 8:
        return f"{value:.{count - 1}e}"
    return f"{value:.{max(0, places)}f}"


def quantity(value: float, unit: str, count: int = DIGITS) -> str:
    """A number [SI] in the unit a person thinks in."""
    name, factor = personal(unit)
    return with_unit(digits(factor * value, count), name)


def interval_words(item: Interval) -> tuple[str, str]:
    """A value, and its 90 % interval, with as many decimals as the interval deserves."""
    name, factor = personal(item.unit)
    value, low, high = (factor * x for x in (item.value, item.low, item.high))
    width = high - low
    if not all(math.isfinite(x) for x in (value, low, high)) or width <= 0.0:
        return with_unit(digits(value), name), f"{digits(low)} to {digits(high)}"
    places = max(0, min(8, 1 - math.floor(math.log10(width))))
    low_high = f"{low:.{places}f} to {high:.{places}f}"
    return with_unit(f"{value:.{places}f}", name), low_high


def share(value: float) -> str:
    """A share as per cent; what is nearly all is not told as all."""
    if not math.isfinite(value):
        return "none"
    if NEARLY < value < 1.0:
        return f"{math.floor(1000 * value) / 10:.1f} %"
    return f"{100 * value:.0f} %"


def closure_words(item: Interval) -> str:
    """The closure with its interval."""
    return f"{share(item.value)} ({share(item.low).removesuffix(' %')} to {share(item.high)})"


def list_words(items: tuple[str, ...] | list[str], last: str = "and") -> str:
    """a, b and c."""
    items = list(items)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""


def seat(wires: tuple[str, ...], joints: tuple[str, ...]) -> str:
    """Wires and joints in words; nothing if there are none."""
    parts = [f"{one if len(names) == 1 else many} {list_words(names)}"
             for one, many, names in (("wire", "wires", wires), ("joint", "joints", joints)) if names]  # fmt: skip
    return " and ".join(parts)


def name_of(identity: str) -> str:
    """`tendon.capstan_friction` -> `capstan friction`."""
    return " + ".join(part.strip().split(".")[-1].replace("_", " ") for part in identity.split("+"))


def summary_of(diagnosis: Diagnosis, identity: str) -> str:
    """What an effect is, from the effect library of the robot; empty if the effect library lacks it."""
    for robot in diagnosis.robots.values():
        for effect in robot.machine.effects:
            if effect.id == identity:
                return effect.summary
    return ""


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    verdict, where = diagnosis.verdict, diagnosis.where
    if verdict == NO_GAP:
        return "The nominal robot explains every signal down to its noise floor."
    if verdict == RETUNE:
        return "Nominal numbers within 10 % of themselves explain every signal; no effect is missing."
    if verdict == UNKNOWN:
        place = " ".join(p for p in (f"in the {where.block}", f"({seat(where.wires, where.joints)})"
                                     if where.wires or where.joints else "") if p)  # fmt: skip
        return f"There is a real gap {place} that no known effect brings down to the floor."
    if verdict == AMBIGUOUS:
        names = list_words([name_of(i) for i in class_of(diagnosis)], "or")
        return f"The logs cannot tell apart: {names}."
    text = " and ".join(effect_words(e) for e in diagnosis.effects)
    return f"{text[:1].upper()}{text[1:]}."


def effect_words(effect: NamedEffect) -> str:
    """An effect with its place: `capstan friction on wires AF and MF`."""
    place = seat(effect.wires, effect.joints)
    return name_of(effect.id) + (f" on {place}" if place else f" in the {effect.id.split('.')[0]}")


def class_of(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Ids of the class of an ambiguous verdict, best first and each once."""
    return tuple(dict.fromkeys((*diagnosis.equivalents, *(e.id for e in diagnosis.effects))))


def after_name(diagnosis: Diagnosis) -> str:
    """What the last of the three robots is."""
    names = {NO_GAP: "nominal robot", RETUNE: "retuned robot", UNKNOWN: "best candidate (not accepted)"}
    return names.get(diagnosis.verdict, "improved robot")


def kind_gaps(diagnosis: Diagnosis) -> list[KindGap]:
    """Gap per kind of signal, from the gaps of its signals."""
    found = []
    for kind in KINDS:
        signals = [s for name, s in diagnosis.closure.signals.items() if name.rsplit("_", 1)[0] == kind]
        if not signals:
            continue
        rows = np.array([[s.before, s.retuned, s.after, s.floor] for s in signals])
        before, retuned, after, floor = np.sqrt(np.mean(rows**2, axis=0))
        excess = np.mean((rows[:, :3] / rows[:, 3:]) ** 2, axis=0) - 1.0
        closed = 1.0 - max(excess[2], 0.0) / excess[0] if excess[0] > 0.0 else math.nan
        found.append(KindGap(kind, before, retuned, after, floor, float(closed), signals[0].unit))
    return found


def experiment_words(diagnosis: Diagnosis) -> str:
    """What to measure next; empty if nothing is proposed."""
    found = diagnosis.next_experiment
    if not found:
        return ""
    text = (
        f"Run the protocol “{found['protocol']}” for {found['seconds']:.0f} s: the closest two of the class then "
        f"differ by {digits(found['difference_in_floors'], 2)} times the noise floor."
    )
    return text if found.get("enough", True) else f"{text} That is too little; {found.get('advice', '')}."
