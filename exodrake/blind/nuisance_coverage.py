"""How well a fit knows the nominal numbers of a healthy robot of the second reality, which are known here."""

import numpy as np

from exodrake.blind.parameters import draw_numbers
from exodrake.diagnosis.fit import Fitter
from exodrake.diagnosis.intervals import Z90, covariance
from exodrake.diagnosis.nuisance import ADDITIVE

MEMORIES = (0.02, 0.2, 0.4, 0.66, 1.0, 2.0)  # s of a log that may count as one frame (`fit.py`)
SAME = {
    "tendon.k": "wire_stiffness", "finger.kappa": "stiffness_joint", "finger.B": "damping_joint",
    "finger.q_f": "stop_flexed", "finger.q_e": "stop_extended", "finger.q0": "rest", "finger.A": "stop_torque",
    "router.a_f": "axial", "router.a_e": "axial", "router.m_f": "height_flexor", "router.m_e": "height_extensor",
    "motor.kM": "torque_constant", "motor.J": "inertia", "motor.Ki": "loop_i", "motor.r": "spool",
    "sensor.tau_F": "tau_cell",
}  # fmt: skip
"""Number of the model -> the same number in the second reality. An end stop's steepness has another law there."""


def truth(knobs, channels, numbers):
    """Where each knob of the model's nominal numbers truly is (knobs,); NaN where the second reality has no such
    number. lanes: wires and joints; numbers: as `draw_numbers` gives them.
    """
    nominal = draw_numbers()
    return np.array([true_knob(knob, channels, numbers, nominal) for knob in knobs])


def true_knob(knob, channels, numbers, nominal):
    """Where one knob truly is: a relative error, or an angle [rad]."""
    name, _, lane = knob.name.split()[0].rpartition(".")
    if knob.name in SAME:
        name, lane = knob.name, ""
    if name not in SAME:
        return np.nan
    here = ("axial", int(name.endswith("_e"))) if SAME[name] == "axial" else (SAME[name],)
    drawn, usual = (at(found, here, lane, channels) for found in (numbers, nominal))
    return drawn - usual if knob.transform == ADDITIVE else drawn / usual - 1.0


def at(numbers, here, lane, channels):
    """One number: of a wire or joint, on a side, or of the whole robot."""
    value = np.asarray(numbers[here[0]])
    for place in here[1:]:
        value = value[place]
    order = next((names for names in channels if lane in names), None)
    return float(value if order is None else value[order.index(lane)])


def known(ranking, retuned, numbers):
    """For each of MEMORIES: share of the nominal numbers whose 90 % interval covers the truth, and the root mean square
    error in units of their spread.
    """
    machine = ranking.full.problem.robot.machine
    true = truth(ranking.full.knobs, (machine.axes.tendons, machine.axes.joints), numbers)
    sure, found = np.isfinite(true), []
    for memory in MEMORIES:
        fitter, begin = Fitter(ranking.full.problem, memory), retuned.point
        point, _ = fitter.settled(fitter.scored(begin.hypothesis, begin.u, begin.x, begin.residual))
        deviations = np.sqrt(np.diag(covariance(fitter, point, fitter.responses(point, central=True))))
        error = (point.x - true)[sure]
        inside = np.abs(error) < Z90 * deviations[sure]
        spread = np.array([knob.prior_std for knob in fitter.knobs])[sure]
        found.append((float(inside.mean()), float(np.sqrt(np.mean((error / spread) ** 2)))))
    return found
