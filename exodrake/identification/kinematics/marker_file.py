"""Marker recordings from C3D or CSV files."""

from __future__ import annotations

from pathlib import Path

from exodrake.core.files import read_bytes
from exodrake.identification.kinematics.markers import Recording, parse_csv


def read_markers(path: str | Path) -> Recording:
    """Read a `.c3d` file, or CSV under any other name. InputError names the file, and column and row if known."""
    if Path(path).suffix.lower() == ".c3d":
        from exodrake.identification.kinematics.c3d import read_c3d

        return read_c3d(path)
    return parse_csv(read_bytes(path), str(path))
