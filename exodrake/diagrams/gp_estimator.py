"""The joint-angle estimator as a Drake system; its arithmetic is `physics.gp_estimator`.

    diagram = build_diagram(robot, reference, systems=[GPEstimator(estimator.weights, robot.machine)])

The compiled simulator leaves it out, and a log gets its columns afterwards (`predict_rows` over the frames, as
`exodrake estimate` does), to the last bit what this leaf shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from exodrake.compiled.memory import vector
from exodrake.core.machine import Machine
from exodrake.diagrams.binding import declare_per_context
from exodrake.diagrams.frame_leaf import FrameLeaf
from exodrake.physics.gp_estimator import Weights, predict_into, scratch

SLOT = 8


class Bound:
    """The weights of one Context, as arrays over its parameters, which stay where they are; and working memory."""

    def __init__(self) -> None:
        self.context: Context | None = None
        self.weights: Weights | None = None
        self.work = np.zeros(0)

    def __deepcopy__(self, memo: dict) -> Bound:
        return Bound()


class GPEstimator(FrameLeaf):
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
        unknown, tendons = np.full(len(weights.offset), np.nan), len(weights.center) // 2
        inputs, outputs = (
            {"tension_read": tendons, "stroke_read": tendons},
            {"angle_est": unknown, "angle_std": unknown},
        )
        super().__init__("estimator", machine, SLOT, weights._asdict(), inputs, outputs)
        self._bound = declare_per_context(self, Bound)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
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
