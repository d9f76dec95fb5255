"""Cable-driven transmission: motors, pretensioned cable loops over capstans, and joints that a matrix couples to them.

    psi = A theta                        where the motors would hold the joints with rigid cables
    d = psi - q                          stretch of a loop, at its joint
    s = f(d) - f(-d),  f(d) = max(0, pretension + k (d + loss d')) / 2      effort on the joint
    B theta'' = tau - damping theta' - friction - A' s

k: stiffness with both strands taut. One goes slack at |d| = pretension / k; beyond it the loop is half as stiff.
A' s is the load on the motors by virtual work. A couples neighbours: its diagonal is `ratio`, what a joint takes of the
motors before and after its own is `by_previous` and `by_next`, as in a wrist of a dVRK instrument or in a differential
of a WAM. The robot's software knows the nominal A: it takes A theta for the joints' positions and asks the motors for
A' of the joints' efforts.

Euler's rule for the speeds, then for the positions with the new speeds; the arm does the same with the same s.
"""

import sys

from exodrake.model.part import JOINTS, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import brake_dry

ANGLE, SPEED, STRETCH, STATES = 0, 1, 2, 3

ratio = Point("ratio", JOINTS, "share", "what joint j takes of its own motor's angle [-]")
by_previous = Point("by_previous", JOINTS, "share, own",
                    "what joint j takes of the angle of the motor before its own [-]; own: of its own's")  # fmt: skip
by_next = Point("by_next", JOINTS, "share, own",
                "what joint j takes of the angle of the motor after its own [-]; own: of its own's")  # fmt: skip
cable_stretch = Point("taken", JOINTS, "stretch", "stretch of the cables of joint j [rad], from psi - q")
loop_stiffness = Point("stiff", JOINTS, "stiffness", "stiffness of loop j with both strands taut [N m/rad]")
loop_pretension = Point("tensioned", JOINTS, "pretension", "pretension of loop j, effort of one strand [N m]")
push_motor = Point("pushed", JOINTS, "effort, speed", "effort on motor j [N m], from its current's; speed [rad/s]",
                   standard="sliding.pushed")  # fmt: skip
brake_motor = Point("braked", JOINTS, "speed, mobility, load",
                    "speed of motor j [rad/s] after dry friction; mobility: speed per effort; load: |effort| [N m]",
                    standard="sliding.braked")  # fmt: skip
settle = Point("settle", JOINTS, "dt, travel", "states of the effects on motor j after dt [s]; travel [rad]",
               standard="sliding.settle")  # fmt: skip


def couple_motors(angle, z, n, e, first, j, count):
    """Psi of joint j [rad] for motors at the angles from `first` on."""
    found = ratio(e, z, j, n.ratio[j]) * angle[first + j]
    if j > 0:
        found += by_previous(e, z, j, n.by_previous[j], n.ratio[j]) * angle[first + j - 1]
    if j + 1 < count:
        found += by_next(e, z, j, n.by_next[j], n.ratio[j]) * angle[first + j + 1]
    return found


def load(effort, z, n, e, j, count):
    """(A' s)_j: load of the cables on motor j [N m]."""
    found = ratio(e, z, j, n.ratio[j]) * effort[j]
    if j + 1 < count:
        found += by_previous(e, z, j + 1, n.by_previous[j + 1], n.ratio[j + 1]) * effort[j + 1]
    if j > 0:
        found += by_next(e, z, j - 1, n.by_next[j - 1], n.ratio[j - 1]) * effort[j - 1]
    return found


def pull_loop(stretch, stiffness, pretension):
    """Effort of a cable loop [N m] at a stretch [rad]."""
    return 0.5 * (max(0.0, pretension + stiffness * stretch) - max(0.0, pretension - stiffness * stretch))


def stretch_loop(x, z, n, e, j, count, position):
    """Stretch d of the loop of joint j [rad], its play taken up."""
    return cable_stretch(e, z, j, couple_motors(x, z, n, e, ANGLE * count, j, count) - position)


def update(x, z, n, e, dt, motor_effort_true, effort_true, position):
    """One tick of the motors; efforts of motors and cables [N m], positions of the joints [rad]."""
    count = effort_true.shape[0]
    if x[STATES * count] > 0.0:
        for j in range(count):
            x[STRETCH * count + j] = stretch_loop(x, z, n, e, j, count, position[j])
        x[STATES * count + 1] = dt
        for j in range(count):
            speed, given = x[SPEED * count + j], motor_effort_true[j]
            push = push_motor(e, z, j, given, speed) - n.damping[j] * speed - load(effort_true, z, n, e, j, count)
            mobility = dt / n.inertia[j]
            free = brake_dry(speed + mobility * push, n.dry_friction[j] * mobility)
            after = brake_motor(e, z, j, free, mobility, abs(given))
            x[SPEED * count + j] = after
            x[ANGLE * count + j] += dt * after
            settle(e, z, j, dt, dt * after)


