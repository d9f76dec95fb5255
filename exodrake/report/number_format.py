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


def closure(fraction: float) -> str:
    """A closure: a fraction as per cent; of an error that grew, by what factor: -2.5 is `grew by a factor of 3.5`."""
    return f"grew by a factor of {factor(1.0 - fraction)}" if rounds_below(fraction) else percent(abs(fraction))


def closure_span(item: Interval) -> str:
    """Ends of an interval of closures: `93 to 98 %`, `grew by a factor of 2.1 to 5.0`, or one of each."""
    if not rounds_below(item.low):
        return f"{closure(item.low).removesuffix(' %')} to {closure(item.high)}"
    if rounds_below(item.high):
        return f"grew by a factor of {factor(1.0 - item.high)} to {factor(1.0 - item.low)}"
    return f"{closure(item.low)} to {percent(abs(item.high))} gone"


def closure_words(item: Interval, error: str, where: str = "") -> str:
    """A closure with its interval in a sentence.

    Args:
        item: the closure.
        error: what is gone or grew: "the excess error".
        where: end of the sentence: "with the improved robot".
    """
    value, span, rest = closure(item.value), closure_span(item), f" {where}" if where else ""
    return (
        f"{error} {value} ({span}){rest}" if rounds_below(item.value) else f"{value} ({span}) of {error} is gone{rest}"
    )


def rounds_below(fraction: float) -> bool:
    """Whether a fraction is negative once it is rounded to per cent."""
    return math.isfinite(fraction) and round(100 * fraction) < 0


def factor(ratio: float) -> str:
    """A ratio with two figures: `1.13`, `47`, `47,000`."""
    return f"{ratio:.2f}" if ratio < 2.0 else f"{ratio:.1f}" if ratio < 10.0 else f"{float(f'{ratio:.2g}'):,.0f}"


def listed(items: tuple[str, ...] | list[str], last: str = "and") -> str:
    """Items in a sentence: `a, b and c`."""
    items = list(items)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""
