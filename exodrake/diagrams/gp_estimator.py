"""The joint-angle estimator as a Drake system; its arithmetic is `systems.gp_estimator`.

    diagram = build_diagram(robot, reference, systems=[GPEstimator(estimator.weights, robot.machine)])

The compiled simulator leaves it out, and a log gets its columns afterwards (`predict_rows` over the frames, as
`exodrake estimate` does), to the last bit what this leaf shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.compiled.memory import vector
from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.diagrams.binding import declare_per_context, weak_method
from exodrake.diagrams.parameter import NamedParameter
from exodrake.systems.gp_estimator import Weights, predict_into, scratch

SLOT = 8


class Bound:
    """The weights of one Context, as arrays over its parameters, which stay where they are; and working memory."""

    def __init__(self) -> None:
        self.context: Context | None = None
        self.weights: Weights | None = None
        self.work = np.zeros(0)

    def __deepcopy__(self, memo: dict) -> Bound:
        return Bound()


class GPEstimator(LeafSystem):
    """Joint angles and their standard deviations from tension and stroke as read, once a frame in slot 8.

    .. pydrake_system::

        name: GPEstimator
        input_ports:
        - tension_read
        - stroke_read
        output_ports:
        - angle_est
        - angle_std

    Tension [N] and stroke [m] per tendon; both outputs [rad] per joint, state, and NaN before the first estimate. The
    weights of the trained estimator are numeric parameters, one for each field of `Weights`.
    """

    def __init__(self, weights: Weights, machine: Machine) -> None:
        super().__init__()
        self.set_name("estimator")
        tendons, joints = len(weights.center) // 2, len(weights.offset)
        self.shapes = {name: getattr(weights, name).shape for name in Weights._fields}
        for name in Weights._fields:
            self.DeclareNumericParameter(BasicVector(getattr(weights, name).ravel()))
        for name in ("tension_read", "stroke_read"):
            self.DeclareVectorInputPort(name, tendons)
        for name in ("angle_est", "angle_std"):
            state = self.DeclareDiscreteState(np.full(joints, np.nan))
            self.DeclareStateOutputPort(name, DiscreteStateIndex(int(state)))
        self._bound = declare_per_context(self, Bound)
        offset = (SLOT + 0.5) * machine.slot
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, offset, weak_method(self._estimate))

    def parameter(self, name: str) -> NamedParameter:
        """All values of a field of `Weights`, flat: `parameter("offset")`. InputError for another name."""
        if name not in self.shapes:
            raise InputError(f"the estimator has no parameter {name!r}{nearest(name, list(self.shapes))}")
        return NamedParameter(self, name, tuple(range(int(np.prod(self.shapes[name])))), [*self.shapes].index(name))

    def _estimate(self, context: Context, discrete: DiscreteValues) -> None:
        """The event."""
        bound: Any = self.get_cache_entry(self._bound).Eval(context)
        if bound.context is not context:
            bound.context = context
            views = (context.get_numeric_parameter(i).value() for i in range(len(self.shapes)))
            arrays = (vector(view.ctypes.data, view.size) for view in views)
            bound.weights = Weights(*(a.reshape(s) for a, s in zip(arrays, self.shapes.values(), strict=True)))
            bound.work = scratch(bound.weights)
        tension, stroke = (np.array(self.EvalVectorInput(context, i).value()) for i in range(2))
        mean, std = np.empty_like(discrete.value(0)), np.empty_like(discrete.value(1))
        predict_into(tension, stroke, bound.weights, bound.work, mean, std)
        discrete.set_value(0, mean)
        discrete.set_value(1, std)
