"""What a machine declares for replay, localisation and monitoring: segments, regime and command link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Imposed:
    """A signal that carries the measured output of a fixed segment.

    Attributes:
        signal: name of the signal.
        rate: whether it carries the rate of change of the output instead of its value.
        gain: factor on value or rate.
        low: lower bound of the value before the gain.
        part: the only part whose plant update reads the signal so; empty: every part.
    """

    signal: str
    rate: bool = False
    gain: float = 1.0
    low: float | None = None
    part: str = ""


@dataclass(frozen=True)
class Segment:
    """What lies between measured signals. A segment is fixed by imposing its measured output on the other segments.

    Attributes:
        name: name in reports.
        output: column kind in which the segment ends.
        inputs: column kinds from which the output follows.
        imposed: signals that carry the measured output while the segment is fixed; the column's signal if empty.
        parameters: values [SI] that parameters (names without channel) take while the segment is fixed.
        hold: part and function `f(x, z, n, e, output)` that moves its state to the measured output after each tick.
        sampled: time of the reading after the start of its frame [s]; the output runs straight through it at its rate.
            None: the output is held over the frame.
        exact: whether the segment is software of known law: never a suspect, and fed with unsmoothed readings.
        contents: parts that it holds, for reports.
    """

    name: str
    output: str
    inputs: tuple[str, ...] = ()
    imposed: tuple[Imposed, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    hold: tuple[str, str] | None = None
    sampled: float | None = None
    exact: bool = False
    contents: str = ""


@dataclass(frozen=True)
class Regime:
    """Measured signals by which the frames of a gap are sorted: motion, load and slackness of a channel.

    Attributes:
        position: column kind whose rate of change is the motion.
        load: column kind of the load.
        joint: column kind of the joint position, or "".
        still: speed below which a channel counts as at rest [unit of the position / s].
        slack: load below which a channel counts as slack [unit of the load].
    """

    position: str
    load: str
    joint: str
    still: float
    slack: float


@dataclass(frozen=True)
class CommandLink:
    """A link on which speed commands may be lost, and the drive whose output shows a loss.

    Attributes:
        command, output: column kinds of the command and of the position that the drive moves.
        received: signal that the drive reads: the last command that arrived.
        part: the drive; its other inputs are measured, as the segments impose them.
        moved: signal of the position.
    """

    command: str
    output: str
    received: str
    part: str
    moved: str