def stand(x, z, n, e, motor_start):
    """Where the motors stand at the start of the log [rad], taken in the first frame; they rest there."""
    count = motor_start.shape[0]
    if x[STATES * count] == 0.0:
        for j in range(count):
            x[ANGLE * count + j] = motor_start[j]
        x[STATES * count] = 1.0


def begin(x, z, n, e, position_start, motor_start, link_start):
    """Where motors and joints stand at first [rad]: A theta = where the software saw the joints (Thomas's solution)."""
    count = position_start.shape[0]
    for j in range(count):  # link_start holds the eliminated upper diagonal until the end
        below = n.by_previous[j] if j > 0 else 0.0
        pivot = n.ratio[j] - (below * link_start[j - 1] if j > 0 else 0.0)
        link_start[j] = n.by_next[j] / pivot
        motor_start[j] = (position_start[j] - (below * motor_start[j - 1] if j > 0 else 0.0)) / pivot
    for j in range(count - 2, -1, -1):
        motor_start[j] -= link_start[j] * motor_start[j + 1]
    for j in range(count):
        link_start[j] = couple_motors(motor_start, z, n, e, 0, j, count)


def output(x, z, n, e, position, motor_position, effort_true):
    """Angles of the motors [rad], and efforts of the cables on joints at these positions [rad], [N m]."""
    count = position.shape[0]
    for j in range(count):
        motor_position[j], effort_true[j] = x[ANGLE * count + j], 0.0
        if x[STATES * count] > 0.0:
            stretch, dt = stretch_loop(x, z, n, e, j, count, position[j]), x[STATES * count + 1]
            stretch += n.loss[j] * (stretch - x[STRETCH * count + j]) / dt if dt > 0.0 else 0.0
            stiffness, pretension = loop_stiffness(e, z, j, n.stiffness[j]), loop_pretension(e, z, j, n.pretension[j])
            effort_true[j] = pull_loop(stretch, stiffness, pretension)


def read_positions(x, z, n, e, motor_position_read, position_read):
    """Positions of the joints [rad] as the software takes them from those of the motors, by the nominal A."""
    count = position_read.shape[0]
    for j in range(count):
        position_read[j] = n.ratio[j] * motor_position_read[j]
        if j > 0:
            position_read[j] += n.by_previous[j] * motor_position_read[j - 1]
        if j + 1 < count:
            position_read[j] += n.by_next[j] * motor_position_read[j + 1]


def share_efforts(x, z, n, e, effort_ref, motor_effort_ref):
    """Efforts that the software asks of the motors for those of the joints [N m], by the nominal A."""
    count = effort_ref.shape[0]
    for j in range(count):
        motor_effort_ref[j] = n.ratio[j] * effort_ref[j]
        if j + 1 < count:
            motor_effort_ref[j] += n.by_previous[j + 1] * effort_ref[j + 1]
        if j > 0:
            motor_effort_ref[j] += n.by_next[j - 1] * effort_ref[j - 1]


def part(slot: int, friction: float, speed: float, unit: dict[str, str]) -> Part:
    """The transmission as a part.

    Args:
        slot: in which the motors learn where they stand.
        friction: of a motor [N m], for the ranges of its friction's laws.
        speed: of a motor in a moderate motion [rad/s], for the same.
        unit: of position, effort and effort/position of the joints.
    """
    per_joint = {
        **dict.fromkeys(("ratio", "by_previous", "by_next"), "-"), "stiffness": unit["effort/position"],
        "pretension": unit["effort"], "loss": "s", "inertia": "kg m2", "damping": "N m s/rad", "dry_friction": "N m",
    }  # fmt: skip
    return Part(
        name="cable", module=sys.modules[__name__], parameters=parameter_class((JOINTS, per_joint)),
        states=(
            State("angle", JOINTS, unit="rad"), State("speed", JOINTS, unit="rad/s"),
            State("stretch", JOINTS, unit=unit["position"]), State("placed", width=2),
        ),
        tasks=(
            Task("update", ("motor_effort_true", "effort_true", "position")),
            Task("stand", ("motor_start",), slots=(slot,)),
        ),
        outputs=(
            Output("begin", ("motor_start", "link_start"), reads=("position_start",)),
            Output("output", ("motor_position", "effort_true"), reads=("position",)),
            Output("read_positions", ("position_read",), reads=("motor_position_read",)),
            Output("share_efforts", ("motor_effort_ref",), reads=("effort_ref",)),
        ),
        points=(
            ratio, by_previous, by_next, cable_stretch, loop_stiffness, loop_pretension,
            push_motor, brake_motor, settle,
        ),
        scales={
            "force": (friction, "N m"), "speed": (speed, "rad/s"), "force/speed": (friction / speed, "N m s/rad"),
            "length": (speed, "rad"), "rad": (1.0, unit["position"]),
        },
    )  # fmt: skip
