"""Speed of the estimator's training and prediction on one thread, on a smooth synthetic map."""

from time import perf_counter

import numpy as np

from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.gp import POINTS, fit
from exodrake.physics.gp_estimator import predict_into, scratch

SAMPLES = 20_000


def rows() -> list[tuple[str, float, str]]:
    """Measure training and the prediction of one sample (median, 99th percentile) as (name, value, unit)."""
    sweeps = _synthetic(np.random.default_rng(0))
    began = perf_counter()
    estimator = fit(sweeps)
    trained = perf_counter() - began
    weights, work = estimator.weights, scratch(estimator.weights)
    tension, stroke, mean, std = sweeps.tension, sweeps.stroke, np.empty(3), np.empty(3)
    predict_into(tension[0], stroke[0], weights, work, mean, std)  # compiles
    spent = np.empty(SAMPLES)
    for sample in range(SAMPLES):
        row = sample % len(sweeps)
        began = perf_counter()
        predict_into(tension[row], stroke[row], weights, work, mean, std)
        spent[sample] = perf_counter() - began
    return [
        (f"estimator: training, {POINTS} points", trained, "s"),
        (f"estimator: one sample, {POINTS} points, median", 1e6 * float(np.median(spent)), "us"),
        (f"estimator: one sample, {POINTS} points, 99th percentile", 1e6 * float(np.quantile(spent, 0.99)), "us"),
    ]


def _synthetic(rng: np.random.Generator, sweeps: int = 24, length: int = 100) -> Sweeps:
    """Draw tensions that ramp up and down, strokes and angles smooth in them, an offset per sweep and noise."""
    sweep = np.repeat(np.arange(sweeps), length)
    ramp = np.tile(1 - np.abs(np.linspace(-1, 1, length)), sweeps)
    tension = 8 * rng.uniform(size=(sweeps, 3))[sweep]
    tension[np.arange(len(sweep)), sweep % 3] = 8 * ramp
    mixed = tension @ rng.normal(size=(3, 3)) / 8
    angle = np.tanh(mixed) + 0.02 * rng.normal(size=(sweeps, 3))[sweep] + 0.003 * rng.normal(size=tension.shape)
    stroke = 5e-3 * np.tanh(mixed) @ rng.normal(size=(3, 3)) + 1e-5 * rng.normal(size=tension.shape)
    time = 0.02 * np.arange(len(sweep))
    return Sweeps(np.hstack([tension, stroke]), angle, sweep, time, ("AF", "MF", "AE"), ("MCP", "PIP", "DIP"))
