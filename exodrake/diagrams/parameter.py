"""Parameters of a Context by name: `leaf.parameter("finger.kappa.MCP").set(context, 0.09)`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, Diagram, LeafSystem

from exodrake.core.argument import argument
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

    Contexts may be the leaf's own or those of the whole Diagram. The run begins from a changed parameter if it is
    changed before `Simulator.Initialize`.
    """

    leaf: LeafSystem
    name: str
    index: tuple[int, ...]
    group: int = 0

    def __repr__(self) -> str:
        return f"NamedParameter({self.name}: {len(self.index)} of {self.leaf.get_name()})"

    def get(self, context: Context) -> np.ndarray:
        """Values (channels,) [SI]."""
        return np.array(self._own(context).get_numeric_parameter(self.group).value())[list(self.index)]

    def set(self, context: Context, value: float | np.ndarray) -> None:
        """Sets one value for all channels, or an array (channels,) [SI]."""
        vector = self._own(context).get_mutable_numeric_parameter(self.group)
        values = np.array(vector.value())
        values[list(self.index)] = value
        vector.SetFromVector(values)

    def _own(self, context: Context) -> Context:
        """The leaf's own Context."""
        try:
            self.leaf.ValidateContext(context)
        except RuntimeError:
            return self.leaf.GetMyMutableContextFromRoot(context)
        return context


def named_parameter(leaf: LeafSystem, name: str, names: tuple[str, ...]) -> NamedParameter:
    """A parameter among the `names` of a leaf. InputError if there is none."""
    index = channels_of(name, names)
    if not index:
        raise InputError(f"{leaf.get_name()} has no parameter {name!r}{nearest(name, list(names))}")
    return NamedParameter(leaf, name, tuple(index))


def find_parameter(diagram: Diagram, name: str) -> NamedParameter:
    """A parameter of a Diagram's parts by its full name, whichever leaf holds it. InputError if none does."""
    known: list[str] = []
    systems = argument("diagram", diagram, Diagram).GetSystems()
    for leaf in (system for system in systems if isinstance(system, LeafSystem)):
        names = getattr(getattr(leaf, "spec", None), "parameter_names", ())
        if channels_of(name, names):
            return named_parameter(leaf, name, names)
        known += names
    raise InputError(f"{diagram.get_name()} has no parameter {name!r}{nearest(name, known)}")
