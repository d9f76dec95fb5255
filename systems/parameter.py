"""Parameters of a Context by name: `leaf.parameter("finger.kappa.MCP").set(context, 0.09)`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from exodrake.core.errors import InputError, nearest
from exodrake.core.parameter import channels_of


@dataclass(frozen=True, repr=False)
class NamedParameter:
    """A parameter, or all channels of one, in the Contexts of a leaf.

    Attributes:
        leaf: that holds it.
        name: as in robot files.
        index: place of each channel in a numeric parameter of the leaf.
        group: which numeric parameter that is.
        in_effect: all values of the leaf with their deviations, from its own Context; None: there are no deviations.

    Contexts may be the leaf's own or those of the whole Diagram. The run begins from a changed parameter if it is
    changed before `Simulator.Initialize`.
    """

    leaf: LeafSystem
    name: str
    index: tuple[int, ...]
    group: int = 0
    in_effect: Callable[[Context], np.ndarray] | None = None

    def __repr__(self) -> str:
        return f"NamedParameter({self.name}: {len(self.index)} of {self.leaf.get_name()})"

    def get(self, context: Context) -> np.ndarray:
        """Values (channels,) [SI], the deviation of a robot drawn at random included."""
        own = self._own(context)
        values = self.in_effect(own) if self.in_effect else own.get_numeric_parameter(self.group).value()
        return np.array(values)[list(self.index)]

    def set(self, context: Context, value: float | np.ndarray) -> None:
        """Sets one value for all channels, or an array (channels,) [SI]."""
        own, index = self._own(context), list(self.index)
        values, in_effect = np.array(own.get_numeric_parameter(self.group).value()), self.get(context)
        deviation = np.subtract(in_effect, values[index], out=np.zeros(len(index)), where=in_effect != values[index])
        values[index] = value - deviation
        own.get_mutable_numeric_parameter(self.group).SetFromVector(values)

    def _own(self, context: Context) -> Context:
        """The leaf's own Context."""
        try:
            self.leaf.ValidateContext(context)
        except RuntimeError:
            return self.leaf.GetMyMutableContextFromRoot(context)
        return context


def array_parameter(leaf: LeafSystem, name: str, sizes: Mapping[str, int]) -> NamedParameter:
    """All values of one of a leaf's numeric parameters, whose lengths are `sizes`. InputError for another name."""
    names = list(sizes)
    if name not in names:
        raise InputError(f"{leaf.get_name()} has no parameter {name!r}{nearest(name, names)}")
    return NamedParameter(leaf, name, tuple(range(sizes[name])), names.index(name))


def named_parameter(leaf: Any, name: str, names: tuple[str, ...]) -> NamedParameter:
    """A parameter among the `names` of a leaf. InputError if there is none."""
    index = channels_of(name, names)
    if not index:
        raise InputError(f"{leaf.get_name()} has no parameter {name!r}{nearest(name, list(names))}")
    return NamedParameter(leaf, name, tuple(index), in_effect=leaf.p)
