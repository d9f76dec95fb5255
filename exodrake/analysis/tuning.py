"""Tuning: the gains of each controller structure that settle fastest within stated requirements, over tolerances.

    minimise  max settling      subject to  overshoot, disk margin of all commands, noise of the commands

The maxima run over steps of every channel, the machine's operating points and robots drawn within the tolerances. The
search is on linear models (`candidate_controller`), by differential evolution over the logarithms of the gains; the
answer is then judged by nonlinear steps of other robots (`assessment`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from exodrake.analysis.assessment import NOISE_FACTOR, Requirements, Tuned, assessed
from exodrake.analysis.candidate_controller import FRAMES, Performance, Plant, performance, plant_of
from exodrake.analysis.closed_loop import remarks
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.populations import within_tolerances
from exodrake.core.argument import argument
from exodrake.core.errors import InputError
from exodrake.core.loop import Controller
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

DESIGN_SEED = 1  # of the robots that the search sees
SLACK = 0.04  # by which the search keeps away from each requirement, since steps are linear there
PENALTY = 20.0  # cost of a requirement missed by 100 %, in the length of the simulated steps: assumed
LEAST = 1e-12  # of a requirement that is 0, for a division
SEARCH: dict[str, Any] = {"maxiter": 14, "popsize": 8, "seed": 0, "polish": False, "init": "sobol", "tol": 1e-3}
OWN = "as it is"


@short_repr
@dataclass(frozen=True, eq=False)
class Tuning:
    """Controllers that were tuned, compared with the robot's own.

    Attributes:
        robot: robot whose controller is tuned.
        requirements: requirements that the controllers shall hold.
        compared: assessed controllers, the robot's own first.
        notes: conditions under which the linear model means little, a sentence each.
    """

    robot: Robot
    requirements: Requirements
    compared: tuple[Tuned, ...]
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> Tuned | None:
        """The fastest tuned controller that holds all requirements."""
        held = [t for t in self.compared[1:] if not t.missed]
        return min(held, key=lambda t: t.settling, default=None)

    @property
    def noise_unit(self) -> str:
        """Unit of the commands."""
        machine = self.robot.machine
        assert machine.loop is not None  # `tune` sees to it
        return machine.signal[machine.loop.command].unit

    def to_dict(self) -> dict[str, Any]:
        """All numbers, SI, with units in the keys where these are fixed."""
        required = {f"{k} [{u}]" if u else k: getattr(self.requirements, k) for k, u in self.units.items()}
        compared = {
            t.name: {f"{k} [{u}]" if u else k: getattr(t, k) for k, u in self.units.items()}
            | {"gains": t.gains, "misses": list(t.missed)}
            for t in self.compared
        }
        return {
            "required": required,
            "compared": compared,
            "best": self.best and self.best.name,
            "notes": list(self.notes),
        }

    @property
    def units(self) -> dict[str, str]:
        """Number -> unit."""
        return {"settling": "s", "overshoot": "", "disk_margin": "", "noise": self.noise_unit}


def tune(
    robot: Robot,
    requirements: Requirements | None = None,
    only: tuple[str, ...] = (),
    draws: int = 4,
    judges: int = 12,
    progress: Callable[[str], None] = lambda name: None,
) -> Tuning:
    """Tunes each controller structure of the machine's loop and compares them.

    Args:
        robot: whose loop it is.
        requirements: to be held; the defaults without.
        only: names of structures; all if empty.
        draws: robots within the tolerances that the search sees, beside the nominal one at every operating point.
        judges: other robots within the tolerances that judge the answer.
        progress: called with the name of each structure before its search.

    Raises:
        InputError: no closed loop, no state of rest, unknown structure.
    """
    loop = FrameMap.of(argument("robot", robot, Robot)).loop
    requirements = argument("requirements", requirements, Requirements, type(None))
    known = [c.name for c in loop.controllers]
    if (name := next((name for name in only if name not in known), None)) is not None:
        raise InputError(f"{robot.machine.name}: no controller {name!r}; there are {'; '.join(known)}")
    plants = [plant_of(robot, at) for at in loop.points]
    plants += [plant_of(drawn) for _, drawn in within_tolerances(robot, draws, DESIGN_SEED)]
    wanted = with_noise(requirements or Requirements(), plants)
    compared = [assessed(OWN, robot, {}, wanted, judges)]
    for structure in loop.controllers:
        if not only or structure.name in only:
            progress(structure.name)
            fixed = {**structure.fixed, **compliance(plants[0], structure)}
            gains = searched(plants, structure, fixed, wanted)
            source = f"tuned by exodrake as {structure.name}"
            changed = robot.with_parameters(spread(robot, {**fixed, **gains}), source)
            compared.append(assessed(structure.name, changed, gains, wanted, judges))
    plant = plants[0]
    return Tuning(robot, wanted, tuple(compared), remarks(plant.loop, plant.point, plant.model, ()))


def with_noise(wanted: Requirements, plants: list[Plant]) -> Requirements:
    """The requirements with a largest noise of the commands, from that of the robot's own controller where none is."""
    if wanted.noise is not None:
        return wanted
    noises = [noise for plant in plants if np.isfinite(noise := performance(plant, {}).noise)]
    return replace(wanted, noise=NOISE_FACTOR * max(noises, default=np.inf))


