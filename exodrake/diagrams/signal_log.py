"""The log of a Diagram as a system: all its input ports side by side, a row each period."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, Diagram, LeafSystem

from exodrake.core.argument import argument
from exodrake.core.machine import Machine
from exodrake.diagrams.binding import declare_inputs, declare_per_context, weak_method
from exodrake.diagrams.leaf_spec import InputSpec

LOG, FINE_LOG = "host", "fine_log"  # the systems that hold the logs of frames and of slots
NOTHING = InputSpec(0, {})


class Rows:
    """The rows of one Context, each its time [s] and then the values; a copy of the Context goes on from a copy."""

    def __init__(self, rows: list[np.ndarray] | None = None) -> None:
        self.rows: list[np.ndarray] = rows or []
        self.context: Context | None = None
        self.views: list[np.ndarray] = []
        self.shown: dict[str, BasicVector] = {}  # vectors of the system's own output ports

    def __deepcopy__(self, memo: dict) -> Rows:
        return Rows(self.rows.copy())


class Logging:
    """Mixin for systems that log their input ports; `inputs` and `own` describe what ports and state carry."""

    inputs: Mapping[str, InputSpec]
    own: InputSpec = NOTHING
    memory = 0  # the group of discrete state that `own` describes
    get_input_port: Any
    EvalVectorInput: Any
    get_cache_entry: Any

    def start_logging(self, inputs: Mapping[str, InputSpec], period: float, offset: float) -> None:
        """Declares ports and event; period and offset [s]."""
        system: Any = self
        self.inputs = inputs
        declare_inputs(system, inputs)
        self._rows = declare_per_context(system, Rows)
        self._evaluated = [i for i, port in enumerate(inputs.values()) if not port.state]
        system.DeclarePeriodicPublishEvent(period, offset, weak_method(self._append))

    def rows(self, context: Context) -> Rows:
        """The rows of the log's own Context so far."""
        found: Any = self.get_cache_entry(self._rows).Eval(context)
        return found

    def table(self, context: Context) -> dict[str, np.ndarray]:
        """Signal -> (rows, channels) [SI] in the log's own Context, after time 0; `time` -> (rows,) [s]."""
        carried = (*self.inputs.values(), self.own)
        size = 1 + sum(port.width for port in carried)
        rows = np.array([row for row in self.rows(context).rows if row[0] > 0.0]).reshape(-1, size)
        found, at = {"time": rows[:, 0]}, 1
        for port in carried:
            found |= {name: rows[:, at + place.start : at + place.stop] for name, place in port.signals.items()}
            at += port.width
        return found

    def _append(self, context: Context) -> None:
        """Adds a row, unless it is there: at initialization, updates come before logs, in a run after them."""
        found, time = self.rows(context), context.get_time()
        while found.rows and found.rows[-1][0] > time:
            found.rows.pop()
        if found.rows and found.rows[-1][0] == time:
            return
        if found.context is not context:
            found.context = context
            found.views = [np.zeros(1), *(self._memory(context, i) for i in range(len(self.inputs)))]
            found.views += [context.get_discrete_state(self.memory).value()] if self.own.width else []
        for i in self._evaluated:
            found.views[1 + i] = self.EvalVectorInput(context, i).value()
        found.views[0][0] = time
        found.rows.append(np.concatenate(found.views))

    def _memory(self, context: Context, i: int) -> np.ndarray:
        """The array behind input port i."""
        if i in self._evaluated:
            return self.EvalVectorInput(context, i).value()
        return self.get_input_port(i).Eval(context).array


class SignalLog(Logging, LeafSystem):
    """Rows of several signals, a row each period.

    .. pydrake_system::

        name: SignalLog
        input_ports:
        - a signal
        - ...

    The rows live in the Context, as those of `VectorLogSink` do, which takes one vector only. A Context that is set
    back in time loses the rows from there on.
    """

    def __init__(self, inputs: Mapping[str, InputSpec], period: float, offset: float) -> None:
        """Takes what each input port carries, period and offset [s]."""
        super().__init__()
        self.start_logging(inputs, period, offset)


def logged_signals(diagram: Diagram, context: Context, log: str = LOG) -> dict[str, np.ndarray]:
    """Signal -> (rows, channels) array [SI] of a log, `time` -> (rows,) [s]; all that the Diagram's systems show.

    Args:
        diagram: from `build_diagram`.
        context: root Context that has run.
        log: `LOG`, one row for each frame that has ended, or `FINE_LOG`, one for each slot.
    """
    system = argument("diagram", diagram, Diagram).GetSubsystemByName(log)
    assert isinstance(system, Logging)
    return system.table(system.GetMyContextFromRoot(argument("context", context, Context)))


def logged(machine: Machine, diagram: Diagram, context: Context, log: str = LOG) -> np.ndarray:
    """All signals (rows, channels) [SI] of the machine side by side; arguments as in `logged_signals`.

    Exogenous signals are missing where they are input ports of the Diagram.
    """
    found = logged_signals(diagram, context, log)
    return np.hstack([found[signal.name] for signal in machine.signals if signal.name in found])
