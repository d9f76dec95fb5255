"""Detectors of effects that no fit finds, a module each, in this folder or in that of a plugin.

A module offers

    detect(problem, effect, values) -> Problem

effect: the effect that names the module in its field `detector`. values: (parameters,) flat vector of the retuned
robot. The returned problem may hold latent inputs of trials (`Trial.latent`), filtered bands (`Problem.without`), a
`Detection`, and other effects to try (`Problem.tried`).
"""

from importlib import import_module
from typing import TYPE_CHECKING

from exodrake.core import plugins
from exodrake.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from exodrake.diagnosis.problem import Problem

plugins.extend(__path__, "diagnosis/detect")


def detect(problem: "Problem", values: "np.ndarray") -> "Problem":
    """The problem after the detectors of all effects that are tried; values: (parameters,) of the retuned robot [SI].

    InputError for an effect whose detector does not exist.
    """
    for effect in problem.robot.machine.effects:
        if effect.detector and effect.id in problem.tried:
            if effect.detector not in plugins.module_names(__path__):
                raise InputError(f"{effect.id}: no detector {effect.detector!r}")
            problem = import_module(f"{__name__}.{effect.detector}").detect(problem, effect, values)
    return problem
