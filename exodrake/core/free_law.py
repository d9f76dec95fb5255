"""Free laws that may be missing at a point of a part: a curve, or a memory, whose shape is fitted to logs.

A free law adds `factor f(variable)` to the value that passes the point, with a free curve f, or a sum of elements that
remember how the variable moved. Texts are source code in the arguments of the point. A part declares the laws of its
points (`Point.laws`); a point without a declaration gets a curve over each of its arguments.
"""

from __future__ import annotations

from dataclasses import dataclass

CURVE, PLACE, HYSTERESIS, RELAXATION = "curve", "place", "hysteresis", "relaxation"


@dataclass(frozen=True)
class FreeLaw:
    """One free law at a point.

    Attributes:
        words: what the curve gives, over what: "friction over speed".
        variable: u, as source of the point's arguments; of a law with memory, of those of the point `advances`.
        unit: of u.
        factor: what multiplies f(u), as source; "" for 1.
        kind: curve of u, of the place that the moves of u add up to, or memory: hysteresis or relaxation.
        advances: name of the point at which the states of a law with memory advance.
        moves: whether the variable of a law with memory is already a change within the tick.
        fine: whether knots lie close together near 0, where the law may jump.
        result: how the law acts on the value, with `law` for the sum of factor and curve; "" for value + law.
        rate: point that takes the rate of this value, and its result there, with `slope` for f'(u).
    """

    words: str
    variable: str
    unit: str
    factor: str = ""
    kind: str = CURVE
    advances: str = ""
    moves: bool = False
    fine: bool = False
    result: str = ""
    rate: tuple[str, str, str] = ("", "", "")

    @property
    def is_curve(self) -> bool:
        """Whether the law is a curve, of a variable or of a place."""
        return self.kind in (CURVE, PLACE)


def free_curve(words: str, variable: str, unit: str, factor: str = "", fine: bool = False, result: str = "") -> FreeLaw:
    """A free curve of a variable."""
    return FreeLaw(words, variable, unit, factor, fine=fine, result=result)


def free_memory(
    words: str, variable: str, unit: str, advances: str, factor: str = "", moves: bool = False
) -> tuple[FreeLaw, FreeLaw]:
    """Hysteresis and relaxation of a variable."""
    hysteresis = FreeLaw(f"hysteresis {words}", variable, unit, factor, HYSTERESIS, advances, moves)
    return hysteresis, FreeLaw(f"relaxation {words}", variable, unit, factor, RELAXATION, advances, moves)
