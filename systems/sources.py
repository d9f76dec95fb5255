"""Sources of what comes from outside a robot: given signals, noise, a robot drawn at random, a sync pulse."""

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.primitives import RandomSource

from exodrake.engine.inputs import NoiseInputs
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot, drawn_deviation
from exodrake.systems.part import Cloneable

NO_NOISE = -1.0  # the seed of a run without noise
AS_BUILT = -1.0  # the seed of the robot of the robot file
LONG = 1e9  # [s] a sampling interval that no run reaches
MANTISSA = 2**53  # a double in 0 .. 1 has as many values, each a seed
ROUNDING = 1e-9  # frames: an instant this close to the start of a frame belongs to it


class Playback(Cloneable, LeafSystem):
    """Rows of given signals, each held for a frame; the last one stays.

    .. pydrake_system::

        name: Playback
        output_ports: [a signal, ...]

    State: the number of the frame, taken from the time an eighth of a slot (0.25 ms) after its start, so that
    a log at its end still shows the frame's row.

    Args:
        rows: signal -> (frames, channels) array [SI].
        frame: length of a frame [s].
        delay: when the row changes [s] after the frame's start.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> import numpy as np
        >>> player = exo.Playback({"tension_ref": np.array([[5.0, 3.0, 1.0], [6.0, 3.0, 1.0]])}, frame=0.02)
        >>> simulator = Simulator(player)
        >>> _ = simulator.AdvanceTo(0.03)
        >>> print(player.GetOutputPort("tension_ref").Eval(simulator.get_context()).round(3))
        [6. 3. 1.]
    """

    def __init__(self, rows: Mapping[str, np.ndarray], frame: float, delay: float = 2.5e-4) -> None:
        super().__init__()
        self.rows, self.frame = {name: np.array(values, dtype=float) for name, values in rows.items()}, frame
        self.DeclareDiscreteState(1)
        for name, values in self.rows.items():
            self.DeclareVectorOutputPort(name, values.shape[1], partial(self.show, name), {self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(frame, delay, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The next frame begins."""
        discrete.get_mutable_value(0)[:] = int(context.get_time() / self.frame)

    def show(self, name: str, context: Context, output: BasicVector) -> None:
        """The row of this frame."""
        frame = int(context.get_discrete_state(0).value()[0])
        output.set_value(self.rows[name][min(frame, len(self.rows[name]) - 1)])


class Noise(Cloneable, LeafSystem):
    """Noise inputs of a machine, a row each frame, from streams that the seed and the signal's name determine.

    .. pydrake_system::

        name: Noise
        input_ports: [drawn_seed]
        output_ports: [a noise input, ...]

    Numeric parameter 0 is the seed; a negative one switches the noise off. A `drawn_seed` of 0 or more replaces a seed
    that is not negative: it comes from `RobotDraw`, and unconnected it counts as none. State: number of the frame, as
    in `Playback`. Noise goes on without end, and is that of the compiled simulator for the same seed.

    Args:
        machine: whose noise it is.
        seed: of the streams; None: no noise.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> noise = exo.Noise(exo.load_robot().machine, seed=1)
        >>> simulator = Simulator(noise)
        >>> _ = simulator.AdvanceTo(1.0)
        >>> print(noise.GetOutputPort("noise_tension").Eval(simulator.get_context()).round(3))
        [-1.794 -0.94   0.231]
    """

    def __init__(self, machine: Machine, seed: int | None = 0) -> None:
        super().__init__()
        self.machine = machine
        # a longer run begins like a shorter one: rows that were drawn are drawn again with those that follow
        self.rows = lru_cache(4)(lambda seed, frames: NoiseInputs.draw(frames, seed, machine))
        self.DeclareNumericParameter(BasicVector(np.array([NO_NOISE if seed is None else float(seed)])))
        self.drawn_seed: Any = self.DeclareVectorInputPort("drawn_seed", 1)
        self.DeclareDiscreteState(1)
        needs = {self.xd_ticket(), self.all_parameters_ticket(), self.all_input_ports_ticket()}
        for name in (name for name in machine.inputs if machine.signal[name].distribution):
            self.DeclareVectorOutputPort(name, len(machine.channels(name)), partial(self.show, name), needs)
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, 0.125 * machine.slot, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The next frame begins."""
        discrete.get_mutable_value(0)[:] = int(context.get_time() / self.machine.frame)

    def show(self, name: str, context: Context, output: BasicVector) -> None:
        """The row of this frame, by the seed in effect."""
        own = context.get_numeric_parameter(0).value()[0]
        drawn = self.drawn_seed.Eval(context)[0] if self.drawn_seed.HasValue(context) else NO_NOISE
        seed = None if own < 0.0 else int(drawn if drawn >= 0.0 else own)
        frame = int(context.get_discrete_state(0).value()[0])
        output.set_value(self.rows(seed, 1 << max(frame, 255).bit_length())[name][frame])


class RobotDraw(Cloneable, LeafSystem):
    """Which robot of its kind a Context holds: the one of the robot file, or one drawn within its tolerances.

    .. pydrake_system::

        name: RobotDraw
        input_ports: [sample]
        output_ports: [drawn_seed, NAME.deviation of each part, ...]

    sample, in 0 .. 1, comes from `source`, a RandomSource that the Diagram must hold: it alone tells Python that
    `SetRandomContext` or `MonteCarloSimulation` has drawn. drawn_seed is -1 for the default sample; any other
    sample is a seed of the noise and of the robot. A deviation [SI] is what is added to the parameters of a part.
    State: the seed as it was when the Simulator began (a source samples once more at time 0); NaN before.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self.source = RandomSource(RandomDistribution.kUniform, 1, LONG)
        simulator = Simulator(self.source)
        state = simulator.get_context().get_discrete_state(0)
        first = float(state.value()[0])
        simulator.AdvanceTo(1.0)
        self.default_samples = first, float(state.value()[0])  # in a default Context, and as drawn at time 0
        self.deviation = lru_cache(4)(lambda seed: drawn_deviation(robot, np.random.default_rng(seed)))
        self.sample: Any = self.DeclareVectorInputPort("sample", 1)
        self.DeclareDiscreteState(np.array([np.nan]))
        needs = {self.xd_ticket(), self.all_input_ports_ticket()}
        self.DeclareVectorOutputPort("drawn_seed", 1, self.show_seed, needs)
        for part in robot.machine.parts:
            own = [i for i, parameter in enumerate(robot.machine.parameters) if parameter.part == part.name]
            self.DeclareVectorOutputPort(f"{part.name}.deviation", len(own), partial(self.show_deviation, own), needs)
        self.DeclareInitializationDiscreteUpdateEvent(self.begin)
        self.DeclarePeriodicDiscreteUpdateEvent(LONG, 1e-4, self.begin)

    def begin(self, context: Context, discrete: DiscreteValues) -> None:
        """Keeps the seed."""
        discrete.get_mutable_value(0)[:] = self.seed(context)

    def seed(self, context: Context) -> float:
        """The seed that was drawn, or AS_BUILT."""
        kept, sample = context.get_discrete_state(0).value()[0], self.sample.Eval(context)[0]
        if not np.isnan(kept):
            return kept
        return AS_BUILT if sample in self.default_samples else float(int(sample * MANTISSA))

    def show_seed(self, context: Context, output: BasicVector) -> None:
        """The seed that was drawn, or AS_BUILT."""
        output.set_value(np.array([self.seed(context)]))

    def show_deviation(self, own: list[int], context: Context, output: BasicVector) -> None:
        """Deviations of the parameters of one part."""
        seed = self.seed(context)
        output.set_value(np.zeros(len(own)) if seed == AS_BUILT else self.deviation(int(seed))[own])


class SyncPulse(Cloneable, LeafSystem):
    """The sync pulse of the paper's Fig. 5 and 8a: high at the start of every frame.

    The board sends it to the motion capture's analogue input, whose record of it ties both clocks together
    (`kinematics.markers.clock_from_pulses`). Motion capture samples in slot 0 by construction, so nothing in the loop
    reads the pulse: it is left out by default.

    .. pydrake_system::

        name: SyncPulse
        output_ports: [sync]

    The output [-] is 1 during slot 0 and 0 in the other slots.

    Example:
        pulse = builder.AddSystem(SyncPulse(robot.machine))
        logger = LogVectorOutput(pulse.GetOutputPort("sync"), builder, 0.002)
    """

    def __init__(self, machine: Machine) -> None:
        super().__init__()
        self.set_name("sync_pulse")
        self.frame, self.share = machine.frame, machine.slot / machine.frame
        self.DeclareVectorOutputPort("sync", 1, self.show, {self.time_ticket()})

    def show(self, context: Context, level: BasicVector) -> None:
        """The level at this time [-]."""
        place = (context.get_time() / self.frame + ROUNDING) % 1.0
        level.SetAtIndex(0, float(place < self.share))
