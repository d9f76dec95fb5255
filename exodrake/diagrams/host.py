"""The host of a robot as a system: it gives the exogenous inputs at each frame's start and logs at its end."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiscreteValues
from pydrake.systems.primitives import RandomSource

from exodrake.core.argument import argument
from exodrake.diagrams.binding import note_own, weak_method
from exodrake.diagrams.exogenous import Exogenous
from exodrake.diagrams.leaf_spec import InputSpec
from exodrake.diagrams.signal_log import Logging

HOST, SAMPLE = "host", "output"  # name of the system, and of the port of its base class
LONG = 1e9  # [s] a sampling interval that no run reaches
MANTISSA = 2**53  # a double in 0 .. 1 has as many values: each a seed
ROUNDING = 1e-6  # share of a frame: more than the rounding error of an instant in frames, less than a slot
ROW, SEED = 1, 2  # groups of discrete state, after the random sample


class Host(Logging, RandomSource):
    """Rows of the exogenous signals, each held for a frame, and the log of all signals, a row a frame.

    .. pydrake_system::

        name: Host
        input_ports:
        - a signal to be logged
        - ...
        output_ports:
        - output
        - an exogenous signal
        - ...

    One system does it all, since each system costs every step of the Simulator some 2 % of its time. A row comes when
    its frame starts; the log of the frame before is an event of the same time, and shows that frame's still.

    Numeric parameter 0 is the seed of the noise (negative: none). It takes effect at initialization. As a
    `RandomSource`, the host has a random sample (port `output`), which `SetRandomContext` changes; a sample that is not
    the usual one then gives the seed.

    `quantisation` says whether readings of the Diagram are rounded, `source` what its log is named after.
    """

    memory = ROW
    quantisation = True
    source = ""

    def __init__(self, exogenous: Exogenous, inputs: Mapping[str, InputSpec]) -> None:
        """Takes the exogenous signals, and what each input port of the log carries."""
        super().__init__(RandomDistribution.kUniform, 1, LONG)
        self.usual = usual_samples(self)
        self.set_name(HOST)
        self.exogenous, self.own = exogenous, InputSpec(exogenous.width, exogenous.signals)
        self.DeclareNumericParameter(BasicVector(np.array([exogenous.seed])))
        self.DeclareDiscreteState(exogenous.row(exogenous.seed, 0))
        self.DeclareDiscreteState(np.array([np.nan]))  # the seed in use
        for name, place in exogenous.signals.items():
            shown = partial(weak_method(self._show), name, place)
            self.DeclareVectorOutputPort(name, place.stop - place.start, shown, {self.xd_ticket()})
        frame = exogenous.machine.frame
        self.start_logging(inputs, frame, 0.0)
        self.DeclarePeriodicDiscreteUpdateEvent(frame, 0.0, weak_method(self._next_row))
        self.DeclareInitializationDiscreteUpdateEvent(weak_method(self._initialize))

    def _initialize(self, context: Context, discrete: DiscreteValues) -> None:
        """Sets the seed at time 0, and of a Context that has none yet."""
        seed = context.get_discrete_state(SEED).value()[0]
        if context.get_time() == 0.0 or np.isnan(seed):
            seed, sample = context.get_numeric_parameter(0).value()[0], context.get_discrete_state(0).value()[0]
            if seed >= 0.0 and sample not in self.usual:
                seed = float(int(sample * MANTISSA))
        discrete.set_value(ROW, self.exogenous.row(seed, self._frame(context)))
        discrete.set_value(SEED, np.array([seed]))

    def _next_row(self, context: Context, discrete: DiscreteValues) -> None:
        """Shows the row of the frame that starts."""
        seed = context.get_discrete_state(SEED).value()[0]
        if seed != seed:  # a NaN, as long as there was no initialization
            seed = context.get_numeric_parameter(0).value()[0]
        discrete.set_value(ROW, self.exogenous.row(seed, self._frame(context)))

    def _show(self, name: str, place: slice, context: Context, out: BasicVector) -> None:
        """Fills the output port of a signal."""
        out.set_value(context.get_discrete_state(ROW).value()[place])
        shown = self.rows(context).shown
        if shown.get(name) is not out:
            shown[name] = note_own(out)

    def _frame(self, context: Context) -> int:
        """Number of the frame in which this instant lies."""
        return int(context.get_time() / self.exogenous.machine.frame + ROUNDING)


def host_of(diagram: Diagram) -> Host:
    """The host of a Diagram of `build_diagram`."""
    host = argument("diagram", diagram, Diagram).GetSubsystemByName(HOST)
    assert isinstance(host, Host)
    return host


def usual_samples(source: RandomSource) -> tuple[float, float]:
    """Samples of a source in its default Context: the first one, and the one that it draws at time 0."""
    simulator = Simulator(source)
    state = simulator.get_context().get_discrete_state(0)
    first = float(state.value()[0])
    simulator.AdvanceTo(1.0)
    return first, float(state.value()[0])
