"""A case whose residual is a formula of the parameters: no robot, no simulation."""

from math import inf
from types import SimpleNamespace

import numpy as np

from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.likelihood import Likelihood, View
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.problem import Trial

FRAME = 0.02  # s
WIDE = (-1e6, 1e6)


def likelihood_of(formula, frames=(400,), columns=1, scale=1.0, measured=None):
    """One view of logs of so many frames."""
    logs = measured or [np.zeros((n, columns)) for n in frames]
    trials = tuple(Trial(f"{k}.csv", np.zeros((len(y), 1)), y) for k, y in enumerate(logs))
    case = SimpleNamespace(repeat_groups=(), fit_logs=[SimpleNamespace(log=y) for y in logs])
    machine = SimpleNamespace(name="formula", frame=FRAME, tolerances=(), separate=False, effect=lambda identity: None)
    names = tuple(f"angle_{k}" for k in range(columns))

    def tasks(rows, trials, out, whitening):
        return [lambda: np.copyto(out, np.array([formula(row) for row in rows]).reshape(out.shape))]

    problem = SimpleNamespace(
        fit=trials, columns=names, case=case, robot=SimpleNamespace(machine=machine), counted={}, judged=trials,
        tasks=tasks,
    )  # fmt: skip
    return Likelihood((View(problem, None, scale),))


def nominal(count, prior_std, bounds=WIDE):
    """Parameters at the first positions of the vector."""
    return tuple(Parameter(f"p{k}", (k,), "additive", 0.0, prior_std, bounds) for k in range(count))


def amplitude(effect, index, bounds=(-100.0, 100.0)):
    """An amplitude of an effect at one position."""
    return Parameter(f"{effect}.a", (index,), "additive", 0.0, inf, bounds, effect, ("",), True, 1.0)


def probe(effect, rows, low=-1e3, high=1e3):
    """A probe whose directions are these rows of the linearisation."""
    rows = np.array(rows)
    parameters = tuple(amplitude(effect, -1) for _ in rows)
    ends = np.full(len(rows), low), np.full(len(rows), high)
    return Probe((effect,), parameters, np.ones(len(rows)), tuple(range(len(rows))), rows, *ends)


def explanation(likelihood, parameters, x, jacobian, effects=()):
    """The explanation at coordinates x."""
    size = 1 + max((i for p in parameters for i in p.index), default=0)
    start = Explanation(effects, tuple(parameters), x, np.zeros(size), np.zeros(0), jacobian)
    return start.at(likelihood, x)


def linearisation(e, directions=None, probes=()):
    """Directions beside an explanation."""
    directions = np.zeros((0, len(e.residual))) if directions is None else directions
    return Linearisation(directions.astype(np.float32), tuple(probes), *np.ones((2, len(e.residual)), dtype=bool))
