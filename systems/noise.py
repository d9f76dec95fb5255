"""Noise of the sensors: `builder.AddSystem(Noise(robot.machine, seed=1))`."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from exodrake.compiled.inputs import NoiseInputs
from exodrake.core.machine import Machine

NO_NOISE = -1.0  # the seed of a run without noise


class Noise(LeafSystem):
    """Noise inputs of a machine, a row each frame, from streams that the seed and the signal's name determine.

    .. pydrake_system::

        name: Noise
        input_ports:
        - drawn_seed
        output_ports:
        - a noise input
        - ...

    Numeric parameter 0 is the seed; a negative one switches the noise off. A `drawn_seed` of 0 or more replaces a seed
    that is not negative: it comes from `RobotDraw`, and unconnected it counts as none. State: number of the frame, as
    in `Playback`. Noise goes on without end, and is that of the compiled simulator for the same seed.

    Args:
        machine: whose noise it is.
        seed: of the streams; None: no noise.

    Example:
        noise = Noise(load_robot().machine, seed=1)
        simulator = Simulator(noise)
        simulator.AdvanceTo(1.0)
        print(noise.GetOutputPort("noise_tension").Eval(simulator.get_context()))
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
        """The next frame has begun."""
        discrete.get_mutable_value(0)[:] = int(context.get_time() / self.machine.frame)

    def show(self, name: str, context: Context, output: BasicVector) -> None:
        """The row of this frame."""
        frame = int(context.get_discrete_state(0).value()[0])
        output.set_value(self.rows(self.seed(context), 1 << max(frame, 255).bit_length())[name][frame])

    def seed(self, context: Context) -> int | None:
        """The seed in effect."""
        seed = context.get_numeric_parameter(0).value()[0]
        drawn = self.drawn_seed.Eval(context)[0] if self.drawn_seed.HasValue(context) else NO_NOISE
        return None if seed < 0.0 else int(drawn if drawn >= 0.0 else seed)
