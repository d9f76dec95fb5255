"""Effects: physics that the nominal model leaves out, and their parameters."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import cleandoc

from exodrake.model.part import JOINTS, SCALAR, TENDONS, State


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect."""

    name: str  # parameter name as in reports
    unit: str  # SI unit
    null: float  # value at which the effect is absent, bit for bit (that of the effect's first parameter decides)
    low: float  # lower end of the plausible range, used to draw values and to bound fits [unit]
    high: float  # upper end of the plausible range [unit]
    axis: str = SCALAR  # `TENDONS`, `JOINTS` or `SCALAR`
    default: float | None = None  # of an effect added without parameters [unit]; the middle of the range if None
    fitted: bool = True  # whether a fit may change it
    # how a fit sees it; or "log", or "reciprocal" of a stiffness whose null value is infinite
    transform: str = "linear"
    period: float = 0.0  # values that differ by it mean the same and are reported from `low` on [unit]; 0 for none

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"{self.name}: empty range {self.low} .. {self.high}")

    @property
    def initial(self) -> float:
        """Plausible value to start a fit from [unit]."""
        logarithmic = self.transform != "linear" and self.low > 0
        middle = (self.low * self.high) ** 0.5 if logarithmic else 0.5 * (self.low + self.high)
        return middle if self.default is None else self.default

    def resize(self, size: float, unit: str) -> EffectParameter:
        """The same for a machine of another size: all values times `size`, in another unit."""
        null, low, high = (size * value for value in (self.null, self.low, self.high))
        default = None if self.default is None else size * self.default
        return replace(self, unit=unit, null=null, low=low, high=high, default=default)

    def wrap(self, value: float) -> float:
        """Value as reports state it: the equivalent one within a period from `low` [unit]."""
        return self.low + (value - self.low) % self.period if self.period else value


per_tendon = partial(EffectParameter, axis=TENDONS)
per_joint = partial(EffectParameter, axis=JOINTS)

# law_std of an effect that states none; of parameters that shape a law; of all parameters of a law whose form is one of
# many, as one relaxation time for a spectrum of them, or one stiffness for a garment: by development cases of the
# reference simulator, of whose 53 intervals 39 held the truth before two elasticities and the pulley counted as such
LAW_STD, SHAPE_STD, ANY_SHAPE = 0.12, 0.2, 0.3
LAST = 1000  # order of an effect that states none: after the effects of the library


@dataclass(frozen=True)
class Effect:
    """A piece of physics that the nominal model leaves out, and the points where it acts."""

    id: str  # `block.name`, as in reports
    summary: str  # what it is, in one sentence
    signature: str  # how it shows in logs, in one sentence
    source: str  # where equation and range come from
    at: dict[str, Callable]  # mapping from point ("module.point") to the function that acts there
    parameters: tuple[EffectParameter, ...]  # the effect is absent where the first one has its null value
    states: tuple[State, ...] = ()  # own states, zero at start, updated at the points in `advances` or `filters`
    advances: tuple[str, ...] = ()  # points of `at` where the function returns the effect's new states, not a value
    family: str = ""  # kind of law, e.g. "friction", "backlash", "elasticity"
    # whether the parameters mean the same in every law of this effect, such as a gain, an offset or a delay; those of
    # friction or creep belong to the fitted law, and reality follows another. What `shapes` such a law belongs to it
    # all the same
    same_meaning: bool = False
    # relative standard deviation between the amplitude in this law and in another law of the effect, of which no
    # residual tells [-]; further parameters, which shape a law, differ by `SHAPE_STD` at least
    law_std: float = LAW_STD
    not_tried: str = ""  # why a diagnosis does not try the effect by default, in one sentence; empty for a candidate
    detector: str = ""  # module of `diagnosis.detect` that finds the effect before any fit; empty if there is none
    # where several effects act at one point, those of lower order act first; equal ones by id. Those of the library are
    # numbered in the order in which their files define them
    order: int = LAST
    filters: tuple[str, ...] = ()  # points where it returns the value, then the new states: of a sampled signal
    formula: str = ""  # equation in this effect's own letters, where its law serves several
    # argument of a law -> argument of the point that it takes, where that has another name
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def block(self) -> str:
        """Block that a report names: the id's prefix."""
        return self.id.split(".")[0]

    @property
    def axis(self) -> str:
        """Axis of the effect: `TENDONS`, `JOINTS` or `SCALAR`."""
        return self.parameters[0].axis

    @property
    def equation(self) -> str:
        """Equation with a description: the docstring of the first law, `formula` in place of its second part."""
        law = next(iter(self.at.values()))
        said, _, rest = cleandoc(law.__doc__ or "").partition("\n\n")
        if not rest and ": " in said:
            said, _, rest = said.rstrip(".").partition(": ")
            said, rest = f"{said}.", rest.replace("; ", " " * 10)
        if self.formula or rest:
            return f"{said}\n\n{self.formula or rest}"
        return cleandoc(sys.modules[law.__module__].__doc__ or "")
