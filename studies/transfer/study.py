"""What a controller gains from a diagnosis: controllers tuned on the models of a case run on the withheld robot.

For each case a controller is tuned on the nominal, the retuned and the improved robot; each of these models predicts
the cost of every controller on a motion that no controller was tuned on. Then the labels are read, the withheld robot
is built anew in the reference simulator, and every controller runs on it. Measures have intervals; tables and JSON hold
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import bootstrap, quantile_test, rankdata

from exodrake.core.errors import InputError, plural
from exodrake.core.parallel import each
from exodrake.core.plain import plain
from exodrake.core.progress import Count, no_progress
from exodrake.core.schema import read_json
from exodrake.diagnosis.many import IMPROVED, RETUNED, SCHEMA
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.reference.answers import ANSWER, find_cases, read_labels
from exodrake.reference.faults import ENTRIES
from exodrake.reference.robot import InjectedFault, RobotSpec
from exodrake.reference.score import Row, count_share
from exodrake.reference.simulator import simulate
from studies.transfer.control_task import Gains, Tuner, by_cost, cost, motion, own_gains, predicted

DEFAULT = "default"  # the controller as it is
MODELS = ("nominal", "retuned", "improved")
TUNING, JUDGING = 0, 1  # purposes of the two motions
RESAMPLES = 1000  # of cases, for the interval of the rank correlation
COSTS = ("case", "tuned on", "{}", ">predicted", ">real", ">change")
MEASURES = ("measure", "model", ">found", ">95 % interval", ">of")
REFERENCE_GAIN = {"controller.kp": "kp", "controller.kd": "kd"}  # names in the reference simulator


@dataclass(frozen=True)
class Prediction:
    """Controllers of one case, before its label is known."""

    name: str
    verdict: str
    gains: dict[str, Gains]  # controller ("default", or the model that it was tuned on) -> gains [SI]
    costs: dict[str, dict[str, float]]  # model -> controller -> predicted cost


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
    folder: str | Path, labels: str | Path, cases: int | None = None, jobs: int = 1, seed: int = 0,
    tuner: Tuner = by_cost, progress: Count = no_progress,
) -> Transfer:  # fmt: skip
    """Tune on the first cases of a diagnosed set, predict, and then run on the withheld robots; None: all cases.

    Labels are not opened before all controllers are tuned. The seed is that of the motions and of all noise.
    InputError for a case without its robots, no case, labels that changed.
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
    files = ("exo_index", folder / RETUNED, folder / IMPROVED)
    robots = dict(zip(MODELS, map(load_robot, files), strict=True))
    verdict = SCHEMA(read_json(folder / ANSWER), str(folder / ANSWER))["verdict"]
    tuning, judging = motion(seed, TUNING), motion(seed, JUDGING)
    gains = {DEFAULT: own_gains(robots["nominal"]), "nominal": nominal_gains}
    gains |= {model: tuner(robots[model], tuning, seed) for model in MODELS if model not in gains}
    costs = {
        model: {controller: predicted(robot, values, judging, seed) for controller, values in gains.items()}
        for model, robot in robots.items()
    }
    return Prediction(folder.name, verdict, gains, costs)


def withheld(name: str, label: Mapping[str, Any]) -> RobotSpec:
    """The robot of a case from its label. InputError for a label without parameters or with an unknown fault."""
    if "numbers" not in label:
        raise InputError(f"{name}: its label holds no parameters of the robot, so it cannot be built anew")
    for effect in label["effects"]:
        if effect["id"] not in ENTRIES:
            raise InputError(f"{name}: the reference simulator knows no fault {effect['id']!r}")
    effects = (InjectedFault(e["id"], (*e["wires"], *e["joints"]), dict(e["parameters"])) for e in label["effects"])
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


@dataclass(frozen=True)
class Measured:
    """A measure of one model over the cases: value, 95 % interval (NaN where there are too few cases), count."""

    name: str
    model: str
    value: float
    low: float
    high: float
    of: str
    percent: bool = True

    @property
    def row(self) -> Row:
        """Cells."""
        scale, unit, digits = (100.0, " %", 1) if self.percent else (1.0, "", 2)
        value, low, high = (f"{scale * x:.{digits}f}" if np.isfinite(x) else "-" for x in self.ends)
        interval = f"{low} to {high}{unit}" if "-" not in (low, high) else "-"
        return self.name, self.model, "-" if value == "-" else value + unit, interval, self.of

    @property
    def ends(self) -> tuple[float, float, float]:
        """Value and interval."""
        return self.value, self.low, self.high


