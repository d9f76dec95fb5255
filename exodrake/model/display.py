"""How quantities are shown to people: label and unit of a log column, colour of a channel."""

import math
from typing import NamedTuple

from exodrake.model.machine import Machine
from exodrake.model.units import KINDS, conversion

# SI unit -> unit shown, unless the machine's column names another
SHOWN = {"m": "mm", "m/s": "mm/s", "rad": "deg", "rad/s": "deg/s", "N/m": "N/mm", "N m": "mN m", "A": "mA"}
SYMBOLS = {"deg": "°", "deg/s": "°/s", "-": ""}
NEARLY = 0.985  # a fraction above it is given to a tenth of a per cent, so that 0.996 is not printed as 100 %
PALETTE = ("#0072b2", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#e69f00")  # Okabe and Ito: distinct to all eyes


class Display(NamedTuple):
    """Display of a kind of signal: label, unit, and factor from SI to that unit."""

    label: str
    unit: str
    factor: float

    @property
    def symbol(self) -> str:
        """The unit as it is written: `°`; empty for none."""
        return SYMBOLS.get(self.unit, self.unit)

    @property
    def axis(self) -> str:
        """Label of a figure's axis: `Joint angle [°]`."""
        return f"{self.label} [{self.symbol}]" if self.symbol else self.label


def shown_unit(si: str, unit: str = "") -> tuple[str, float]:
    """The unit in which a quantity is shown, and its factor from SI: "rad" -> ("deg", 57.3)."""
    name = unit or SHOWN.get(si, si)
    found = conversion(name)
    return (si, 1.0) if name == si or found is None else (name, float(found.denominator / found.numerator))


def with_unit(number: str, unit: str) -> str:
    """A printed number with its unit; no space before a degree sign."""
    symbol = SYMBOLS.get(unit, unit)
    return f"{number}{'' if symbol.startswith('°') else ' '}{symbol}".rstrip()


def in_words(value: float, si: str) -> str:
    """A quantity [SI] in the unit shown: 0.002, "m" -> `2 mm`."""
    unit, factor = shown_unit(si)
    return with_unit(f"{factor * value:.4g}", unit)


def percent(fraction: float) -> str:
    """A fraction as per cent; 0.9953 is `99.5 %`, and only 1 is `100 %`."""
    if not math.isfinite(fraction):
        return "none"
    if NEARLY < fraction < 1.0:
        return f"{math.floor(1000 * fraction) / 10:.1f} %"
    return f"{100 * fraction:.0f} %"


def find_display(kind: str, machine: Machine | None = None, si: str = "") -> Display:
    """Display of a kind of column, such as `angle`: the machine's, else by the kind and the column's unit `si`."""
    column = next((c for c in machine.columns if c.kind == kind), None) if machine else None
    label = kind.replace("_", " ").capitalize()
    if machine is None or column is None:
        return Display(label, *shown_unit(si or KINDS.get(kind, ("-",))[0]))
    return Display(column.label or label, *shown_unit(machine.signal[column.signal].unit, column.unit))


def choose_colour(channel: str, index: int, machine: Machine | None = None) -> str:
    """Colour of a channel: the machine's own, else by its index."""
    return (machine.colours if machine else {}).get(channel) or PALETTE[index % len(PALETTE)]
