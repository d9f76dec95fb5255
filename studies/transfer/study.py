"""What a controller gains from a diagnosis: controllers tuned on the models of a case run on the withheld robot.

For each case a controller is tuned on the nominal, the retuned and the improved robot; each of these models predicts
the cost of every controller on a motion that no controller was tuned on. Then the labels are read, the withheld robot
is built anew in the reference simulator, and every controller runs on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.core.progress import Count, no_progress
from exodrake.diagnosis.many import IMPROVED, RETUNED
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot
from exodrake.reference.answers import ANSWER, find_cases, read_diagnosis, read_labels
from exodrake.reference.faults import ENTRIES
from exodrake.reference.robot import InjectedFault, RobotSpec
from exodrake.reference.simulator import simulate
from studies.transfer.control_task import Gains, Tuner, by_cost, cost, motion, own_gains, predicted

DEFAULT = "default"  # the controller as it is
MODELS = ("nominal", "retuned", "improved")
TUNING, JUDGING = 0, 1  # purposes of the two motions
REFERENCE_GAIN = {"controller.kp": "kp", "controller.kd": "kd"}  # names in the reference simulator


@dataclass(frozen=True)
class Prediction:
    """Controllers of one case, before its label is known.

    Attributes:
        name: of the case.
        verdict: of its diagnosis.
        gains: controller ("default", or the model that it was tuned on) -> gains [SI].
        costs: model -> controller -> predicted cost.
    """

    name: str
    verdict: str
    gains: dict[str, Gains]
    costs: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Transferred:
    """A prediction and the outcome on the withheld robot: costs by controller (`real`), ids of faults (`truths`)."""

    prediction: Prediction
    kind: str
    truths: tuple[str, ...]
    real: dict[str, float]


@dataclass(frozen=True)
class Transfer:
    """A set: its cases in order, and those that failed with the reason."""

    cases: tuple[Transferred, ...]
    failed: dict[str, str]
    seed: int


def transfer(
    folder: str | Path,
    labels: str | Path,
    cases: int | None = None,
    jobs: int = 1,
    seed: int = 0,
    tuner: Tuner = by_cost,
    progress: Count = no_progress,
) -> Transfer:
    """Tune, predict, and then run on the withheld robots.

    Args:
        folder: set that was made and diagnosed.
        labels: labels file; it is not opened before all controllers are tuned.
        cases: number of cases, from the first; all without.
        jobs: as in `parallel.each`.
        seed: of the motions and of all noise.
        tuner: chooses the gains.
        progress: called with how many cases are tuned, have failed, and are wanted.

    Raises:
        InputError: a case without its robots, no case, labels that changed.
    """
    found, failed = predictions(find_cases(folder)[:cases], seed, tuner, jobs, progress)
    truths = read_labels(Path(folder), Path(labels))
    task = motion(seed, JUDGING)
    return Transfer(tuple(transferred(one, truths[one.name], task, seed) for one in found), failed, seed)


def predictions(
    folders: list[Path], seed: int, tuner: Tuner, jobs: int, progress: Count = no_progress
) -> tuple[list[Prediction], dict[str, str]]:
    """Predictions of the cases in order, and the reasons of those that failed."""
    for folder in folders:
        for name in (ANSWER, RETUNED, IMPROVED):
            if not (folder / name).is_file():
                raise InputError(f"{folder}: no {name}; `exodrake blind run` writes it (--redo for an older answer)")
    gains = tuner(load_robot(), motion(seed, TUNING), seed)  # the nominal robot is the same in every case
    found, failed = {}, {}
    progress(0, 0, len(folders))
    with closing(each(prediction, ((folder, seed, tuner, gains) for folder in folders), jobs)) as outcomes:
        for outcome in outcomes:
            if outcome.reason is None:
                found[outcome.number] = outcome.value
            else:
                failed[folders[outcome.number].name] = outcome.reason
            progress(len(found), len(failed), len(folders))
    return [found[number] for number in sorted(found)], failed


def prediction(folder: Path, seed: int, tuner: Tuner, nominal_gains: Gains) -> Prediction:
    """Tune on the robots of a case, and predict the cost of each controller by each of them."""
    robots = {
        "nominal": load_robot(),
        "retuned": load_robot(folder / RETUNED),
        "improved": load_robot(folder / IMPROVED),
    }
    verdict = read_diagnosis(folder / ANSWER)["verdict"]
    return predict(folder.name, verdict, robots, seed, tuner, nominal_gains)


def predict(
    name: str, verdict: str, robots: Mapping[str, Robot], seed: int, tuner: Tuner, nominal_gains: Gains
) -> Prediction:
    """Controllers tuned on robots by model name, and their costs on another motion by each model."""
    tuning, judging = motion(seed, TUNING), motion(seed, JUDGING)
    gains = {DEFAULT: own_gains(robots["nominal"]), "nominal": nominal_gains}
    gains |= {model: tuner(robots[model], tuning, seed) for model in MODELS if model not in gains}
    costs = {
        model: {controller: predicted(robot, values, judging, seed) for controller, values in gains.items()}
        for model, robot in robots.items()
    }
    return Prediction(name, verdict, gains, costs)


def withheld(name: str, label: Mapping[str, Any]) -> RobotSpec:
    """The robot of a case from its label. InputError for a label without parameters or with an unknown fault."""
    if "numbers" not in label:
        raise InputError(f"{name}: its label holds no parameters of the robot, so it cannot be built anew")
    for effect in label["effects"]:
        if effect["id"] not in ENTRIES:
            raise InputError(f"{name}: the reference simulator knows no fault {effect['id']!r}")
    effects = (
        InjectedFault(e["id"], tuple(e["wires"]), tuple(e["joints"]), dict(e["parameters"])) for e in label["effects"]
    )
    return RobotSpec({key: np.asarray(value) for key, value in label["numbers"].items()}, tuple(effects))


def real_cost(spec: RobotSpec, gains: Gains, task: Reference, seed: int) -> float:
    """Cost of a task on a robot of the reference simulator; infinite where it cannot be integrated."""
    changed = {REFERENCE_GAIN[name]: np.asarray(value) for name, value in gains.items()}
    try:
        columns = simulate(replace(spec, parameters=spec.parameters | changed), task, [seed, JUDGING])
    except InputError:
        return np.inf
    return cost(columns, task.values)


def transferred(found: Prediction, label: Mapping[str, Any], task: Reference, seed: int) -> Transferred:
    """Run the controllers of a case on its withheld robot."""
    spec = withheld(found.name, label)
    real = {controller: real_cost(spec, gains, task, seed) for controller, gains in found.gains.items()}
    return Transferred(found, label["kind"], tuple(effect["id"] for effect in label["effects"]), real)
