"""Units at the door: every unit that a file, an option or a call may carry to SI, and the kinds of signal in a log.

A column is headed `kind_name [unit]`, for instance `tension_AF [N]`. Names of tendons and joints are free; a known kind
fixes the SI unit its column must have, an unknown kind may carry any known unit. `"2.5 N/mm"` is a quantity.
"""

import math
import re
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from exodrake.core.errors import InputError

# symbol: (SI unit, numerator, denominator); SI value = value * numerator / denominator, so decimal prefixes round
# correctly. Products, quotients and powers of symbols need no row: `N/mm`, `mN m/rad`, `g cm2`, `m/(s N)`.
UNITS: Mapping[str, tuple[str, float, float]] = {
    "-": ("-", 1, 1), "1": ("-", 1, 1), "%": ("-", 1, 100), "frames": ("-", 1, 1), "count": ("-", 1, 1),
    "s": ("s", 1, 1), "ms": ("s", 1, 1000), "us": ("s", 1, 1_000_000), "ns": ("s", 1, 1_000_000_000),
    "min": ("s", 60, 1), "Hz": ("Hz", 1, 1), "kHz": ("Hz", 1000, 1),
    "m": ("m", 1, 1), "cm": ("m", 1, 100), "mm": ("m", 1, 1000), "um": ("m", 1, 1_000_000),
    "rad": ("rad", 1, 1), "mrad": ("rad", 1, 1000), "deg": ("rad", np.pi, 180), "rev": ("rad", 2 * np.pi, 1),
    "rpm": ("rad/s", np.pi, 30),
    "N": ("N", 1, 1), "mN": ("N", 1, 1000), "kN": ("N", 1000, 1), "gf": ("N", 9.80665, 1000), "kgf": ("N", 9.80665, 1),
    "A": ("A", 1, 1), "mA": ("A", 1, 1000), "V": ("V", 1, 1), "mV": ("V", 1, 1000),
    "W": ("W", 1, 1), "mW": ("W", 1, 1000), "kg": ("kg", 1, 1), "g": ("kg", 1, 1000), "K": ("K", 1, 1),
    "Pa": ("Pa", 1, 1), "kPa": ("Pa", 1000, 1),
}  # fmt: skip
SPELLINGS = {
    "nm": "N m", "Nm": "N m", "mNm": "mN m", "Ncm": "N cm", "Nmm": "N mm", "Nms": "N m s", "Ns": "N s", "sec": "s",
    "usec": "us", "msec": "ms", "°": "deg", "degrees": "deg", "radians": "rad",
}  # fmt: skip
COMMON = ("m/s", "mm/s", "m/s2", "rad/s", "deg/s", "N/m", "N/mm", "N s/m", "N m", "N mm", "mN m", "N m/rad", "1/s")

# kind: SI units it may have; the first is the one a simulated log gets
KINDS: dict[str, tuple[str, ...]] = {
    "time": ("s",),
    "tension": ("N",), "tension_ref": ("N",), "tension_true": ("N",), "tension_finger": ("N",),
    "stroke": ("m",), "stroke_ref": ("m",), "speed": ("m/s", "rad/s"), "speed_cmd": ("m/s", "rad/s"),
    "angle": ("rad",), "angle_ref": ("rad",), "angle_est": ("rad",), "angle_std": ("rad",),
    "angle_start": ("rad",), "bend": ("rad",),
    "angle_speed": ("rad/s",),
    "position": ("rad", "m"), "position_ref": ("rad", "m"), "position_start": ("rad", "m"),
    "speed_start": ("rad/s", "m/s"),
    "velocity": ("rad/s", "m/s"), "velocity_ref": ("rad/s", "m/s"), "acceleration": ("rad/s2", "m/s2"),
    "current": ("A",), "current_ref": ("A",), "voltage": ("V",), "voltage_ref": ("V",),
    "torque": ("N m",), "torque_ref": ("N m",), "force": ("N",), "force_ref": ("N",),
    "effort": ("N m", "N", "A"), "effort_ref": ("N m", "N", "A"), "temperature": ("K",),
}  # fmt: skip


def add_kind(kind: str, unit: str, where: str) -> None:
    """Adds the kind of a machine's column to the table. InputError for a known kind in a unit that it cannot have."""
    if unit not in KINDS.setdefault(kind, (unit,)):
        wanted = " or ".join(f"[{known}]" for known in KINDS[kind])
        raise InputError(f"{where}: column {kind} in [{unit}], wanted {wanted}; or call it otherwise")


class Conversion(NamedTuple):
    """From a unit to SI: value * numerator / denominator. `powers`: exponent of each SI symbol in it."""

    si: str
    numerator: float
    denominator: float
    powers: dict[str, int]


def tidy(unit: str) -> str:
    """The table's spelling of a unit: `N*m`, `Nm`, `µm`, `m/s^2` and the like become `N m`, `um`, `m/s2`."""
    text = unit.strip().replace("µ", "u").replace("μ", "u").replace("^", "").replace("²", "2")
    text = " ".join(text.replace("·", " ").replace("*", " ").replace(".", " ").split())
    text = re.sub(r" ?/ ?", "/", text)
    words = (SPELLINGS.get(word, word) for word in re.split(r"([ /()])", text))
    return {"": "-", "rev/min": "rpm"}.get(text) or "".join(words)


