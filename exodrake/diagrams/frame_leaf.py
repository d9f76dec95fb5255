"""A Drake system of one's own that runs once a frame: named groups of parameters, vector inputs, state outputs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.diagrams.binding import weak_method
from exodrake.diagrams.parameter import NamedParameter


class FrameLeaf(LeafSystem):
    """A system with an event in the middle of one slot of each frame, which a subclass gives as `update`.

    Args:
        name: of the system.
        machine: whose frame it keeps.
        slot: in which it runs.
        parameters: arrays by name, a numeric parameter each [any unit].
        inputs: width of each input port by name.
        outputs: first value (channels,) of each output port by name, a discrete state each.
    """

    def __init__(
        self,
        name: str,
        machine: Machine,
        slot: int,
        parameters: Mapping[str, np.ndarray],
        inputs: Mapping[str, int],
        outputs: Mapping[str, np.ndarray],
    ) -> None:
        super().__init__()
        self.set_name(name)
        self.shapes = {key: np.shape(values) for key, values in parameters.items()}
        for values in parameters.values():
            self.DeclareNumericParameter(BasicVector(np.ravel(values).astype(float)))
        for port, width in inputs.items():
            self.DeclareVectorInputPort(port, width)
        for port, values in outputs.items():
            self.DeclareStateOutputPort(port, DiscreteStateIndex(int(self.DeclareDiscreteState(values))))
        offset = (slot + 0.5) * machine.slot
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, offset, weak_method(self.update))

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The event."""
        raise NotImplementedError

    def parameter(self, name: str) -> NamedParameter:
        """All values of a parameter, flat. InputError for another name."""
        names = list(self.shapes)
        if name not in names:
            raise InputError(f"{self.get_name()} has no parameter {name!r}{nearest(name, names)}")
        return NamedParameter(self, name, tuple(range(int(np.prod(self.shapes[name])))), names.index(name))
