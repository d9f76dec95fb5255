"""Geared servos with their motors: firmware, supply, DC motor, gear, and the load that each turns.

    u = min(max(kp (q_ref - q) - kd q', -1), 1)           duty cycle of the firmware
    tau = kt / R (u V - kt w)                             DC motor at the gear's output; w: speed of the rotor
    rigid gear, w = q':
    (J + A) q'' = tau - d q' - dry friction - m(q)        m = moment sin(q - hanging), of the load's weight
    elastic gear or one with play, twist = rotor - q:
    J q'' = s - m(q)        A w' = tau - d w - dry friction - s        s = k (twist beyond the play) + damping

kt, d, A and R are those of the motor as the output feels it, the ratio of the gear included (Rhoban/bam; Duclusaud et
al., ICRA 2025). Speeds are exact for a torque held over a tick, positions follow with the new speeds. Dry friction
takes speed away after the push, at most all of it. Without friction the fastest motion is V / kt.
"""

import sys
from math import exp, sin, sqrt

from exodrake.model.part import JOINTS, SCALAR, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import brake_dry

# rad, of a gear's fastest oscillation in a tick; stiffer gears count as this stiff, so that they are stable
RIGID = 1.0
LOSS = 0.1  # damping of a gear's oscillation over the critical one: assumed

# motor, supply, firmware, friction and load of each joint, at the output of its gear; gear's compliance or 0
Parameters = parameter_class((JOINTS, {
    "kt": "N m/A", "R": "V/A", "supply": "V", "kp": "1/rad", "kd": "s/rad", "armature": "kg m2", "damping": "N m s/rad",
    "dry_friction": "N m", "compliance": "rad/(N m)", "inertia": "kg m2", "moment": "N m", "hanging": "rad",
}))  # fmt: skip

firmware_reference = Point("firmware_reference", JOINTS, "aim, before, dt",
                           "reference of the firmware [rad], from the command; before: so far [rad]")  # fmt: skip
firmware_error = Point("firmware_error", JOINTS, "error", "error that the firmware acts on [rad]")
firmware_gain = Point("firmware_gain", JOINTS, "gain", "gain of the firmware, duty cycle per error [1/rad]")
duty = Point("duty", JOINTS, "cycle", "duty cycle that the firmware gives, -1 .. 1")
supply_voltage = Point("supply_voltage", JOINTS, "voltage, duty, back_emf, resistance",
                       "voltage [V] under a duty cycle, a back-EMF [V], the winding's resistance [V/A]")  # fmt: skip
torque_constant = Point("torque_constant", JOINTS, "constant",
                        "torque constant [N m/A], which is that of the back-EMF [V s/rad]")  # fmt: skip
load_inertia = Point("load_inertia", JOINTS, "inertia", "inertia of the load [kg m2]")
load_moment = Point("load_moment", JOINTS, "moment", "largest moment of the load's weight [N m]")
gear_compliance = Point("gear_compliance", JOINTS, "compliance", "compliance of the gear [rad/(N m)]")
gear_play = Point("gear_play", JOINTS, "half_width", "half the play of the gear [rad]")
push_rotor = Point("pushed", JOINTS, "torque, speed", "torque on the rotor [N m], from the motor's; speed [rad/s]",
                   standard="sliding.pushed")  # fmt: skip
brake_rotor = Point("braked", JOINTS, "speed, mobility, load, opposed",
                    "speed of the rotor [rad/s] after dry friction; mobility: speed per torque in this tick; load: "
                    "torque that the gear carries, of motor and load [N m]; opposed: torque of the load against that "
                    "of the motor [N m], < 0 where it helps", standard="sliding.braked")  # fmt: skip
settle = Point("settle", JOINTS, "dt, travel", "states of the effects on joint j after dt [s]; travel: rotor's [rad]",
               standard="sliding.settle")  # fmt: skip