@cache
def conversion(unit: str) -> Conversion | None:
    """Conversion of a unit to SI; None for one that cannot be read, such as `N/m s`, which may mean two things."""
    text, symbol = tidy(unit), r"([A-Za-z]+)([2-9]?)"
    if text in UNITS:
        si, numerator, denominator = UNITS[text]
        powers = {"rad/s": {"rad": 1, "s": -1}, "-": {}}.get(si, {si: 1})
        return Conversion(si, numerator, denominator, powers)
    parts = re.fullmatch(r"([^/()]+)((?:/(?:[^ /()]+|\([^/()]+\)))*)", text)
    if parts is None:
        return None
    ratio, powers = [1.0, 1.0], dict[str, int]()
    for place, words in enumerate((parts[1].removeprefix("1/").split(), re.split(r"[ /()]+", parts[2])[1:])):
        for word in filter(None, words):
            found = re.fullmatch(symbol, word)
            si, *factors = UNITS.get(found[1], ("-", 1, 1)) if found else ("-", 1, 1)
            if found is None or not si.isalpha():
                if word == "1" and not place:
                    continue
                return None
            power = int(found[2] or 1)
            ratio[place] *= factors[0] ** power
            ratio[1 - place] *= factors[1] ** power
            powers[si] = powers.get(si, 0) + (-power if place else power)
    si = re.sub(symbol, lambda found: UNITS[found[1]][0] + found[2], text)
    return Conversion(si, ratio[0], ratio[1], {name: power for name, power in powers.items() if power})


def read_unit(unit: str, where: str = "") -> Conversion:
    """Conversion of a unit to SI. InputError, with its place, for a unit that cannot be read."""
    found = conversion(unit)
    if found is None:
        near = get_close_matches(tidy(unit), [*UNITS, *COMMON], n=3, cutoff=0.5)
        hint = f"; did you mean {' or '.join(f'[{u}]' for u in near)}?" if near else ""
        raise InputError(f"{where + ': ' if where else ''}unknown unit [{unit}]{hint}")
    return found


def to_si[T: (float, np.ndarray)](values: T, unit: str, where: str = "") -> T:
    """Values in SI, same shape; bit-equal to the input when the unit is SI already. InputError for an unknown unit."""
    _, numerator, denominator, _ = read_unit(unit, where)
    return values if numerator == denominator else values * numerator / denominator


def quantity(value: Any, unit: str, where: str, given: str = "") -> float:
    """A quantity in the SI unit wanted: 2500 of the number 2500, and of the text "2.5 N/mm" or "2500".

    `given` is the unit of a bare number; SI if empty. InputError, with what it is, for no number, NaN, and a unit of
    something else.
    """
    number, written = value, given
    if isinstance(value, str):
        digits = r"[-+]?(?:inf|nan|(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)"
        found = re.fullmatch(rf"\s*(?>({digits}))(?!\s*-\s*[.\d])\s*(\D.*)?", value, re.I)  # 1-2 is no 1 of a unit -2
        number, written = (float(found[1]), found[2] or given) if found else (None, "")
    if isinstance(number, bool) or not isinstance(number, int | float | np.floating | np.integer):
        raise InputError(f"{where} is {value!r}, wanted a number, with its unit if that is not {unit}")
    if written and read_unit(written, where).powers != read_unit(unit, where).powers:
        raise InputError(f"{where} is in [{unit}], not in [{written.strip()}]")
    try:
        number = float(number)
    except OverflowError:
        raise InputError(f"{where} is too large a number") from None
    if math.isnan(number):
        raise InputError(f"{where} is not a number (NaN)")
    return to_si(number, written, where) if written else number


def find_kind(column: str) -> str | None:
    """The longest known kind that heads a column name (`tension_ref` for `tension_ref_AF`), or None."""
    heads = accumulate(column.split("_"), "{}_{}".format)
    return next((head for head in reversed(list(heads)) if head in KINDS), None)


def default_unit(column: str) -> str:
    """SI unit of a column by its kind. InputError for a kind that is not in the table."""
    kind = find_kind(column)
    if kind is None:
        listed = ", ".join(KINDS)
        raise InputError(f"column {column!r}: kind unknown, so its unit must be given (known kinds: {listed})")
    return KINDS[kind][0]


def check_unit(column: str, unit: str, where: str = "") -> str:
    """SI unit of a column headed with `unit`. InputError if unknown, or none of the column's kind (a tension in m)."""
    found, kind = read_unit(unit, where), find_kind(column)
    if kind is None:
        return found.si
    for wanted in KINDS[kind]:
        if read_unit(wanted).powers == found.powers:
            return wanted
    listed = " or ".join(f"[{u}]" for u in KINDS[kind])
    raise InputError(f"{where + ': ' if where else ''}unit [{unit}] is none of a {kind}, which is in {listed}")
