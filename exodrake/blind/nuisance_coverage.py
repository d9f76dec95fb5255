"""How well a fit knows the nominal parameters of a robot of the reference simulator, whose truth is known."""

import numpy as np

from exodrake.blind.parameters import draw_parameters
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
"""Parameter of the model -> the same one in the reference simulator. An end stop's steepness has another law there."""


def truth(coordinates, channels, parameters):
    """True value of each nominal parameter.

    Args:
        coordinates: Coordinates of the fit.
        channels: Names of tendons and joints.
        parameters: As `draw_parameters` gives them [SI].

    Returns:
        (coordinates,) relative errors [-] or angles [rad]; NaN where the reference simulator lacks the parameter.
    """
    nominal = draw_parameters()
    return np.array([true_coordinate(coordinate, channels, parameters, nominal) for coordinate in coordinates])


def true_coordinate(coordinate, channels, parameters, nominal):
    """True value of one parameter: a relative error, or an angle [rad]."""
    name, _, channel = coordinate.name.split()[0].rpartition(".")
    if coordinate.name in SAME:
        name, channel = coordinate.name, ""
    if name not in SAME:
        return np.nan
    here = ("axial", int(name.endswith("_e"))) if SAME[name] == "axial" else (SAME[name],)
    drawn, default = (at(found, here, channel, channels) for found in (parameters, nominal))
    return drawn - default if coordinate.transform == ADDITIVE else drawn / default - 1.0


def at(parameters, here, channel, channels):
    """One parameter: of a tendon or joint, on a side, or of the whole robot."""
    value = np.asarray(parameters[here[0]])
    for place in here[1:]:
        value = value[place]
    order = next((names for names in channels if channel in names), None)
    return float(value if order is None else value[order.index(channel)])


def coverage_of(ranking, retuned, parameters):
    """Coverage of the 90 % intervals of nominal parameters.

    Args:
        ranking: Fitters of a case.
        retuned: Its fit without an effect.
        parameters: As `draw_parameters` gives them [SI].

    Returns:
        For each of MEMORIES the share of covered parameters, and their root mean square error [prior deviations].
    """
    machine = ranking.full.problem.robot.machine
    true = truth(ranking.full.coordinates, (machine.axes.tendons, machine.axes.joints), parameters)
    sure, found = np.isfinite(true), []
    for memory in MEMORIES:
        fitter, begin = Fitter(ranking.full.problem, memory), retuned.point
        point, _ = fitter.minimised(fitter.scored(begin.hypothesis, begin.u, begin.x, begin.residual))
        deviations = np.sqrt(np.diag(covariance(fitter, point, fitter.responses(point, central=True))))
        error = (point.x - true)[sure]
        inside = np.abs(error) < Z90 * deviations[sure]
        prior_std = np.array([coordinate.prior_std for coordinate in fitter.coordinates])[sure]
        found.append((float(inside.mean()), float(np.sqrt(np.mean((error / prior_std) ** 2)))))
    return found
