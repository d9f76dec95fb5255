"""For the bench: one fit, the same by scipy on the compiled simulator and on the Drake Diagram, and one diagnosis.

The robot has friction in its sheaths, planted; its logs are 10 s of random motion. All three fits look for the three
coefficients; ours fits the errors of the nominal numbers along with them, as a diagnosis does, the others hold those.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.closure import shown
from exodrake.diagnosis.fit import Fitter
from exodrake.diagnosis.hypothesis import NOTHING, Hypothesis, hypothesis
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.protocols import random_motion
from exodrake.simulation.simulate import record, simulate

EFFECT, COEFFICIENT = "tendon.capstan_friction", "mu_phi"
PLANTED = {"AF": 0.30, "MF": 0.20, "AE": 0.25}
SECOND_SHORTLIST = 10.0
Row = tuple[str, float, str]


def rubbing(nominal: Robot, seconds: float) -> Case:
    """Two logs of the robot with friction, one of them held out."""
    robot, logs = nominal.splice(EFFECT, {COEFFICIENT: PLANTED}), []
    for seed, role in enumerate(("fit", "holdout")):
        reference = Reference(random_motion(nominal, seed=seed).tension[: round(seconds / nominal.machine.frame)], role)
        logs.append(CaseLog(simulate(robot, reference, seed=seed), role, role, None, f"{role}.csv"))
    return Case("friction", {}, tuple(logs))


def timed(function: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Seconds on the clock, and the result."""
    begun = perf_counter()
    found = function()
    return perf_counter() - begun, found


def ours(problem: Problem, wanted: Hypothesis) -> np.ndarray:
    """u by the diagnosis' own fit, the responses to the nominal numbers included."""
    fitter = Fitter(problem)
    responses = fitter.responses(fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.coordinates))))
    start = fitter.at(wanted, wanted.start, np.zeros(len(fitter.coordinates)))
    return fitter.fit(start, responses).u


def by_scipy(residual: Callable[[np.ndarray], np.ndarray], wanted: Hypothesis) -> np.ndarray:
    """u by scipy's bounded least squares, from the same start with the same steps."""
    from scipy.optimize import least_squares

    from exodrake.diagnosis.fit import GAIN_ENOUGH, NUDGE

    step = NUDGE * wanted.scales / np.maximum(np.abs(wanted.start), 1e-12)
    return least_squares(
        residual, wanted.start, bounds=tuple(wanted.bounds.T), x_scale=wanted.scales, diff_step=step, ftol=GAIN_ENOUGH
    ).x


def compiled_residual(problem: Problem, wanted: Hypothesis, u: np.ndarray) -> np.ndarray:
    """Residual (samples,) [floors] by the compiled simulator."""
    return problem.residual(wanted.apply(problem.silent(), u)[None], problem.fit)[0]


def diagram_residual(problem: Problem, wanted: Hypothesis, u: np.ndarray) -> np.ndarray:
    """Residual (samples,) [floors] by the Drake Diagram."""
    robot = replace(problem.robot, values=wanted.apply(problem.robot.values, u))
    trial = problem.fit[0]
    run = record(robot, Reference(trial.reference, trial.name), seed=None, quantisation=False, engine="drake")
    return np.nan_to_num((trial.measured - shown(problem, run)) / problem.noise_std).ravel()


def rows(seconds: float = SECOND_SHORTLIST) -> list[Row]:
    """Figures for `make bench`: name, value, unit."""
    nominal = load_robot()
    case = rubbing(nominal, seconds)
    problem = make_problem(case, nominal)
    wanted = hypothesis(nominal.machine, nominal.machine.effect(EFFECT), tuple(PLANTED))
    fits = {
        "ours, errors of the nominal numbers along with it": partial(ours, problem, wanted),
        "scipy least squares on the compiled simulator": partial(
            by_scipy, partial(compiled_residual, problem, wanted), wanted
        ),
        "scipy least squares on the Drake Diagram": partial(
            by_scipy, partial(diagram_residual, problem, wanted), wanted
        ),
    }
    compiled_residual(problem, wanted, wanted.start)  # loads the compiled code
    found = {name: timed(fit) for name, fit in fits.items()}
    truth = np.array([coordinate.at(PLANTED[coordinate.channels[0]]) for coordinate in wanted.coordinates])
    table: list[Row] = []
    for name, (time, u) in found.items():
        table += [(f"fit of {len(truth)} coefficients to {seconds:g} s: {name}", time, "s")]
        table += [("  its largest error", float(np.max(np.abs(u - truth) / np.abs(truth))), "-")]
    mine, simulator, diagram = (time for time, _ in found.values())
    table += [
        ("scipy on the Diagram / ours", diagram / mine, "-"),
        ("scipy: Diagram / compiled simulator", diagram / simulator, "-"),
    ]
    begun = perf_counter()
    verdict = diagnose(case, nominal).verdict
    return [*table, (f"one diagnosis, two logs of {seconds:g} s, {verdict}", perf_counter() - begun, "s")]
