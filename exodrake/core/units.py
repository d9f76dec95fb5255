"""Units at the door: one table from every unit a file may carry to SI, and the kinds of signal a log may hold.

A column is headed `kind_name [unit]`, for instance `tension_AF [N]`. Names of tendons and joints are free; a known kind
fixes the SI unit its column must have, an unknown kind may carry any known unit.
"""

from collections.abc import Mapping
from difflib import get_close_matches

import numpy as np

from exodrake.core.errors import InputError

# unit: (SI unit, numerator, denominator); SI value = value * numerator / denominator, so decimal prefixes round
# correctly
UNITS: Mapping[str, tuple[str, float, float]] = {
    "-": ("-", 1, 1), "1": ("-", 1, 1), "%": ("-", 1, 100), "frames": ("-", 1, 1), "count": ("-", 1, 1),
    "s": ("s", 1, 1), "ms": ("s", 1, 1000), "us": ("s", 1, 1_000_000), "ns": ("s", 1, 1_000_000_000),
    "min": ("s", 60, 1),
    "m": ("m", 1, 1), "cm": ("m", 1, 100), "mm": ("m", 1, 1000), "um": ("m", 1, 1_000_000),
    "rad": ("rad", 1, 1), "mrad": ("rad", 1, 1000), "deg": ("rad", np.pi, 180), "rev": ("rad", 2 * np.pi, 1),
    "m/s": ("m/s", 1, 1), "cm/s": ("m/s", 1, 100), "mm/s": ("m/s", 1, 1000),
    "rad/s": ("rad/s", 1, 1), "mrad/s": ("rad/s", 1, 1000), "deg/s": ("rad/s", np.pi, 180), "rpm": ("rad/s", np.pi, 30),
    "m/s2": ("m/s2", 1, 1), "mm/s2": ("m/s2", 1, 1000), "rad/s2": ("rad/s2", 1, 1), "deg/s2": ("rad/s2", np.pi, 180),
    "N": ("N", 1, 1), "mN": ("N", 1, 1000), "kN": ("N", 1000, 1), "gf": ("N", 9.80665, 1000), "kgf": ("N", 9.80665, 1),
    "N/s": ("N/s", 1, 1), "N/m": ("N/m", 1, 1), "N/mm": ("N/m", 1000, 1), "N s/m": ("N s/m", 1, 1),
    "N m": ("N m", 1, 1), "mN m": ("N m", 1, 1000), "N cm": ("N m", 1, 100), "N mm": ("N m", 1, 1000),
    "N m/rad": ("N m/rad", 1, 1), "N m s/rad": ("N m s/rad", 1, 1),
    "A": ("A", 1, 1), "mA": ("A", 1, 1000), "V": ("V", 1, 1), "mV": ("V", 1, 1000),
    "W": ("W", 1, 1), "mW": ("W", 1, 1000),
    "kg": ("kg", 1, 1), "g": ("kg", 1, 1000), "Hz": ("Hz", 1, 1), "kHz": ("Hz", 1000, 1), "K": ("K", 1, 1),
    "Pa": ("Pa", 1, 1),
    "kPa": ("Pa", 1000, 1), "1/s": ("1/s", 1, 1), "1/m": ("1/m", 1, 1),
}  # fmt: skip

SPELLINGS = {
    "nm": "N m", "Nm": "N m", "mNm": "mN m", "Ncm": "N cm", "Nmm": "N mm", "Nm/rad": "N m/rad", "Nms/rad": "N m s/rad",
    "Ns/m": "N s/m", "sec": "s", "usec": "us", "msec": "ms", "°": "deg", "°/s": "deg/s",
    "degrees": "deg", "radians": "rad",
    "rev/min": "rpm", "": "-",
}  # fmt: skip

# kind: SI units it may have; the first is the one a simulated log gets
KINDS: Mapping[str, tuple[str, ...]] = {
    "time": ("s",),
    "tension": ("N",), "tension_ref": ("N",), "tension_true": ("N",), "tension_finger": ("N",),
    "stroke": ("m",), "stroke_ref": ("m",), "speed": ("m/s", "rad/s"), "speed_cmd": ("m/s", "rad/s"),
    "angle": ("rad",), "angle_ref": ("rad",), "angle_est": ("rad",), "angle_std": ("rad",),
    "angle_start": ("rad",), "bend": ("rad",),
    "angle_speed": ("rad/s",),
    "position": ("rad", "m"), "position_ref": ("rad", "m"), "position_start": ("rad", "m"),
    "speed_start": ("rad/s", "m/s"),
    "velocity": ("rad/s", "m/s"), "velocity_ref": ("rad/s", "m/s"),
    "current": ("A",), "current_ref": ("A",), "voltage": ("V",), "voltage_ref": ("V",),
    "torque": ("N m",), "torque_ref": ("N m",), "force": ("N",), "force_ref": ("N",),
    "effort": ("N m", "N", "A"), "effort_ref": ("N m", "N", "A"), "temperature": ("K",),
}  # fmt: skip


def tidy(unit: str) -> str:
    """The table's spelling of a unit: `N*m`, `N.m`, `µm`, `m/s^2` and the like become `N m`, `um`, `m/s2`."""
    text = unit.strip().replace("µ", "u").replace("μ", "u").replace("^", "").replace("²", "2")
    text = " ".join(text.replace("·", " ").replace("*", " ").replace(".", " ").split())
    return SPELLINGS.get(text, text)


def si_unit(unit: str, where: str = "") -> str:
    """The SI unit a unit converts to. InputError, saying where, for a unit the table lacks."""
    known = UNITS.get(tidy(unit))
    if known is None:
        near = get_close_matches(tidy(unit), UNITS, n=3, cutoff=0.5)
        hint = f"; did you mean {' or '.join(f'[{u}]' for u in near)}?" if near else ""
        raise InputError(f"{where + ': ' if where else ''}unknown unit [{unit}]{hint}")
    return known[0]


def to_si(values: np.ndarray, unit: str, where: str = "") -> np.ndarray:
    """Values in SI, same shape; bit-equal to the input when the unit is SI already. InputError for an unknown unit."""
    si_unit(unit, where)
    _, numerator, denominator = UNITS[tidy(unit)]
    if numerator == denominator:
        return values
    return values * numerator / denominator


def kind_of(column: str) -> str | None:
    """The longest known kind that heads a column name (`tension_ref` for `tension_ref_AF`), or None."""
    parts = column.split("_")
    for length in range(len(parts), 0, -1):
        kind = "_".join(parts[:length])
        if kind in KINDS:
            return kind
    return None


def default_unit(column: str) -> str:
    """SI unit of a column by its kind. InputError for a kind that is not in the table."""
    kind = kind_of(column)
    if kind is None:
        raise InputError(
            f"column {column!r}: kind unknown, so its unit must be given (known kinds: {', '.join(KINDS)})"
        )
    return KINDS[kind][0]


def check_unit(column: str, unit: str, where: str = "") -> str:
    """SI unit of a column headed with `unit`. InputError if unknown, or none of the column's kind (a tension in m)."""
    found = si_unit(unit, where)
    kind = kind_of(column)
    if kind is not None and found not in KINDS[kind]:
        wanted = " or ".join(f"[{u}]" for u in KINDS[kind])
        raise InputError(f"{where + ': ' if where else ''}unit [{unit}] is none of a {kind}, which is in {wanted}")
    return found
