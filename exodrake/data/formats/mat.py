"""MAT, for MATLAB and Octave: a variable (n, 1) per column, and a struct `units` with the SI unit of each, in order.

Version 7.3 is HDF5, which needs the extra `hdf5`.
"""

import io
import re
import warnings
from typing import Any

import numpy as np

from exodrake.core.errors import InputError, require_extra
from exodrake.data.formats import read_apart
from exodrake.data.log import Log, check_size, log_from_columns

ENDINGS = (".mat",)
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")
MAX_DEPTH = 20  # nested groups of HDF5; hard links may form a ring
MATLAB = "MATLAB_class"  # attribute of MATLAB's data sets, whose axes are turned round
HIDDEN = ("#refs#", "#subsystem#")  # where MATLAB keeps what its cells refer to


def read(data: bytes, source: str) -> Log:
    """Parse a MAT file that `write` made. InputError for a damaged file, no `units`, and what is no numeric vector."""
    variables = read_apart(parse, data, source)
    units = variables.get("units")
    if not isinstance(units, dict):
        raise InputError(f"{source}: no struct 'units' as a log has; use `exodrake import` with a mapping file")
    columns = []
    for name, unit in units.items():
        if name not in variables:
            raise InputError(f"{source}: column {name!r} has a unit but no values")
        array = np.asarray(variables[name])
        if array.dtype.kind not in "fiub" or array.ndim > 2 or (array.ndim == 2 and 1 not in array.shape):
            found = f"{array.dtype} of shape {array.shape}"
            raise InputError(f"{source}: variable {name!r} is {found}, wanted a vector of numbers")
        columns.append((f"{name} [{unit}]", array.ravel().astype(float)))
    return log_from_columns(columns, source)


def write(log: Log) -> bytes:
    """The log as MAT in SI. InputError for a column whose name is none in MATLAB."""
    from scipy.io import savemat

    columns, units = {"time": log.time, **log.signals}, {"time": "s", **log.units}
    for name in columns:
        if not NAME.fullmatch(name) or name == "units":
            raise InputError(f"{log.label}: column {name!r} cannot be a MATLAB variable")
    stream = io.BytesIO()
    savemat(stream, {**columns, "units": units}, oned_as="column", long_field_names=True, do_compression=True)
    return stream.getvalue()


def parse(data: bytes, source: str) -> dict[str, Any]:
    """Variables of a MAT file, HDF5 too: structs as mappings, cells as lists."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadWarning

    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Duplicate variable name")
            found = loadmat(io.BytesIO(data), squeeze_me=False, struct_as_record=False)
    except NotImplementedError:
        return parse_hdf5(data, source)
    except MatReadWarning as warning:
        raise InputError(f"{source}: variable {str(warning).split('"')[1]!r} comes twice") from None
    return {name: plain(value) for name, value in found.items() if not name.startswith("__")}


def plain(value: Any) -> Any:
    """A MATLAB value as mappings, lists, text and arrays."""
    if (fields := getattr(value, "_fieldnames", None)) is not None:
        return {name: plain(getattr(value, name)) for name in fields}
    if not isinstance(value, np.ndarray):
        return None if value.__class__.__module__.startswith("scipy") else value
    if value.dtype.kind == "U":
        return value.item() if value.size == 1 else value.ravel().tolist()
    if value.dtype.kind != "O":
        return value
    items = [plain(one) for one in value.ravel()]
    return items[0] if len(items) == 1 else items


def parse_hdf5(data: bytes, source: str) -> dict[str, Any]:
    """Groups of an HDF5 file as mappings, data sets of numbers as arrays; nothing that lies in another file."""
    with require_extra(f"{source}: HDF5 needs h5py; install exodrake[hdf5]"):
        import h5py  # pyright: ignore[reportMissingImports]
    samples = 0

    def count(more: int) -> None:
        nonlocal samples
        check_size(samples := samples + int(more), source)

    def read_group(group: Any, depth: int) -> dict[str, Any]:
        """The groups and data sets of a group, by name."""
        names = [n for n in group if n not in HIDDEN and isinstance(group.get(n, getlink=True), h5py.HardLink)]
        values = {name: read_value(group[name], depth + 1) for name in (names if depth < MAX_DEPTH else ())}
        return {name: value for name, value in values.items() if value is not None}

    def read_value(item: Any, depth: int) -> Any:
        """A group, an array of numbers, or a list of a MATLAB cell's contents; None for anything else."""
        if isinstance(item, h5py.Group):
            return read_group(item, depth)
        if not isinstance(item, h5py.Dataset) or item.is_virtual or item.external or item.shape is None:
            return None
        if item.dtype.names:
            count((item.size or 0) * len(item.dtype.names))
            table = item[()]
            return {name: table[name] for name in item.dtype.names if table[name].dtype.kind in "fiub"}
        if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
            count(item.size or 0)
            cells = (read_value(file[one], depth + 1) for one in item[()].T.ravel() if one and depth < MAX_DEPTH)
            return [cell for cell in cells if cell is not None]
        matlab = item.attrs.get(MATLAB)
        if item.dtype.kind not in "fiub" or matlab in (b"char", "char") or item.attrs.get("MATLAB_empty"):
            return None
        count(item.size or 0)
        values = np.asarray(item[()])
        return values.T if matlab is not None else values

    with h5py.File(io.BytesIO(data), "r") as file:
        return read_group(file, 0)