def update(x, z, n, e, dt, command, origin, ready):
    """One tick; signals [rad]. x: angles, speeds, rotors' angles and speeds, references, started."""
    count = command.shape[0]
    if ready[0] > 0.0:
        for j in range(count):
            if x[5 * count] == 0.0:
                x[j], x[2 * count + j], x[4 * count + j] = origin[j], origin[j], command[j]
            x[4 * count + j] = firmware_reference(e, z, j, command[j], x[4 * count + j], dt)
            turn(x, z, n, e, j, count, dt)
        x[5 * count] = 1.0


def turn(x, z, n, e, j, count, dt):
    """Joint j moves on by a tick."""
    angle, speed, rotor, rotor_speed = x[j], x[count + j], x[2 * count + j], x[3 * count + j]
    error = firmware_error(e, z, j, x[4 * count + j] - angle)
    given = min(max(firmware_gain(e, z, j, n.kp[j]) * error - n.kd[j] * speed, -1.0), 1.0)
    cycle = duty(e, z, j, given)
    constant = torque_constant(e, z, j, n.kt[j])
    voltage = supply_voltage(e, z, j, n.supply[j], cycle, constant * rotor_speed, n.R[j])
    given = constant / n.R[j] * cycle * voltage
    drag = constant * constant / n.R[j] + n.damping[j]
    torque = given - constant * constant / n.R[j] * rotor_speed
    weight = load_moment(e, z, j, n.moment[j]) * sin(angle - n.hanging[j])
    load = load_inertia(e, z, j, n.inertia[j])
    play, compliance = gear_play(e, z, j, 0.0), gear_compliance(e, z, j, n.compliance[j])
    rigid = play <= 0.0 and compliance <= 0.0
    moved, external = n.armature[j] + load, weight
    if not rigid:
        moved, reduced = n.armature[j], n.armature[j] * load / (n.armature[j] + load)
        stiffness = reduced * RIGID * RIGID / (dt * dt)
        if compliance > 0.0:
            stiffness = min(1.0 / compliance, stiffness)
        twist, external = rotor - angle, 0.0
        beyond = twist - min(max(twist, -play), play)
        if beyond != 0.0:
            external = stiffness * beyond + 2.0 * LOSS * sqrt(stiffness * reduced) * (rotor_speed - speed)
        x[count + j] = speed + dt * (external - weight) / load
        x[j] = angle + dt * x[count + j]
    decay = exp(-drag * dt / moved)
    mobility = (1.0 - decay) / drag
    free = rotor_speed * decay + mobility * (push_rotor(e, z, j, given, rotor_speed) - external)
    free = brake_dry(free, n.dry_friction[j] * mobility)
    opposed = external if torque > 0.0 else -external
    after = brake_rotor(e, z, j, free, mobility, abs(torque + external), opposed)
    x[3 * count + j], x[2 * count + j] = after, rotor + dt * after
    if rigid:
        x[count + j], x[j] = after, rotor + dt * after
    settle(e, z, j, dt, dt * after)


def part(scales: dict[str, tuple[float, str]]) -> Part:
    """The servos as a part named `servo`; scales: of their friction."""
    return Part(
        name="servo", module=sys.modules[__name__], parameters=Parameters,
        states=(
            State("angle", JOINTS, unit="rad"), State("speed", JOINTS, unit="rad/s"),
            State("rotor", JOINTS, unit="rad"), State("rotor_speed", JOINTS, unit="rad/s"),
            State("reference", JOINTS, unit="rad"), State("started", SCALAR),
        ),
        tasks=(Task("update", ("command", "origin", "ready")),), outputs=(Output.of_states(angle="angle"),),
        points=(
            firmware_reference, firmware_error, firmware_gain, duty, supply_voltage, torque_constant, load_inertia,
            load_moment, gear_compliance, gear_play, push_rotor, brake_rotor, settle,
        ),
        scales=scales,
    )  # fmt: skip
