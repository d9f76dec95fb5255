"""For the bench: one fit, the same by scipy on the compiled simulator and on the Drake Diagram, and one diagnosis.

The robot has friction injected into its sheaths; its logs are 10 s of random motion. All three fits look for the three
coefficients; ours fits the nominal parameters along with them, as a diagnosis does, the others hold those.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
from scipy.optimize import least_squares

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.fit import Explanation, minimise
from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.parameter import STEP, Parameter, apply, effect_parameters, nominal_parameters
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import random_motion
from exodrake.simulation.simulate import record, simulate

EFFECT, COEFFICIENT = "tendon.capstan_friction", "mu_phi"
INJECTED = {"AF": 0.30, "MF": 0.20, "AE": 0.25}
SECONDS = 10.0
STEPS, TOL = 8, 1e-3  # of a fit
Row = tuple[str, float, str]


def simulated_case(name: str, nominal: Robot, robot: Robot, frames: int | None = None) -> Case:
    """Two logs of a robot, one of them held out, on random motions for the nominal one."""
    logs = []
    for seed, role in enumerate(("fit", "holdout")):
        reference = Reference(random_motion(nominal, seed=seed).values[:frames], role)
        logs.append(CaseLog(simulate(robot, reference, seed=seed), role, role, None, f"{role}.csv"))
    return Case(name, {}, tuple(logs))


def rubbing(nominal: Robot, seconds: float) -> Case:
    """Logs of the robot with friction."""
    frames = round(seconds / nominal.machine.frame)
    return simulated_case("friction", nominal, nominal.splice(EFFECT, {COEFFICIENT: INJECTED}), frames)


def timed(function: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Seconds on the clock, and the result."""
    begun = perf_counter()
    found = function()
    return perf_counter() - begun, found


def injected_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """Parameters of the effect on the channels that have it."""
    found = effect_parameters(robot, robot.machine.effect(EFFECT))
    return tuple(p for p in found if set(p.channels) <= set(INJECTED))


def explanation(problem: Problem) -> Explanation:
    """The nominal robot with the effect at its initial values, nominal parameters and their Jacobian along with it."""
    likelihood, nominal = output_error(problem), nominal_parameters(problem.robot)
    parameters = (*nominal, *injected_parameters(problem.robot))
    start, values = np.array([p.start for p in parameters]), problem.silent()
    (residual,) = likelihood.residual(values[None])
    bare = Explanation((), nominal, np.zeros(len(nominal)), values, residual, np.zeros((len(nominal), 0)))
    jacobian = nominal_jacobian(likelihood, bare)
    return Explanation((EFFECT,), parameters, start, values, residual, jacobian).at(likelihood, start)


def ours(problem: Problem) -> np.ndarray:
    """Coordinates of the effect by the diagnosis' own fit, the Jacobian of the nominal parameters included."""
    start = explanation(problem)
    return minimise(output_error(problem), start, STEPS, TOL).x[start.nominal :]


def by_scipy(residual: Callable[[np.ndarray], np.ndarray], parameters: tuple[Parameter, ...]) -> np.ndarray:
    """Coordinates by scipy's bounded least squares, from the same start with the same steps."""
    start, scale = (np.array([getattr(p, name) for p in parameters]) for name in ("start", "scale"))
    bounds = tuple(np.array([p.bounds for p in parameters]).T)
    step = STEP * scale / np.maximum(np.abs(start), 1e-12)
    return least_squares(residual, start, bounds=bounds, x_scale=scale, diff_step=step, ftol=TOL).x


def compiled_residual(problem: Problem, parameters: tuple[Parameter, ...], x: np.ndarray) -> np.ndarray:
    """Residual (samples,) [noise_std] by the compiled simulator."""
    return problem.residual(apply(problem.silent(), parameters, x)[None], problem.fit)[0]


def diagram_residual(problem: Problem, parameters: tuple[Parameter, ...], x: np.ndarray) -> np.ndarray:
    """Residual (samples,) [noise_std] by the Drake Diagram."""
    robot, trial = replace(problem.robot, values=apply(problem.robot.values, parameters, x)), problem.fit[0]
    run = record(robot, Reference(trial.reference, trial.name), seed=None, quantisation=False, engine="drake")
    simulated = np.concatenate([run.signals[signal.name] for signal in robot.machine.signals], axis=1)
    return np.nan_to_num((trial.measured - simulated[:, problem.signal_indices]) / problem.noise_std).ravel()


def rows(seconds: float = SECONDS) -> list[Row]:
    """Figures for `make bench`: name, value, unit."""
    nominal = load_robot()
    case = rubbing(nominal, seconds)
    problem = make_problem(case, nominal)
    parameters = injected_parameters(nominal)
    by_compiled, by_diagram = (partial(f, problem, parameters) for f in (compiled_residual, diagram_residual))
    fits = {
        "ours, errors of the nominal parameters along with it": partial(ours, problem),
        "scipy least squares on the compiled simulator": partial(by_scipy, by_compiled, parameters),
        "scipy least squares on the Drake Diagram": partial(by_scipy, by_diagram, parameters),
    }
    by_compiled(np.array([p.start for p in parameters]))  # loads the compiled code
    found = {name: timed(fit) for name, fit in fits.items()}
    truth = np.array([p.coordinate(INJECTED[p.channels[0]]) for p in parameters])
    table: list[Row] = []
    for name, (time, x) in found.items():
        table += [(f"fit of {len(truth)} coefficients to {seconds:g} s: {name}", time, "s")]
        table += [("  its largest error", float(np.max(np.abs(x - truth) / np.abs(truth))), "-")]
    mine, simulator, diagram = (time for time, _ in found.values())
    table += [
        ("scipy on the Diagram / ours", diagram / mine, "-"),
        ("scipy: Diagram / compiled simulator", diagram / simulator, "-"),
    ]
    begun = perf_counter()
    verdict = diagnose(case, nominal).verdict
    return [*table, (f"one diagnosis, two logs of {seconds:g} s, {verdict}", perf_counter() - begun, "s")]
