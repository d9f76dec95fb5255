"""Controller of an arm's joints, once a frame: PD on position, and gravity of the arm that the controller believes in.

    tau_ref = kp K (q_ref - q) + kd D d(q_ref - q)/dt + feedforward g(q)

K and D are the gains of each joint, kp and kd factors on all of them; the derivative is the difference over a frame.
"""

import sys

from exodrake.model.part import JOINTS, Output, Part, Point, State, Task
from exodrake.physics.arm import WIDTH, WRENCH, body, downwards, effort, gather, move, parameters_with

late_reference = Point("referred", JOINTS, "value, clock",
                       "reference of joint j [rad] as it arrives; clock: 0 at first")  # fmt: skip
position_gain = Point("stiffened", JOINTS, "gain", "gain of the drive on the position error of joint j [N m/rad]")
velocity_gain = Point("damped", JOINTS, "gain", "gain of the drive on the rate of that error [N m s/rad]")
gravity_share = Point("compensated", JOINTS, "share", "share of the believed gravity that the drive gives to joint j")


def control(x, z, n, e, position_ref, position_read):
    """The law; signals [rad]. x: memory of the links, efforts [N m], errors before [rad], started."""
    count = position_ref.shape[0]
    held, before, started = WIDTH * count, (WIDTH + 1) * count, (WIDTH + 2) * count
    gravity = downwards(n.gravity, n.base_roll, n.base_pitch)
    for j in range(count):  # wrenches on the links at rest
        body(x, n, j, count, position_read[j], n.mass[j], n.tip_mass)
        move(x, j, 0.0, 0.0, gravity)
    gather(x, count, WRENCH, WIDTH - WRENCH)
    for j in range(count):
        reference = late_reference(e, z, j, position_ref[j], x[started])
        error = reference - position_read[j]
        rate = (error - x[before + j]) / n.period if x[started] > 0.0 else 0.0
        stiffness = position_gain(e, z, j, n.kp * n.stiffness[j])
        law = stiffness * error + velocity_gain(e, z, j, n.kd * n.viscosity[j]) * rate
        x[held + j] = law + gravity_share(e, z, j, n.feedforward[j]) * effort(x, j)
        x[before + j] = error
    x[started] = 1.0


def part(slot: int, unit: dict[str, str]) -> Part:
    """The controller as a part; slot: in which it runs; unit: of position, effort, effort/position, effort/speed."""
    joints = {"stiffness": unit["effort/position"], "viscosity": unit["effort/speed"], "feedforward": "-"}
    return Part(
        name="drive", module=sys.modules[__name__],
        parameters=parameters_with(joints, {"kp": "-", "kd": "-", "period": "s"}),
        states=(
            State("link", JOINTS, WIDTH), State("effort", JOINTS, unit=unit["effort"]),
            State("before", JOINTS, unit=unit["position"]), State("started"),
        ),
        tasks=(Task("control", ("position_ref", "position_read"), slots=(slot,)),),
        outputs=(Output.of_states(effort="effort_ref"),),
        points=(late_reference, position_gain, velocity_gain, gravity_share),
    )  # fmt: skip
