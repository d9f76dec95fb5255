"""The joint-angle estimator as a Drake system; its arithmetic is `systems.estimator_kernel`.

It only listens: nothing in the loop reads its angles. So the compiled simulator leaves it out, and a log gets its
columns afterwards (`predict_rows` over the frames, as `exodrake estimate` does), to the last bit what this leaf shows.
"""

from __future__ import annotations

import numpy as np

from exodrake.core.machine import Machine
from exodrake.diagrams.leaf import Leaf, LeafSpec, PeriodicUpdate
from exodrake.systems.gp_estimator import Weights, predict_into, scratch

SLOT = 8


class GPEstimator(Leaf):
    """Joint angles and their standard deviations from tension and stroke as read, once a frame in slot 8.

    .. pydrake_system::

        name: GPEstimator
        input_ports:
        - tension_read
        - stroke_read
        output_ports:
        - angle_est
        - angle_std

    Tension [N] and stroke [m] per wire; both outputs [rad] per joint, state, and NaN before the first estimate. The
    weights of the trained estimator belong to the leaf, not to its Context.
    """

    def __init__(self, weights: Weights, machine: Machine) -> None:
        wires, joints = len(weights.center) // 2, len(weights.offset)
        work = scratch(weights)

        def estimate(state, mean, std, parameters, tension, stroke):
            predict_into(tension, stroke, weights, work, mean, std)

        offset = (SLOT + 0.5) * machine.slot
        update = PeriodicUpdate(estimate, (), ("tension_read", "stroke_read"), machine.frame, offset)
        held = {name: np.full(joints, np.nan) for name in ("angle_est", "angle_std")}
        inputs = {"tension_read": wires, "stroke_read": wires}
        super().__init__(LeafSpec("estimator", inputs, np.zeros(0), np.zeros(0), held, (update,)))
