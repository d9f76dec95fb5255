"""C3D files, the exchange format of motion capture, read and written by ezc3d.

Labels may carry a subject (`Kim:B1` is read as B1). POINT:UNITS gives the unit and POINT:RATE the frame rate. A point
with a negative residual is missing.
"""

import os
import struct
import tempfile
from pathlib import Path

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.units import si_unit, to_si
from exodrake.identification.kinematics.markers import Recording, checked

BIG_ENDIAN = 86  # number of the processor that wrote the file: MIPS
BLOCK = 512  # bytes


def read_c3d(path: str | Path) -> Recording:
    """Read the points of a C3D file. InputError for another format, or missing points, rate or unit of length.

    A file that crashes ezc3d, holds it for ever or lacks frames that its header promises is refused, too.
    """
    data = read_bytes(path)
    return in_child(parse, os.fspath(path), frames_of(data), source=str(path), size=len(data))


def frames_of(data: bytes) -> int:
    """Number of frames that the header promises; the format counts to 65535. 0 of a file too short for a header."""
    mark = BLOCK * (data[0] - 1) + 3 if data else 0
    if mark < 0 or len(data) <= max(mark, BLOCK):
        return 0
    first, last = struct.unpack_from(">HH" if data[mark] == BIG_ENDIAN else "<HH", data, 6)
    return last - first + 1


def parse(path: str, frames: int) -> Recording:
    """`read_c3d` in this process; frames: how many there have to be at least."""
    import ezc3d

    try:
        content = ezc3d.c3d(path)
    except Exception as error:  # ezc3d raises bare C++ exceptions of several kinds
        raise InputError(f"{path}: not a C3D file ({error})") from None
    settings = content["parameters"]["POINT"]
    names = tuple(label.rsplit(":", 1)[-1].strip() for label in settings["LABELS"]["value"])
    points = np.moveaxis(content["data"]["points"][:3], 0, 2).swapaxes(0, 1)
    rate = float(np.ravel(settings["RATE"]["value"])[0]) if len(np.ravel(settings["RATE"]["value"])) else 0.0
    if len(points) < frames:
        raise InputError(f"{path}: {len(points)} frames, but its header promises {frames}: it is cut short")
    if not names or len(points) == 0 or rate <= 0:
        raise InputError(f"{path}: no points, or no frame rate")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}: two points are called {twice}")
    unit = (list(settings["UNITS"]["value"]) or [""])[0]
    if si_unit(unit, f"{path}, POINT:UNITS") != "m":
        raise InputError(f"{path}: POINT:UNITS is [{unit}], not a length")
    points = np.where(_unseen(content, points), np.nan, points)
    return checked(Recording(names, np.arange(len(points)) / rate, to_si(points[:, : len(names)], unit), str(path)))


def c3d_bytes(recording: Recording) -> bytes:
    """Encode a recording as a C3D file in mm, in the single precision of the format."""
    import ezc3d

    content = ezc3d.c3d()
    frames, count, _ = recording.positions.shape
    points = np.full((4, count, frames), np.nan)
    points[:3] = 1e3 * np.transpose(recording.positions, (2, 1, 0))
    points[3] = 1.0
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["parameters"]["POINT"]["RATE"]["value"] = [float(1 / np.median(np.diff(recording.time)))]
    content["parameters"]["POINT"]["LABELS"]["value"] = list(recording.names)
    content["data"]["points"] = points
    with tempfile.TemporaryDirectory() as folder:
        name = Path(folder) / "recording.c3d"
        content.write(str(name))
        return name.read_bytes()


def _unseen(content, points: np.ndarray) -> np.ndarray:
    """Mask (frames, points, 1) of negative residuals; ezc3d returns NaN for most of them."""
    residuals = content["data"]["meta_points"]["residuals"]
    if residuals.shape[1:] != points.shape[1::-1]:
        return np.zeros((*points.shape[:2], 1), dtype=bool)
    return (residuals[0].T < 0)[:, :, None]
