"""The machine with a free law and a watch at every point where a law may be missing."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from types import ModuleType

import numpy as np

from exodrake.compiled.cache import cache_folder, write_if_different
from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.core.module_file import module_of_file
from exodrake.core.once import once
from exodrake.core.robot import Robot
from exodrake.diagnosis.discovery.effect_text import (
    HEADER,
    KNOTS,
    WEIGHTS,
    effect_source,
    law_source,
    parameter_source,
    watch_effect_source,
    watch_source,
)  # fmt: skip
from exodrake.diagnosis.discovery.forms import LawPoint, law_points
from exodrake.diagnosis.likelihood import Likelihood, with_prediction
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation


def module_text(machine: Machine) -> str:
    """Source of all laws and watches of a machine."""
    pieces = [HEADER.format(summary=f"Free laws at the points of {machine.name}, made by exodrake.")]
    for k, law in enumerate(law_points(machine)):
        knots = [parameter_source(n, law.point, "-", float(i)) for i, n in enumerate(KNOTS)]
        weights = [parameter_source(n, law.point, "-", 0.0) for n in WEIGHTS]
        parameters = [parameter_source("form", law.point, "-", 0.0, 1.0), *knots, *weights]
        pieces += [law_source(law), effect_source(law, f"LAW_{k}", "a free law", parameters, "any")]
        pieces += [watch_source(law), watch_effect_source(law, f"WATCH_{k}")]
    return "\n\n\n".join(pieces) + "\n"


def module_of(text: str, name: str) -> ModuleType:
    """Source as a module of equations, kept in a file of the cache for the code generator to read."""
    full = f"exodrake.effects.free_laws_{name}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    file = write_if_different(cache_folder() / "laws" / f"{full.rsplit('.', 1)[1]}.py", text)
    return module_of_file(full, file)


def with_laws(machine: Machine) -> Machine:
    """The machine with its free laws and watches, after its own effects."""

    def made() -> Machine:
        module = module_of(module_text(machine), machine.name)
        laws = [value for value in vars(module).values() if isinstance(value, Effect)]
        return replace(machine, effects=(*machine.effects, *laws))

    return once(machine, "with_laws", made)


def laws_of(machine: Machine) -> list[LawPoint]:
    """Points of a machine where a law may be missing, one for each id."""
    return list({law.identity: law for law in law_points(machine)}.values())


class MachineMap:
    """Conversion of robots to the same machine with other effects, by the names of parameters."""

    def __init__(self, before: Machine, after: Machine) -> None:
        self.machine = after
        self.index = np.array([after.index[p.name] for p in before.parameters])
        self.null = np.array([0.0 if p.null is None else p.null for p in after.parameters])

    def values(self, values: np.ndarray) -> np.ndarray:
        """Flat parameter vectors (..., n of before) as (..., n of after), new effects at their null values."""
        out = np.broadcast_to(self.null, (*values.shape[:-1], len(self.null))).copy()
        out[..., self.index] = values
        return out

    def robot(self, robot: Robot) -> Robot:
        """The robot on the other machine."""
        return replace(robot, machine=self.machine, values=self.values(robot.values))

    def problem(self, problem: Problem) -> Problem:
        """The case with a nominal robot on the other machine."""
        return replace(problem, robot=self.robot(problem.robot))

    def likelihood(self, likelihood: Likelihood) -> Likelihood:
        """The likelihood with its views on the other machine."""
        views = tuple(replace(view, problem=self.problem(view.problem)) for view in likelihood.views)
        return replace(likelihood, views=views)

    def whole(self, likelihood: Likelihood, problem: Problem) -> Likelihood:
        """The views over all of a case's fitted logs in place of a part of them, on the other machine."""
        problems = with_prediction(self.problem(problem))
        views = tuple(replace(view, problem=p) for view, p in zip(likelihood.views, problems, strict=True))
        return replace(likelihood, views=views)

    def explanation(self, e: Explanation) -> Explanation:
        """The explanation on the other machine, with its parameters."""
        parameters = tuple(replace(p, index=tuple(int(self.index[i]) for i in p.index)) for p in e.parameters)
        return replace(e, parameters=parameters, values=self.values(e.values))
