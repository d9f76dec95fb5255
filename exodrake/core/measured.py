"""What is measured of a machine: its log columns, an observer that follows them, the conditions that sort them."""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.core.signal import Delay


@dataclass(frozen=True)
class Column:
    """A family of log columns `kind_channel`.

    Attributes:
        kind: what the column names begin with.
        signal: the signal that the columns show, in its unit.
        required: whether a log without it is refused.
        label: name in figures and reports; made from the kind by default.
        unit: unit in figures and reports; by default that of `display.SHOWN`.
        delay: what makes the samples late; None: they are on time.
        rate_of: of an input: kind whose rate of change it is, so that a protocol can state it.
    """

    kind: str
    signal: str
    required: bool = True
    label: str = ""
    unit: str = ""
    delay: Delay | None = None
    rate_of: str = ""


@dataclass(frozen=True)
class Observer:
    """Output injection that keeps a simulation near a log, so that the error of one part does not go round the loop.

    Attributes:
        measured_input: column kind whose signal takes its measured values.
        output: column kind that is held near its measured values.
        state: (part, state) that is corrected once a frame.
        divisor: parameter that converts a difference of the output into one of the state.
        gain: share of the difference that is corrected in a frame.
    """

    measured_input: str
    output: str
    state: tuple[str, str]
    divisor: str
    gain: float
