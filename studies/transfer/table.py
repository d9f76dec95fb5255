"""Predicted against real cost of the controllers of a set: measures with their intervals, as tables and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.plain import plain
from exodrake.reference.score import Row, Share, count_cases
from studies.transfer.study import DEFAULT, MODELS, Transfer, Transferred

RESAMPLES = 1000  # of cases, for the interval of the rank correlation
COSTS = ("case", "tuned on", "{}", ">predicted", ">real", ">change")
MEASURES = ("measure", "model", ">found", ">95 % interval", ">of")


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
    rows = []
    for measure in (rank_correlation, prediction_error, change, worst_change, better, better_than_nominal):
        rows += [measure(found, model) for model in MODELS if measure is not better_than_nominal or model != "nominal"]
    return rows


def rank_correlation(found: Transfer, model: str) -> Measured:
    """Spearman's correlation of predicted and real cost over cases and controllers; its interval resamples cases."""
    from scipy.stats import bootstrap, rankdata

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


def prediction_error(found: Transfer, model: str) -> Measured:
    """Median error of the predicted cost relative to the real one, over the controllers of a case first."""

    def error(case: Transferred) -> float:
        costs = case.prediction.costs[model]
        return float(np.mean([abs(costs[name] / case.real[name] - 1.0) for name in costs]))

    return median("error of prediction, median", model, found.cases, error)


def change(found: Transfer, model: str) -> Measured:
    """Median change of the real cost from the default controller to the one tuned on the model."""
    return median("real change of cost, median", model, found.cases, lambda c: relative(c, model))


def worst_change(found: Transfer, model: str) -> Measured:
    """Largest real change of the cost over all cases."""
    changes = [relative(case, model) for case in found.cases]
    return Measured("real change of cost, worst", model, max(changes), np.nan, np.nan, str(len(changes)))


def relative(case: Transferred, model: str) -> float:
    """Change of the real cost, relative to that of the default controller."""
    return case.real[model] / case.real[DEFAULT] - 1.0


def median(name: str, model: str, cases: Sequence[Transferred], value: Callable[[Transferred], float]) -> Measured:
    """Median over cases with its exact interval by order statistics."""
    from scipy.stats import quantile_test

    values = np.array([value(case) for case in cases])
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return Measured(name, model, float(np.median(values)), float(low), float(high), str(len(values)))


def better(found: Transfer, model: str) -> Measured:
    """Share of cases in which the tuned controller really costs less than the default one."""
    return share("really better than default", model, found, DEFAULT)


def better_than_nominal(found: Transfer, model: str) -> Measured:
    """Share of cases in which the tuned controller really costs less than the one tuned on the nominal robot."""
    return share("really better than nominal's", model, found, "nominal")


def share(name: str, model: str, found: Transfer, other: str) -> Measured:
    """Share of cases in which one controller really costs less than another, with its exact interval."""
    outcomes = Share(name, {case.prediction.name: case.real[model] < case.real[other] for case in found.cases})
    return Measured(name, model, outcomes.value, *outcomes.interval, f"{outcomes.hits}/{outcomes.total}")


def tables(found: Transfer) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table."""
    title = f"controllers tuned on diagnosed models, {count_cases(len(found.cases))}"
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
