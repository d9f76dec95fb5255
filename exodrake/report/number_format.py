"""Numbers as people read them: significant digits, units, percentages, intervals."""

from __future__ import annotations

import math

from exodrake.core.display import SYMBOLS, shown_unit
from exodrake.diagnosis.gap import Interval

DIGITS = 3  # significant digits of a quantity
NEARLY = 0.985  # a fraction above it is given to a tenth of a per cent, so that 0.996 is not printed as 100 %


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


def with_unit(number: str, unit: str) -> str:
    """A printed number with its unit; no space before a degree sign."""
    symbol = SYMBOLS.get(unit, unit)
    return f"{number}{symbol}" if symbol.startswith("°") else f"{number} {symbol}".rstrip()


def quantity(value: float, si: str, unit: str = "") -> str:
    """A quantity [SI] in the unit shown: 0.0123, "m" -> `12.3 mm`."""
    name, factor = shown_unit(si, unit)
    return with_unit(digits(factor * value), name)


def interval(item: Interval) -> tuple[str, str]:
    """A value with its unit, and its 90 % interval, with as many decimals as the interval's width deserves."""
    name, factor = shown_unit(item.unit)
    value, low, high = (factor * x for x in (item.value, item.low, item.high))
    width = high - low
    if not all(math.isfinite(x) for x in (value, low, high)) or width <= 0.0:
        return with_unit(digits(value), name), f"{digits(low)} to {digits(high)}"
    places = max(0, min(8, 1 - math.floor(math.log10(width))))
    return with_unit(f"{value:z.{places}f}", name), f"{low:.{places}f} to {high:.{places}f}"


def percent(fraction: float) -> str:
    """A fraction as per cent; 0.9953 is `99.5 %`, and only 1 is `100 %`."""
    if not math.isfinite(fraction):
        return "none"
    if NEARLY < fraction < 1.0:
        return f"{math.floor(1000 * fraction) / 10:.1f} %"
    return f"{100 * fraction:.0f} %"


def percent_span(item: Interval) -> str:
    """Ends of an interval of fractions: `93 to 98 %`."""
    return f"{percent(item.low).removesuffix(' %')} to {percent(item.high)}"


def listed(items: tuple[str, ...] | list[str], last: str = "and") -> str:
    """Items in a sentence: `a, b and c`."""
    items = list(items)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""
