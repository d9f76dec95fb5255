"""Feed-forward control by iterative learning on a model: commands by which a robot tracks a reference."""

from dataclasses import dataclass, replace

import numpy as np

from exodrake.core.errors import InputError, short_repr
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot
from exodrake.simulation.simulate import simulate

ROUNDS, GAIN = 40, 0.6  # simulations; share of the error that is made up for in each: assumed
TINY = 1e-12  # [SI] keeps a channel that has no error from dividing by 0
LATEST = 25  # frames of delay at most


@short_repr
@dataclass(frozen=True, eq=False)
class Feedforward:
    """Commands to be sent, and what they change on the model."""

    commands: Reference
    before: np.ndarray  # (channels,) RMS tracking error if the wanted motion is sent as it is [SI]
    after: np.ndarray  # (channels,) with the commands [SI]
    kind: str  # of the columns of the motion


def feedforward(robot: Robot, reference: Reference) -> Feedforward:
    """Commands that bring the motion of a robot, best an improved one, as near to a reference as its model allows.

        u_{k+1}(n) = u_k(n) + gain (r(n + d) - y_k(n + d))      r wanted, y simulated, d delay of the channel [frames]

    (Arimoto, Kawamura, Miyazaki 1984.) Commands stay within the robot file's limits, else within what is wanted and as
    much again.

    Raises:
        InputError: for a machine that does not measure what its first reference asks for.
    """
    column = robot.machine.references[0]
    kind = column.kind.removesuffix("_ref")
    channels = robot.machine.channels(column.signal)
    if kind == column.kind or all(c.kind != kind for c in robot.machine.columns):
        name = robot.machine.name
        raise InputError(f"{name} logs nothing that {column.kind} asks for, so nothing can be made up for")
    width = len(channels)
    wanted = reference.values[:, :width]

    def to_reference(commands: np.ndarray) -> Reference:
        return replace(reference, values=np.hstack([commands, reference.values[:, width:]]))

    def simulate_motion(commands: np.ndarray) -> np.ndarray:
        return simulate(robot, to_reference(commands), seed=None, quantisation=False).array(kind, channels)

    span = np.ptp(wanted, axis=0)
    low, high = wanted.min(axis=0) - span, wanted.max(axis=0) + span
    if robot.machine.reference_limits and robot.limits:
        low, high = robot.reference_limits()
    commands = best = wanted
    moved = simulate_motion(commands)
    late = [find_delay(wanted[:, k], moved[:, k]) for k in range(width)]
    least, before = 1.0, rms(wanted - moved)
    for _ in range(ROUNDS):
        error = np.zeros_like(wanted)  # of the frame in which a command acts; 0 beyond the end of the log
        for k, d in enumerate(late):
            error[: len(wanted) - d, k] = wanted[d:, k] - moved[d:, k]
        commands = np.clip(commands + GAIN * error, low, high)
        moved = simulate_motion(commands)
        share = float(np.mean(rms(wanted - moved) / np.maximum(before, TINY)))
        if share < least:  # of all channels together, since they may be coupled
            best, least = commands, share
    return Feedforward(to_reference(best), before, rms(wanted - simulate_motion(best)), kind)


def find_delay(wanted: np.ndarray, moved: np.ndarray) -> int:
    """Delay of a motion (n,) [SI] behind its reference (n,) in frames, by the smallest spread of their difference."""
    n = len(wanted)
    tried = range(1 + max(min(LATEST, n - 2), 0))  # two samples at least, or a spread says nothing
    return int(np.argmin([np.std(moved[d:] - wanted[: n - d]) for d in tried]))


def rms(error: np.ndarray) -> np.ndarray:
    """Root mean square of each channel of an error (n, channels) [SI]."""
    return np.sqrt(np.mean(error**2, axis=0))
