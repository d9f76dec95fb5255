"""HDF5, and MAT files of version 7.3, which are HDF5. Needs the extra `hdf5`.

Only what lies in the file itself is read: external links, external storage and virtual data sets are left out.
"""

import io
from typing import Any

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.data.log import MAX_SAMPLES, check_size

MAX_DEPTH = 20  # nested groups; hard links may form a ring
MATLAB = "MATLAB_class"  # attribute of MATLAB's data sets, whose axes are turned round
HIDDEN = ("#refs#", "#subsystem#")  # where MATLAB keeps what its cells refer to


def read_hdf5(data: bytes, source: str) -> dict[str, Any]:
    """Groups as mappings, data sets of numbers as arrays. InputError for a damaged file."""
    return in_child(parse, data, source, source=source, size=len(data))


def parse(data: bytes, source: str) -> dict[str, Any]:
    """`read_hdf5` in this process."""
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(f"{source}: HDF5 needs h5py; install exodrake[hdf5]") from None
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return Reader(h5py, file, source).group(file, 0)
    except InputError:
        raise
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        raise InputError(f"{source}: not a whole HDF5 file ({type(error).__name__})") from None


class Reader:
    """Walks a file and counts the samples that it reads."""

    def __init__(self, h5py: Any, file: Any, source: str) -> None:
        self.h5py, self.file, self.source, self.samples = h5py, file, source, 0

    def group(self, group: Any, depth: int) -> dict[str, Any]:
        """The groups and data sets of a group, by name."""
        found: dict[str, Any] = {}
        for name in group if depth < MAX_DEPTH else ():
            if name in HIDDEN or not isinstance(group.get(name, getlink=True), self.h5py.HardLink):
                continue
            value = self.value(group[name], depth + 1)
            if value is not None:
                found[name] = value
        return found

    def value(self, item: Any, depth: int) -> Any:
        """A group, an array of numbers, or a list of a MATLAB cell's contents; None for anything else."""
        if isinstance(item, self.h5py.Group):
            return self.group(item, depth)
        if not isinstance(item, self.h5py.Dataset) or item.is_virtual or item.external or item.shape is None:
            return None
        if item.dtype.names:
            self.count(item.size * len(item.dtype.names))
            table = item[()]
            return {name: table[name] for name in item.dtype.names if table[name].dtype.kind in "fiub"}
        if self.h5py.check_ref_dtype(item.dtype) is self.h5py.Reference:
            self.count(item.size)
            cells = (self.value(self.file[one], depth + 1) for one in item[()].T.ravel() if one and depth < MAX_DEPTH)
            return [cell for cell in cells if cell is not None]
        matlab = item.attrs.get(MATLAB)
        if item.dtype.kind not in "fiub" or matlab in (b"char", "char") or item.attrs.get("MATLAB_empty"):
            return None
        self.count(item.size)
        values = np.asarray(item[()])
        return values.T if matlab is not None else values

    def count(self, samples: int) -> None:
        """InputError for a file that would fill the memory."""
        self.samples += int(samples)
        if self.samples > MAX_SAMPLES:
            check_size(self.samples, self.source)
