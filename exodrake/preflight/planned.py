"""A case as an experiment that is planned: the logs that the nominal robot would give, with every signal in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.core.measured import Column
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.problem import Problem

FRAMES = 1500  # of the case that are simulated for each direction; they stand for all, so that a check takes seconds
SENSOR = 5e-4  # noise of a sensor not there yet, as a share of its signal's span: assumed, an encoder of 12 bits
EXTRA = "also"  # kind of the columns of such sensors


def planned(problem: Problem) -> Problem:
    """The problem as an experiment: logs that the nominal robot would give, with every signal in them."""
    machine, noise = problem.robot.machine, sensor_noise_std(problem.robot)
    shown = {c.signal for c in machine.columns if any(col.startswith(f"{c.kind}_") for col in problem.columns)}
    written = {name for part in machine.parts for output in part.outputs for name in output.writes}
    more = [s for s in machine.signals if s.name in written - shown]
    extra = tuple(Column(EXTRA + s.name.replace("_", ""), s.name, required=False) for s in more)
    wide = replace(machine, columns=machine.columns + extra, nominal=None)
    names = machine.log_names(extra)
    short = problem.shortened(min(1.0, FRAMES / sum(len(t.reference) for t in problem.fit)))
    every = replace(short, robot=replace(problem.robot, machine=wide), columns=(*problem.columns, *names), holdout=())
    values, trials = every.silent(), []
    for trial in short.fit:
        (logged,) = every.predict(values[None], trial)
        logged[:, : len(problem.columns)][np.isnan(trial.measured)] = np.nan
        trials.append(replace(trial, measured=logged))
    kinds = {c.signal: c.kind for c in machine.columns}
    span = np.max([np.ptp(np.nan_to_num(t.measured), axis=0) for t in trials], axis=0)
    levels = [noise.get(kinds.get(s.name, ""), 0.0) for s in more for _ in machine.axes.of(s.axis)]
    stated = np.where(np.array(levels) > 0.0, levels, SENSOR * span[len(problem.columns) :])
    keep = np.concatenate([np.ones(len(problem.columns), bool), (stated > 0.0) & np.isfinite(stated)])
    return replace(
        every,
        columns=tuple(c for c, k in zip(every.columns, keep, strict=True) if k),
        noise_std=np.concatenate([problem.noise_std, stated])[keep],
        fit=tuple(replace(t, measured=t.measured[:, keep]) for t in trials),
    )


def mask_of(problem: Problem, columns: np.ndarray) -> np.ndarray:
    """Samples (samples,) of some columns (columns,)."""
    return np.concatenate([np.tile(columns, len(trial.measured)) for trial in problem.fit])
