"""For the bench: MuJoCo's finger with the same tendons, under a tension controller in Python every 20 ms."""

from __future__ import annotations

from time import thread_time
from typing import Any

import numpy as np

from exodrake.engine.inputs import Reference
from exodrake.machines.export import robot_as
from exodrake.model.robot import Robot


def mujoco_speed(robot: Robot, reference: Reference, seconds: float, pieces: int = 5) -> tuple[float, np.ndarray]:
    """Simulates the finger; its tendons wind in at the commanded speed, without motor, sensor and bus.

    Simulated seconds per second on one core, the best of some pieces; and the log at frames' ends, (frames, channels)
    of tension [N], stroke [m], command [m/s] by the nominal law, and angle [rad].
    """
    import mujoco  # pyright: ignore[reportMissingImports]  # of the group `bench`

    mj: Any = mujoco
    model = mj.MjModel.from_xml_string(robot_as(robot, "mjcf"))
    data = mj.MjData(model)
    mj.mj_resetDataKeyframe(model, data, 0)
    mj.mj_forward(model, data)
    slack = data.act.copy()
    steps, period = robot.machine.slots, robot.machine.frame
    kp, kd, fastest = robot["controller.kp"], robot["controller.kd"], robot["controller.v_max"]
    frames = round(seconds / period)
    log, before, best = np.zeros((frames, 3 * model.nu + model.nq)), np.zeros(model.nu), np.inf
    for piece in np.array_split(np.arange(frames), pieces):
        start = thread_time()
        for frame in piece:
            tension = data.actuator_force.copy()
            command = kp * (reference.values[frame] - tension) - kd * (tension - before) / period
            command = np.clip(command, -fastest, fastest)
            data.ctrl[:] = command
            before = tension
            mj.mj_step(model, data, steps)
            log[frame] = np.concatenate([tension, data.act - slack, command, data.qpos])
        best = min(best, (thread_time() - start) / len(piece))
    return period / best, log
