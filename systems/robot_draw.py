"""The draw of a robot: `RobotDraw(robot, source)` behind a RandomSource, which `SetRandomContext` sets."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.primitives import RandomSource

from exodrake.core.robot import Robot, drawn_deviation

AS_BUILT = -1.0
LONG = 1e9  # [s] a sampling interval that no run reaches
MANTISSA = 2**53  # a double in 0 .. 1 has as many values, each a seed


class RobotDraw(LeafSystem):
    """Which robot of its kind a Context holds: the one of the robot file, or one drawn within its tolerances.

    .. pydrake_system::

        name: RobotDraw
        input_ports:
        - sample
        output_ports:
        - drawn_seed
        - NAME.deviation of each part
        - ...

    sample, in 0 .. 1, comes from a `RandomSource` in the Diagram (`random_source`): it alone tells Python that
    `SetRandomContext` or `MonteCarloSimulation` has drawn. drawn_seed is -1 for the default sample; any other
    sample is a seed of the noise and of the robot. A deviation [SI] is what is added to the parameters of a part.
    State: the seed as it was when the Simulator began (a source samples once more at time 0); NaN before.
    """

    def __init__(self, robot: Robot, source: RandomSource) -> None:
        super().__init__()
        self.default_samples = samples(source)
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


def random_source() -> RandomSource:
    """A source of one sample in 0 .. 1, which lasts for a run."""
    return RandomSource(RandomDistribution.kUniform, 1, LONG)


def samples(source: RandomSource) -> tuple[float, float]:
    """Samples of a source in its default Context: the first one, and the one that it draws at time 0."""
    simulator = Simulator(source)
    state = simulator.get_context().get_discrete_state(0)
    first = float(state.value()[0])
    simulator.AdvanceTo(1.0)
    return first, float(state.value()[0])