def spread(robot: Robot, values: Mapping[str, float | np.ndarray]) -> dict[str, float]:
    """Values [SI] by full names: an array (channels,) gives one to each channel."""
    found = {}
    for name, value in values.items():
        places = robot.indices(name)
        for i, one in zip(places, np.broadcast_to(value, len(places)), strict=True):
            found[robot.machine.parameters[i].name] = float(one)
    return found


def compliance(plant: Plant, structure: Controller) -> dict[str, np.ndarray]:
    """Static compliance d(actuated)/d(reading) by parameter, (channels,) each [actuated / reading], or none."""
    if not structure.compliance:
        return {}
    loop, model = plant.loop, plant.model
    gain = model.response(np.zeros(1))[0].real
    rows = {s: [model.outputs.index(f"{loop.column(s)}_{c}") for c in loop.channels]
            for s in (loop.loop.actuated, loop.loop.measured)}  # fmt: skip
    static = gain[rows[loop.loop.actuated]] @ np.linalg.inv(gain[rows[loop.loop.measured]])
    return dict(zip(structure.compliance, static.T, strict=True))


def searched(
    plants: list[Plant], structure: Controller, fixed: Mapping[str, float | np.ndarray], wanted: Requirements
) -> dict[str, float]:
    """Gains [SI] of least cost, for the nominal plants first, then for all; `fixed` holds values, or (channels,)."""
    from scipy.optimize import differential_evolution, minimize

    names = [g.parameter for g in structure.gains]
    bounds = [(np.log(g.low), np.log(g.high)) for g in structure.gains]
    scale = plants[0].loop.robot.machine.frame
    nominal = [p for p in plants if p.loop.robot is plants[0].loop.robot]

    def values(logs: np.ndarray) -> dict[str, float]:
        return {n: float(np.exp(x)) for n, x in zip(names, logs)}

    def cost(logs: np.ndarray, over: list[Plant]) -> float:
        inside = np.clip(logs, *np.array(bounds).T)
        worst = 0.0
        for plant in over:
            worst = max(worst, cost_of(performance(plant, {**fixed, **values(inside)}), wanted, scale))
            if worst > 1e6:
                break
        return worst + 1e3 * float(np.abs(logs - inside).sum())

    found = differential_evolution(cost, bounds, (nominal,), **SEARCH)
    options = {"maxfev": 40 * len(names), "xatol": 1e-2, "fatol": 0.1, "initial_simplex": simplex(found.x)}
    found = minimize(cost, found.x, (plants,), method="Nelder-Mead", options=options)
    return values(np.clip(found.x, *np.array(bounds).T))


def simplex(start: np.ndarray) -> np.ndarray:
    """A start (n + 1, n) [logarithms, -] that lowers each gain in turn by 15 %, from gains (n,)."""
    return np.vstack([start, start - 0.15 * np.eye(len(start))])


def cost_of(p: Performance, wanted: Requirements, frame: float) -> float:
    """Settling time in frames, plus what each missed requirement costs; far above for an unstable loop."""
    if p.radius >= 1.0:
        return 1e6 * (1.0 + p.radius)
    most = wanted.noise if wanted.noise is not None else np.inf
    missed = (
        max(0.0, p.overshoot - wanted.overshoot * (1.0 - SLACK)) / max(wanted.overshoot, 0.01),
        max(0.0, 1.0 - p.disk_margin / max(wanted.disk_margin * (1.0 + SLACK), LEAST)),
        max(0.0, p.noise / max(most * (1.0 - SLACK), LEAST) - 1.0),
    )
    return p.settling / frame + FRAMES * PENALTY * sum(missed)
