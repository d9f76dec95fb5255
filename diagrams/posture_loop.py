"""The posture loop as a Diagram: estimated angles, fed back to the tension references.

loop = PostureLoop(posture_controller(plan, robot).plan, estimator.weights)
diagram = build_diagram(robot, seed=1, systems=[loop])
"""

from pydrake.systems.framework import Diagram, DiagramBuilder

from exodrake.model.machine import Machine
from exodrake.physics.gp_estimator import Weights
from exodrake.systems.gp_estimator import GPEstimator
from exodrake.systems.part import Cloneable
from exodrake.systems.posture_controller import PostureController, PosturePlan


class PostureLoop(Cloneable, Diagram):
    """Joint-angle estimator and posture controller around a tension loop (the paper's Fig. 4).

    .. pydrake_system::

        name: PostureLoop
        input_ports: [tension_read, stroke_read, tension_planned, angle_planned]
        output_ports: [tension_ref, angle_ref, angle_est, angle_std]

    Ports are those of `GPEstimator` and `PostureController`; without a planner at tension_planned [N] and angle_planned
    [rad], the rows of the plan are played.

    Args:
        plan: of the posture controller.
        weights: of the trained estimator.
        machine: whose frame they keep; None: that of the Exo-Index.
    """

    optional = PostureController.optional

    def __init__(self, plan: PosturePlan, weights: Weights, machine: Machine | None = None) -> None:
        super().__init__()
        builder = DiagramBuilder()
        self.estimator = builder.AddSystem(GPEstimator(weights, machine))
        self.controller = builder.AddSystem(PostureController(plan, machine))
        builder.Connect(self.estimator.GetOutputPort("angle_est"), self.controller.GetInputPort("angle_est"))
        for name in ("tension_read", "stroke_read"):
            builder.ExportInput(self.estimator.GetInputPort(name), name)
        for name in self.optional:
            builder.ExportInput(self.controller.GetInputPort(name), name)
        for name in ("tension_ref", "angle_ref"):
            builder.ExportOutput(self.controller.GetOutputPort(name), name)
        for name in ("angle_est", "angle_std"):
            builder.ExportOutput(self.estimator.GetOutputPort(name), name)
        builder.BuildInto(self)
        self.set_name("posture_loop")
