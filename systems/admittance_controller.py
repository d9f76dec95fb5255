"""The tension controller: `AdmittanceController(robot)`; its equations are in `exodrake/physics/controller.py`."""

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem

SLOT = 4  # of the frame: after the readings, before the bus


class AdmittanceController(PartSystem):
    """Admittance from tension error to speed of the wire (the paper's Eq. 3), in slot 4 of each frame.

    .. pydrake_system::

        name: AdmittanceController
        input_ports: [deviation, tension_ref, tension_read]
        output_ports: [speed_cmd]

    Per tendon: tension_ref [N] and tension_read [N] come in; speed_cmd [m/s] is state. State: commands [m/s], readings
    before [N], started, integrals [N s], filtered rates [N/s], filtered references [N]. No direct feedthrough.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> controller = exo.AdmittanceController()
        >>> simulator = Simulator(controller)
        >>> _ = controller.GetInputPort("tension_ref").FixValue(simulator.get_mutable_context(), [5.0, 3.0, 1.0])
        >>> _ = controller.GetInputPort("tension_read").FixValue(simulator.get_mutable_context(), [4.0, 3.0, 2.0])
        >>> _ = simulator.AdvanceTo(0.02)
        >>> print(controller.GetOutputPort("speed_cmd").Eval(simulator.get_context()).round(3))
        [ 0.006  0.    -0.006]
    """

    def __init__(self, robot: Robot | None = None) -> None:
        super().__init__(robot, "controller")
        self.tension_ref = self.DeclareVectorInputPort("tension_ref", 3)
        self.tension_read = self.DeclareVectorInputPort("tension_read", 3)
        self.declare_outputs("speed_cmd")
        self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(SLOT), self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The law for all tendons."""
        reference, reading = self.tension_ref.Eval(context), self.tension_read.Eval(context)
        self.equations.control(discrete.get_mutable_value(0), self.p(context), reference, reading)
