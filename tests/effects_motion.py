"""What the effects are examined on: an aggressive reference, rows of parameters, and records of all signals."""

import math
from functools import cache

import numpy as np

from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import ALONE, NoiseInputs, prepare_values
from exodrake.machines.robot_file import load_robot
from exodrake.model.machine import signal_count, state_size
from exodrake.model.robot import Robot

FRAMES = 400  # 8 s
SEED = 20


@cache
def nominal() -> Robot:
    """The nominal robot, without effects."""
    return load_robot()


@cache
def motion() -> np.ndarray:
    """Tension references (FRAMES, 3) [N]: slow and fast swings, steps, holds and a slack start of one tendon."""
    t = 0.02 * np.arange(FRAMES)
    swing = 0.5 - 0.5 * np.cos(2 * np.pi * np.outer(t, (0.25, 0.37, 0.31)))
    quick = 0.15 * np.sin(2 * np.pi * np.outer(t, (1.9, 2.3, 1.4)))
    steps = np.where(np.outer(t, np.ones(3)) % 2.0 < 1.0, 1.0, 0.35) * (t > 4.0)[:, None]
    share = np.where((t > 4.0)[:, None], steps, swing + quick * swing)
    return np.clip(np.array((11.0, 7.0, 6.0)) * share, 0.3, 12.0)


def run_rows(rows: np.ndarray, seed: int = SEED) -> np.ndarray:
    """Records (rows, FRAMES, signals) of noise-free runs; the packet_arrival of lost frames is drawn."""
    machine = nominal().machine
    module = compile_machine(machine)
    still, packet_arrival = np.zeros((FRAMES, 3)), NoiseInputs.draw(FRAMES, seed, machine)["packet_arrival"]
    records = np.zeros((len(rows), FRAMES, signal_count(machine)))
    reference = np.ascontiguousarray(motion())
    for i, row in enumerate(rows):
        state, w = np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        module.begin(row, state)
        given = (reference, still, still, packet_arrival, machine.slot, 1, records[i])
        module.run(row, state, w, *given, *ALONE)
    return records


def row_of(robot: Robot) -> np.ndarray:
    """Flat parameters of an unquantised run."""
    return prepare_values(robot, quantisation=False)


def place(name: str) -> slice:
    """Slice of a signal in a record."""
    return nominal().machine.offsets[name]


def wander(rng: np.random.Generator, frames: int, size: float, slow: int) -> np.ndarray:
    """A smooth random motion (frames,): three sines of random phase, the slowest of `slow` frames."""
    n = np.arange(frames)
    return sum(
        size / (k + 1) * (np.sin(2 * np.pi * (k + 1) * n / slow + phase) - math.sin(phase))
        for k, phase in enumerate(rng.uniform(0, 2 * np.pi, 3))
    )  # fmt: skip


def motion_of(name: str, seed: int = 1) -> np.ndarray:
    """References of a machine (frames, references) [SI], starting where it stands."""
    if name == "exo_index":
        return motion()
    rng = np.random.default_rng(seed)
    if name == "emps":
        place = wander(rng, 3000, 0.04, 1500)
        return np.column_stack([place, np.zeros_like(place), np.zeros_like(place)])
    if name == "tendon_sheath":
        angle = wander(rng, 500, 0.7, 220)
        return np.column_stack([angle, 0.0 * angle, np.full(len(angle), np.radians(60.0 * (seed % 4)))])
    joints, frames, slow = (6, 800, 90) if name == "so101" else (3, 270, 40)
    angles = np.column_stack([wander(rng, frames, 0.25, slow + 7 * j) for j in range(joints)])
    return np.column_stack([angles, np.zeros_like(angles)])
