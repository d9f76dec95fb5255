"""Effects: physics that the nominal model leaves out, and their parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from exodrake.core.part import State
from exodrake.core.signal import SCALAR


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect: where it is absent, what is plausible, how a fit should move it.

    Attributes:
        name: parameter name as in reports.
        unit: SI unit.
        neutral: value at which the effect is absent, bit for bit (that of the effect's first number decides).
        low, high: plausible range, used to draw and to bound fits.
        over: `WIRES`, `JOINTS` or `ONE`.
        usual: value taken when the effect is spliced without saying.
        free: whether a fit may move it.
        scale: how a fit sees it: "linear", "log" or "reciprocal" (for a stiffness whose neutral value is infinite).
        period: values that differ by it mean the same and are told from `low` on; 0 for none.
    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    axis: str = SCALAR
    default: float | None = None
    fitted: bool = True
    transform: str = "linear"
    period: float = 0.0

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"{self.name}: empty range {self.low} .. {self.high}")

    @property
    def initial(self) -> float:
        """A plausible value to start from [unit of the number]."""
        if self.default is not None:
            return self.default
        if self.transform != "linear" and self.low > 0:
            return (self.low * self.high) ** 0.5
        return 0.5 * (self.low + self.high)

    def wrapped(self, value: float) -> float:
        """The value as reports state it: of those that mean the same, the one within a period from `low`."""
        return self.low + (value - self.low) % self.period if self.period else value


@dataclass(frozen=True)
class Effect:
    """A piece of physics that the nominal model leaves out, and the point where it sits.

    Attributes:
        id: `block.name`, the vocabulary of reports.
        summary: one sentence: what it is.
        signature: one sentence: how it shows in logs.
        source: where equation and range come from.
        at: mapping from point ("part.point") to the page's function that acts there.
        numbers: parameters; the effect is absent where the first has its neutral value.
        states: own states, zero at start, advanced at a point whose value is the dummy `dt` (see `advances`).
        advances: points (of those in `at`) where the function returns the effect's new states instead of a value.
    """

    id: str
    summary: str
    signature: str
    source: str
    at: dict[str, Callable]
    parameters: tuple[EffectParameter, ...]
    states: tuple[State, ...] = ()
    advances: tuple[str, ...] = ()

    @property
    def block(self) -> str:
        """The block that a report names: the id's prefix."""
        return self.id.split(".")[0]

    @property
    def axis(self) -> str:
        """What the effect runs over: `WIRES`, `JOINTS` or `ONE`."""
        return self.parameters[0].axis

    @property
    def slug(self) -> str:
        """The id as an identifier."""
        return self.id.replace(".", "_")
