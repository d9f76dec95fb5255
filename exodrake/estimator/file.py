"""Estimator files: arrays and one JSON record in an .npz, without pickle, written whole or not at all.

The record names wires, joints, units, training logs and the robot. An estimator is refused for a log of other wires or
joints, and for a robot file of another signature. `quick_estimator` trains one on some simulated sweeps.
"""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes, write_bytes
from exodrake.core.provenance import robot_digest
from exodrake.core.robot import Robot
from exodrake.data.formats.npz import read_arrays
from exodrake.estimator.dataset import Sweeps, sweeps_from_logs
from exodrake.estimator.gp import Estimator, StrokeModel, fit, sweep_kernel
from exodrake.physics.gp_estimator import Weights

FORMAT = "exodrake estimator 1"
STROKES = ("strokes_tension", "strokes_stroke", "strokes_sweep", "strokes_time", "strokes_theta")
QUICK_POINTS = 250  # of a quick estimator: some s of training
UNITS = {"tension": "N", "stroke": "m", "angle": "rad", "time": "s"}


def save(estimator: Estimator, path: str | Path, notes: dict[str, Any] | None = None) -> None:
    """Write an estimator (.npz). InputError if it cannot be written.

    Args:
        estimator: The estimator.
        path: File to write.
        notes: Additions to the record, such as validation errors.
    """
    from exodrake import __version__

    kept = ("wires", "joints", "robot", "logs", "sweeps", "kernel", "limit")
    record = {"format": FORMAT, "exodrake": __version__, "units": UNITS, "notes": notes or {}}
    record |= {name: getattr(estimator, name) for name in kept}
    arrays = estimator.weights._asdict()
    if model := estimator.strokes:
        rows = model.rows
        arrays |= zip(STROKES, (rows.inputs, rows.angle, rows.sweep, rows.time, model.theta), strict=True)
    stream = io.BytesIO()
    np.savez(stream, record=np.array(json.dumps(record)), **arrays)
    write_bytes(path, stream.getvalue())


def load(path: str | Path, robot: str | None = None) -> Estimator:
    """Read an estimator.

    Args:
        path: File to read.
        robot: Signature that the file must carry, or None for any.

    Raises:
        InputError: Naming the file, if it is not an estimator, is damaged, has unknown units, or belongs to another
            robot.
    """
    arrays = read_arrays(read_bytes(path), str(path))
    try:
        record = json.loads(str(arrays.pop("record")))
    except (ValueError, KeyError, RecursionError) as error:
        raise InputError(f"{path}: not an estimator file ({error})") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"{path}: not an estimator file of this version ({FORMAT!r})")
    if record.get("units") != UNITS:
        raise InputError(f"{path}: estimator in units {record.get('units')}, wanted {UNITS}")
    if robot is not None and record.get("robot") != robot:
        known = str(record.get("robot"))[:12] or "unknown"
        raise InputError(
            f"{path}: estimator trained for another robot (signature {known}, this robot's is {robot[:12]})"
        )
    try:
        wires, joints, logs = (tuple(record[name]) for name in ("wires", "joints", "logs"))
        # compiled code does not check the shapes
        inputs, points = 2 * len(wires), len(arrays["alpha"])
        shapes = {
            "center": (inputs,), "rotation": (inputs, inputs), "points": (inputs, points), "shrink": (inputs,),
            "variances": (3,), "alpha": (points, len(joints)), "factor": (points * (points + 1) // 2,),
            "offset": (len(joints),), "gain": (len(joints),), "spread": (len(joints),),
        }  # fmt: skip
        weights = Weights(**{name: _array(arrays, name, shape) for name, shape in shapes.items()})
        strokes = None
        if STROKES[0] in arrays:  # not in files of earlier versions
            rows = len(arrays["strokes_sweep"])
            wide, theta = (rows, len(wires)), sweep_kernel(len(wires)).theta.shape
            shapes = dict(zip(STROKES, (wide, wide, (rows,), (rows,), theta), strict=True))
            tension, stroke, sweep, time, theta = (_array(arrays, name, shape) for name, shape in shapes.items())
            strokes = StrokeModel(Sweeps(tension, stroke, sweep.astype(int), time, wires, wires), theta)
        return Estimator(
            wires, joints, weights, float(record["limit"]), record["robot"], logs, int(record["sweeps"]),
            record["kernel"], strokes,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged estimator file ({error})") from None


def _array(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Array of a file. ValueError for another shape, for none of anything, and for numbers that are not finite."""
    array = np.ascontiguousarray(arrays[name], dtype=float)
    if array.shape != shape or not array.size or not np.isfinite(array).all():
        raise ValueError(f"{name} has shape {array.shape}, wanted {shape}, all finite")
    return array


def quick_estimator(robot: Robot, cache: Path | None = None) -> Estimator:
    """An estimator trained on simulated sweeps, or the one kept in a file.

    Args:
        robot: to be simulated; it should have no effects.
        cache: file of an estimator. It is used if it belongs to the same robot; it is never written.
    """
    from exodrake.simulation.protocols import sweeps
    from exodrake.simulation.simulate import simulate

    if cache is not None and cache.is_file():
        try:
            return load(cache, robot_digest(robot))
        except InputError:
            pass
    training = sweeps_from_logs([simulate(robot, sweeps(robot), seed=0)])
    return replace(fit(training, QUICK_POINTS), robot=robot_digest(robot))
