"""The log of a Diagram as a system: all its input ports side by side, a row each period."""

from __future__ import annotations

from typing import Any
from weakref import ref

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, ValueProducer


class SignalLog(LeafSystem):
    """Rows of several signals, the first at time 0.

    .. pydrake_system::

        name: SignalLog
        input_ports:
        - a signal
        - ...

    The rows live in the Context, as those of `VectorLogSink` do, which takes one vector only.
    """

    def __init__(self, widths: dict[str, int], period: float) -> None:
        """Takes the width of each input port by name, and the period [s]."""
        super().__init__()
        for name, width in widths.items():
            self.DeclareVectorInputPort(name, width)
        producer = ValueProducer(allocate=lambda: AbstractValue.Make([]), calc=lambda context, value: None)
        entry = self.DeclareCacheEntry("rows", producer, {self.nothing_ticket()})
        self._rows = entry.cache_index()
        here, count = ref(self), len(widths)

        def append(context: Context) -> None:
            log = here()
            assert log is not None
            log.rows(context).append(np.concatenate([log.EvalVectorInput(context, i).value() for i in range(count)]))

        self.DeclarePeriodicPublishEvent(period, 0.0, append)

    def rows(self, context: Context) -> list[np.ndarray]:
        """The rows in the log's own Context so far, each (channels,)."""
        found: Any = self.get_cache_entry(self._rows).Eval(context)
        return found
