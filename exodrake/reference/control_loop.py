"""The robot's day in frames of ten slots, each task in the middle of its slot (model.md, Timing).

numba's cache of `run` looks at this file only: after a change in field, paths, joints or integrate, remove __pycache__.
"""

import numpy as np
from numba import njit

from exodrake.reference.dynamics import FRAME
from exodrake.reference.integrate import advance, workspace
from exodrake.reference.records import ANGLE, CELL, CELL_DRIFT, RATE, THETA

SLOT = 0.002
FULL_SCALE = 20.0  # N, where the cell's bow returns to zero (effects.md)


@njit(cache=True)
def cell_reading(p, y, wire, drift, noise, before):
    """What the bus delivers [N]: neighbour, scale, bow (skewed half sine), zero, drift, noise, sticking, rounding."""
    load = y[CELL + wire] + p.crosstalk[wire] * y[CELL + (wire + 1) % 3]
    reading = (1.0 + p.cell_gain[wire]) * load + p.cell_offset[wire] + drift + noise
    reading += p.cell_bow[wire] * np.sin(np.pi * (max(load, 0.0) / FULL_SCALE) ** 0.8)
    if p.sticky > 0.0 and abs(reading - before) < p.sticky:
        return before
    if p.quantum_force > 0.0:
        reading = np.round(reading / p.quantum_force) * p.quantum_force
    return reading


@njit(cache=True)
def control(p, wanted, reading, before, first):
    """Admittance law with the damping sign [m/s]."""
    change = 0.0 if first else (reading - before) / FRAME
    command = p.kp * (wanted - reading) - p.kd * change
    return min(p.speed_max, max(-p.speed_max, command))


@njit(cache=True)
def command(p, reference, tension, last, commands, first):
    """Write the commands (3,) [m/s] to all drives from references and tensions (3,) [N]; `last` keeps the tensions."""
    for wire in range(3):
        commands[wire] = control(p, reference[wire], tension[wire], last[wire], first)
        last[wire] = tension[wire]


@njit(cache=True)
def send(p, wire, sent, commands, active, awake):
    """Hand the command of frame `sent` to a drive; before the first frame it is 0."""
    active[wire] = heard(p, wire, commands[sent, wire] if sent >= 0 else 0.0, awake)


@njit(cache=True)
def heard(p, wire, command, awake):
    """Command the drive acts on: small ones are ignored, with hysteresis in waking up and falling asleep."""
    if p.dead_zone[wire] <= 0.0:
        return command
    threshold = p.dead_zone[wire] * (0.8 if awake[wire] else 1.2)
    awake[wire] = abs(command) > threshold
    return command if awake[wire] else 0.0


@njit(cache=True)
def run(p, y, reference, inputs, dropped, noise, tolerance):
    """Simulate n frames.

    Args:
        p: Record of the robot.
        y: State (STATE_SIZE,) [SI], changed in place.
        reference: (n, 3) tension references [N].
        inputs: (n + 2, INPUT_SIZE) time-varying inputs [SI].
        dropped: (n, 3) commands that are lost.
        noise: (n, 3) noise of the cells [N].
        tolerance: (STATE_SIZE,) absolute tolerances [SI].

    Returns:
        Tension (n, 3) [N], gear angle (n, 3) [rad], commands (n, 3) [m/s], and angles and rates (10 n, 6) [rad, rad/s]
        at every mid-slot; NaN from where a state cannot be integrated.
    """
    frames = reference.shape[0]
    tension, theta = np.full((frames, 3), np.nan), np.full((frames, 3), np.nan)
    commands, posture = np.full((frames, 3), np.nan), np.full((10 * frames, 6), np.nan)
    active, awake, last = np.zeros(3), np.zeros(3, np.bool_), np.zeros(3)
    work = workspace(y.size)
    step, time = 1e-4, 0.0
    for frame in range(frames):
        for slot in range(10):
            until = frame * FRAME + slot * SLOT + 0.5 * SLOT
            step = advance(time, until, y, step, p, active, inputs, tolerance, work)
            if step < 0.0:
                return tension, theta, commands, posture
            time = until
            posture[10 * frame + slot, :3] = y[ANGLE : ANGLE + 3]
            posture[10 * frame + slot, 3:] = y[RATE : RATE + 3]
            if 1 <= slot <= 3:
                wire, drift = slot - 1, inputs[frame, CELL_DRIFT + slot - 1]
                theta[frame, wire] = y[THETA + wire]
                tension[frame, wire] = cell_reading(p, y, wire, drift, noise[frame, wire], last[wire])
            elif slot == 4:
                command(p, reference[frame], tension[frame], last, commands[frame], frame == 0)
            elif 5 <= slot <= 7 and not dropped[frame, slot - 5]:
                send(p, slot - 5, frame - int(p.latency), commands, active, awake)
    return tension, theta, commands, posture
