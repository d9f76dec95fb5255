"""The joint-angle estimator as a Drake system; its arithmetic is `systems.gp_estimator`.

No other part reads its angles, so the compiled simulator leaves it out, and a log gets its columns afterwards
(`predict_rows` over the frames, as `exodrake estimate` does), to the last bit what this leaf shows.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import ref

import numpy as np
from pydrake.systems.framework import Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.core.machine import Machine
from exodrake.systems.gp_estimator import Weights, predict_into, scratch

SLOT = 8


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
    weights of the trained estimator belong to the leaf, not to its Context.
    """

    def __init__(self, weights: Weights, machine: Machine) -> None:
        super().__init__()
        self.set_name("estimator")
        tendons, joints = len(weights.center) // 2, len(weights.offset)
        for name in ("tension_read", "stroke_read"):
            self.DeclareVectorInputPort(name, tendons)
        for name in ("angle_est", "angle_std"):
            state = self.DeclareDiscreteState(np.full(joints, np.nan))
            self.DeclareStateOutputPort(name, DiscreteStateIndex(int(state)))
        offset = (SLOT + 0.5) * machine.slot
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, offset, self._estimate(weights))

    def _estimate(self, weights: Weights) -> Callable[[Context, DiscreteValues], None]:
        """The handler of the event; it knows the leaf weakly (see `Leaf`)."""
        here, work = ref(self), scratch(weights)

        def estimate(context: Context, discrete: DiscreteValues) -> None:
            read = here().EvalVectorInput  # pyright: ignore[reportOptionalMemberAccess]
            tension, stroke = read(context, 0).value(), read(context, 1).value()
            mean, std = discrete.get_mutable_value(0), discrete.get_mutable_value(1)
            predict_into(tension, stroke, weights, work, mean, std)

        return estimate
