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

    record = {
        "format": FORMAT,
        "exodrake": __version__,
        "units": UNITS,
        "wires": estimator.wires,
        "joints": estimator.joints,
        "robot": estimator.robot,
        "logs": estimator.logs,
        "sweeps": estimator.sweeps,
        "kernel": estimator.kernel,
        "limit": estimator.limit,
        "notes": notes or {},
    }
    stream = io.BytesIO()
    arrays = {**estimator.weights._asdict(), **_strokes_arrays(estimator.strokes)}
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
    record, arrays = _read(path)
    if record.get("units") != UNITS:
        raise InputError(f"{path}: estimator in units {record.get('units')}, wanted {UNITS}")
    if robot is not None and record.get("robot") != robot:
        known = str(record.get("robot"))[:12] or "unknown"
        raise InputError(
            f"{path}: estimator trained for another robot (signature {known}, this robot's is {robot[:12]})"
        )
    try:
        estimator = Estimator(
            wires=tuple(record["wires"]),
            joints=tuple(record["joints"]),
            weights=Weights(*(np.ascontiguousarray(arrays[name], dtype=float) for name in Weights._fields)),
            limit=float(record["limit"]),
            robot=record["robot"],
            logs=tuple(record["logs"]),
            sweeps=int(record["sweeps"]),
            kernel=record["kernel"],
            strokes=_strokes(arrays, tuple(record["wires"])),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged estimator file ({error})") from None
    _check_shapes(estimator, path)
    return estimator


def _strokes_arrays(model: StrokeModel | None) -> dict[str, np.ndarray]:
    """Arrays of a model of the strokes, by name."""
    if model is None:
        return {}
    rows = model.rows
    parts = (rows.inputs, rows.angle, rows.sweep, rows.time, model.theta)
    return dict(zip(STROKES, parts, strict=True))


def _strokes(arrays: dict[str, np.ndarray], wires: tuple[str, ...]) -> StrokeModel | None:
    """Model of the strokes from its arrays; None in files without. ValueError for wrong shapes."""
    if STROKES[0] not in arrays:
        return None
    tension, stroke, sweep, time, theta = (np.asarray(arrays[name], dtype=float) for name in STROKES)
    wide, long = (len(sweep), len(wires)), (len(sweep),)
    kernel = sweep_kernel(len(wires))
    if (tension.shape, stroke.shape, time.shape, theta.shape) != (wide, wide, long, kernel.theta.shape):
        raise ValueError("arrays of the strokes have wrong shapes")
    if not all(np.isfinite(part).all() for part in (tension, stroke, sweep, time, theta)) or not len(sweep):
        raise ValueError("arrays of the strokes are not finite")
    return StrokeModel(Sweeps(tension, stroke, sweep.astype(int), time, wires, wires), theta)


def _read(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read record and arrays."""
    arrays = read_arrays(read_bytes(path), str(path))
    try:
        record = json.loads(str(arrays.pop("record")))
    except (ValueError, KeyError, RecursionError) as error:
        raise InputError(f"{path}: not an estimator file ({error})") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise InputError(f"{path}: not an estimator file of this version ({FORMAT!r})")
    return record, arrays


def _check_shapes(estimator: Estimator, path: str | Path) -> None:
    """Raise InputError unless the shapes of the arrays agree, which compiled code does not check."""
    inputs, joints = 2 * len(estimator.wires), len(estimator.joints)
    points = estimator.weights.alpha.shape[0]
    wanted: dict[str, tuple[int, ...]] = {
        "center": (inputs,),
        "rotation": (inputs, inputs),
        "points": (inputs, points),
        "shrink": (inputs,),
        "variances": (3,),
        "alpha": (points, joints),
        "factor": (points * (points + 1) // 2,),
        **dict.fromkeys(("offset", "gain", "spread"), (joints,)),
    }
    for name, shape in wanted.items():
        array = getattr(estimator.weights, name)
        if array.shape != shape or not np.isfinite(array).all():
            raise InputError(
                f"{path}: damaged estimator file ({name} has shape {array.shape}, wanted {shape}, all finite)"
            )


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