def measures(found: Transfer) -> list[Measured]:
    """Measures of all models, one after another within each measure."""
    cases, change = found.cases, "real change of cost"
    rows = [rank_correlation(found, model) for model in MODELS]
    rows += [median("error of prediction, median", m, [prediction_error(case, m) for case in cases]) for m in MODELS]
    rows += [median(f"{change}, median", m, [relative(case, m) for case in cases]) for m in MODELS]
    worst = [max(relative(case, model) for case in cases) for model in MODELS]
    rows += [Measured(f"{change}, worst", m, w, np.nan, np.nan, str(len(cases))) for m, w in zip(MODELS, worst)]
    rows += [share("really better than default", model, found, DEFAULT) for model in MODELS]
    return rows + [share("really better than nominal's", model, found, "nominal") for model in MODELS[1:]]


def rank_correlation(found: Transfer, model: str) -> Measured:
    """Spearman's correlation of predicted and real cost over cases and controllers; its interval resamples cases."""
    cases = found.cases
    predicted = np.array([list(case.prediction.costs[model].values()) for case in cases])
    real = np.array([[case.real[name] for name in case.prediction.gains] for case in cases])

    def correlation(index: np.ndarray) -> float:
        a, b = predicted[index].ravel(), real[index].ravel()
        ranks = rankdata(a), rankdata(b)
        return float(np.corrcoef(*ranks)[0, 1]) if min(map(np.ptp, ranks)) > 0.0 else np.nan

    places, low, high = np.arange(len(cases)), np.nan, np.nan
    if len(cases) > 1:
        options = {"vectorized": False, "method": "percentile", "n_resamples": RESAMPLES}
        interval = bootstrap((places,), correlation, rng=np.random.default_rng(found.seed), **options)
        low, high = interval.confidence_interval
    name = "rank correlation"
    return Measured(name, model, correlation(places), low, high, f"{predicted.size} runs", percent=False)


def prediction_error(case: Transferred, model: str) -> float:
    """Error of the predicted cost relative to the real one, mean over the controllers of a case."""
    costs = case.prediction.costs[model]
    return float(np.mean([abs(costs[name] / case.real[name] - 1.0) for name in costs]))


def relative(case: Transferred, model: str) -> float:
    """Change of the real cost, relative to that of the default controller."""
    return case.real[model] / case.real[DEFAULT] - 1.0


def median(name: str, model: str, values: Sequence[float]) -> Measured:
    """Median over cases with its exact interval by order statistics."""
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return Measured(name, model, float(np.median(values)), float(low), float(high), str(len(values)))


def share(name: str, model: str, found: Transfer, other: str) -> Measured:
    """Share of cases in which one controller really costs less than another, with its exact interval."""
    won = count_share({case.prediction.name: case.real[model] < case.real[other] for case in found.cases})
    return Measured(name, model, won.value, won.low, won.high, f"{won.hits}/{won.total}")


def tables(found: Transfer) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table."""
    title = f"controllers tuned on diagnosed models, {len(found.cases)} {plural(len(found.cases), 'case')}"
    yield title, MEASURES, [measured.row for measured in measures(found)]
    gains = ", ".join(name.split(".")[-1] for name in found.cases[0].prediction.gains[DEFAULT]) if found.cases else ""
    headings = tuple(heading.format(gains) for heading in COSTS)
    yield "controllers by case", headings, [row for case in found.cases for row in case_rows(case)]


def case_rows(case: Transferred) -> Iterator[Row]:
    """A row for each controller: cost predicted by its own model (the default's by the nominal one), and real cost."""
    prediction, truth = case.prediction, " + ".join(case.truths) or case.kind
    notes = (prediction.name, truth, prediction.verdict, "")
    for note, (controller, gains) in zip(notes, prediction.gains.items(), strict=True):
        predicted = prediction.costs["nominal" if controller == DEFAULT else controller][controller]
        shown = ", ".join(f"{value:.3g}" for value in gains.values())
        changed = "" if controller == DEFAULT else f"{100 * relative(case, controller):+.1f} %"
        yield note, controller, shown, f"{predicted:.4f}", f"{case.real[controller]:.4f}", changed


def as_json(found: Transfer) -> dict[str, Any]:
    """Plain data: measures, and each case with its gains [SI], predicted and real costs."""
    measured = [vars(item) for item in measures(found)]
    cases = {
        case.prediction.name: {
            "kind": case.kind, "truth": case.truths, "verdict": case.prediction.verdict, "gains": case.prediction.gains,
            "predicted": case.prediction.costs, "real": case.real,
        }
        for case in found.cases
    }  # fmt: skip
    return plain({"seed": found.seed, "measures": measured, "cases": cases, "failed": found.failed})
