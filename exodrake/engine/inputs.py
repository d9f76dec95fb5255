"""Exogenous inputs of a run: references, noise and prepared parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple
from zlib import crc32

import numpy as np

from exodrake.core.errors import InputError, short_repr
from exodrake.model.machine import Machine, stack
from exodrake.model.part import NORMAL
from exodrake.model.robot import Robot


@short_repr
@dataclass(frozen=True, eq=False)
class Reference:
    """Reference trajectory of a run.

    Attributes:
        values: (frames, references) array [SI], the columns of `machine.references` side by side: tensions [N] of the
            tendons for the Exo-Index.
        name: name of the protocol.

    Raises:
        InputError: for another shape, or a value that is not finite.

    Examples:
        >>> import numpy as np
        >>> Reference(np.ones((50, 3)), "one newton").values.shape
        (50, 3)
    """

    values: np.ndarray
    name: str = "reference"

    def __post_init__(self) -> None:
        rows = np.ascontiguousarray(self.values, dtype=float)
        if rows.ndim != 2 or not len(rows):
            raise InputError(f"{self.name}: references of shape {rows.shape}, wanted (frames, references)")
        if not np.isfinite(rows).all():
            frame, column = np.argwhere(~np.isfinite(rows))[0]
            raise InputError(f"{self.name}: reference {column} is not finite in frame {frame}")
        object.__setattr__(self, "values", rows)


class NoiseInputs(dict[str, np.ndarray]):
    """Noise inputs of one run: signal -> (frames, channels) array, as its `distribution` says."""

    @staticmethod
    def draw(frames: int, seed: int | None, machine: Machine) -> NoiseInputs:
        """Draws every noise input of a machine; without a seed all normal noise is 0, and every packet arrives.

        Each signal has a stream of its own, by seed and name: a further sensor leaves the noise of the others as it is,
        and a longer run begins like a shorter one.
        """
        found = NoiseInputs()
        for signal in (machine.signal[name] for name in machine.inputs if machine.signal[name].distribution):
            shape, normal = (frames, machine.width(signal.axis)), signal.distribution == NORMAL
            if seed is None:
                found[signal.name] = np.zeros(shape) if normal else np.ones(shape)
            else:
                rng = np.random.default_rng([seed, crc32(signal.name.encode())])
                found[signal.name] = rng.standard_normal(shape) if normal else rng.random(shape)
        return found


NOTHING = np.zeros((0, 0))


class RunOptions(NamedTuple):
    """The last arguments of a compiled `run`, in their order: what it records and follows; by default nothing."""

    fine: np.ndarray = NOTHING  # (slots of all frames, signals) that takes the signals at each slot's end [SI]
    follow: np.ndarray = NOTHING  # (frames, channels) the observer's measured input and output, which a run takes [SI]
    feed: np.ndarray = NOTHING  # (frames, feeds) measured outputs of all segments side by side (`feed_places`) [SI]
    rate: np.ndarray = NOTHING  # (frames, feeds) their rates [SI/s]
    fixed: np.ndarray = np.zeros(0, dtype=bool)  # (segments,) which of them give what was measured
    readings: np.ndarray = NOTHING  # (frames, all compared channels) in place of simulated ones, NaN: none [SI]
    targets: np.ndarray = NOTHING  # (frames, channels) measured output of the machine's observer, NaN: none [SI]
    gains: np.ndarray = NOTHING  # (frames, channels) share of the difference by which its state moves at a frame's end


ALONE = RunOptions()


def reference_width(machine: Machine) -> int:
    """Number of references of a machine."""
    return sum(len(machine.channels(c.signal)) for c in machine.references)


def input_rows(machine: Machine, references: np.ndarray, noise_inputs: NoiseInputs) -> dict[str, np.ndarray]:
    """The exogenous signals (frames, channels) [SI] in the order of `machine.inputs`; references side by side."""
    found, at = {}, 0
    for name in machine.inputs:
        if name in noise_inputs:
            found[name] = noise_inputs[name]
        else:
            width = len(machine.channels(name))
            found[name], at = np.ascontiguousarray(references[:, at : at + width], dtype=float), at + width
    return found


def feed_places(machine: Machine) -> dict[str, slice]:
    """Columns of each segment's output among the feeds."""
    return stack({segment.name: machine.column_width(segment.output) for segment in machine.segments})


def reading_places(machine: Machine) -> dict[str, slice]:
    """Columns of each compared kind among the readings."""
    return stack({kind: machine.column_width(kind) for kind in machine.compared})


def prepare_values(robot: Robot, quantisation: bool = True) -> np.ndarray:
    """Parameter values (parameters,) [SI] of a run, with the resolutions at 0 if unquantised."""
    values = robot.values.copy()
    if np.isnan(values).any():
        missing = robot.machine.parameters[int(np.isnan(values).argmax())].name
        raise InputError(f"{robot.source}: parameter {missing} is missing")
    if not quantisation:
        for name in robot.machine.resolution:
            values[robot.machine.index[name]] = 0.0
    return values
