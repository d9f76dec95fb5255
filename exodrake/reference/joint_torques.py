"""Joint torques of the reference simulator [N m, along +q]: tissue, losses, contact, the wearer."""

from math import cos, cosh, exp, log1p, sin, sinh

from numba import njit

from exodrake.reference.records import (
    ANGLE,
    JOINT_LOSS,
    RATE,
    RELAX_FAST,
    RELAX_SLOW,
    REST_SHIFT,
    STIFFENED,
    TREMOR_PHASE,
    VOLUNTARY,
)
from exodrake.reference.tendons import FULL_TURN

SINH_RATE = 1.6  # 1/rad, bends the exponential hardening away from a cubic [A]


@njit(cache=True)
def end_stops(p, joint, q):
    """Double exponential of model.md."""
    torque = 0.0
    if q > p.stop_flexed[joint]:
        torque -= p.stop_torque[joint] * (exp(p.stop_rate[joint] * (q - p.stop_flexed[joint])) - 1.0)
    if q < p.stop_extended[joint]:
        torque += p.stop_torque[joint] * (exp(p.stop_rate[joint] * (p.stop_extended[joint] - q)) - 1.0)
    return torque


@njit(cache=True)
def tissue(p, y, dy, u, joint):
    """Spring, damper, end stops, hardening (sinh), two relaxing branches."""
    q, rate = y[ANGLE + joint], y[RATE + joint]
    bent = q - p.rest[joint] - u[REST_SHIFT + joint]
    stiffness = p.stiffness_joint[joint] * p.factor[joint] * (1.0 + u[STIFFENED + joint])
    torque = end_stops(p, joint, q) - stiffness * bent - p.damping_joint[joint] * rate
    if p.hardening[joint] > 0.0:
        scale = 6.0 * p.hardening[joint] / SINH_RATE**3
        torque -= scale * (sinh(SINH_RATE * bent) - SINH_RATE * bent)
    if p.relaxing[joint] > 0.0:
        dy[RELAX_FAST + joint] = (bent - y[RELAX_FAST + joint]) * 3.0 / p.relaxing_time[joint]
        dy[RELAX_SLOW + joint] = (bent - y[RELAX_SLOW + joint]) / (1.7 * p.relaxing_time[joint])
        branch = 0.5 * stiffness * p.relaxing[joint]
        torque -= branch * (2.0 * bent - y[RELAX_FAST + joint] - y[RELAX_SLOW + joint])
    return torque


@njit(cache=True)
def losses(p, y, dy, joint):
    """Bouc-Wen hysteresis; its level may grow with the joint angle (posture-dependent friction)."""
    level = p.loss[joint]
    if p.loss_by_angle[joint] > 0.0:
        level += p.loss_by_angle[joint] * max(0.0, y[ANGLE + joint]) ** 2
    if level <= 0.0:
        return 0.0
    z, rate = y[JOINT_LOSS + joint], y[RATE + joint]
    size = abs(z) ** p.hysteresis_power
    dy[JOINT_LOSS + joint] = (rate - size * (0.5 * rate + 0.5 * abs(rate) * (1.0 if z > 0.0 else -1.0))) / p.loss_width[
        joint
    ]
    return -level * z


@njit(cache=True)
def wearer(p, y, u, joint, time):
    """Tremor with a wandering phase, voluntary bursts, catch in fast flexion (softened ramp), snap-through notch."""
    torque = u[VOLUNTARY + joint]
    if p.tremor_torque > 0.0:
        phase = FULL_TURN * p.tremor_frequency * time + u[TREMOR_PHASE]
        torque += p.tremor_torque * p.tremor_share[joint] * (sin(phase) + 0.15 * sin(2.0 * phase))
    if p.spastic_gain[joint] > 0.0:
        softness = 0.15 * p.spastic_threshold[joint]
        over = (y[RATE + joint] - p.spastic_threshold[joint]) / softness
        ramp = over if over > 30.0 else log1p(exp(over))
        torque -= p.spastic_gain[joint] * softness * ramp
    if p.notch_torque != 0.0 and joint == 1:
        x = (y[ANGLE + joint] - p.notch_angle) / p.notch_width
        torque += p.notch_torque * x / cosh(x) ** 2
    return torque


@njit(cache=True)
def digital_tendon(p, y, joint):
    """DIP tied to PIP, slightly hardening; equal and opposite work at the PIP."""
    if p.coupling[2] == 0.0 or joint == 0:
        return 0.0
    apart = y[ANGLE + 2] - p.coupling_ratio[2] * y[ANGLE + 1]
    torque = p.coupling[2] * apart * (1.0 + 0.5 * apart * apart)
    return -torque if joint == 2 else p.coupling_ratio[2] * torque


@njit(cache=True)
def contact_force(p, y):
    """Contact of the fingertip with an object, Hunt-Crossley with exponent 1.3.

    Returns:
        Dorsal force [N], and the cosines of the chain's angles times the lengths (3,) [m].
    """
    first = y[ANGLE]
    second = first + y[ANGLE + 1]
    third = second + y[ANGLE + 2]
    depth = p.length[0] * sin(first) + p.length[1] * sin(second) + p.length[2] * sin(third)
    reach = (p.length[0] * cos(first), p.length[1] * cos(second), p.length[2] * cos(third))
    into = depth - p.contact_depth
    if into <= 0.0:
        return 0.0, reach
    outer = reach[2] * (y[RATE] + y[RATE + 1] + y[RATE + 2])
    speed = reach[0] * y[RATE] + reach[1] * (y[RATE] + y[RATE + 1]) + outer
    force = p.contact_stiffness * 1e-3 * (into / 1e-3) ** 1.3 * (1.0 + 1.5 * speed)
    return max(0.0, force), reach


@njit(cache=True)
def contact_torque(force, reach, joint):
    """Torque of the dorsal fingertip force [N m]."""
    arm = reach[2]
    if joint <= 1:
        arm += reach[1]
    if joint == 0:
        arm += reach[0]
    return -force * arm
