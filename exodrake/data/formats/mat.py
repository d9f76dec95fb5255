"""MAT, for MATLAB and Octave: a variable (n, 1) per column, and a struct `units` with the SI unit of each, in order."""

import io
import re
import warnings
from typing import Any

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.data.log import Log, heading, log_from_columns

ENDINGS = (".mat",)
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")


def read(data: bytes, source: str) -> Log:
    """Parse a MAT file that `write` made. InputError for a damaged file or one without `units`."""
    variables = read_variables(data, source)
    units = variables.get("units")
    if not isinstance(units, dict):
        raise InputError(f"{source}: no struct 'units' as a log has; use `exodrake import` with a mapping file")
    columns = []
    for name, unit in units.items():
        if name not in variables:
            raise InputError(f"{source}: column {name!r} has a unit but no values")
        columns.append((heading(name, str(unit)), column(variables[name], name, source)))
    return log_from_columns(columns, source)


def write(log: Log) -> bytes:
    """The log as MAT in SI. InputError for a column whose name is none in MATLAB."""
    from scipy.io import savemat

    columns = {"time": log.time, **log.signals}
    units = {"time": "s", **log.units}
    for name in columns:
        if not NAME.fullmatch(name) or name == "units":
            raise InputError(f"{log.label}: column {name!r} cannot be a MATLAB variable")
    stream = io.BytesIO()
    savemat(stream, {**columns, "units": units}, oned_as="column", long_field_names=True, do_compression=True)
    return stream.getvalue()


def read_variables(data: bytes, source: str) -> dict[str, Any]:
    """Variables of a MAT file: structs as mappings, arrays of structs and cells as lists. Version 7.3 is HDF5.

    InputError for a damaged file, even one that crashes SciPy's reader.
    """
    return in_child(parse, data, source, source=source, size=len(data))


def parse(data: bytes, source: str) -> dict[str, Any]:
    """`read_variables` in this process."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadWarning

    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Duplicate variable name")
            found = loadmat(io.BytesIO(data), squeeze_me=False, struct_as_record=False)
        return {name: plain(value) for name, value in found.items() if not name.startswith("__")}
    except NotImplementedError:
        from exodrake.data.hdf5 import parse as parse_hdf5

        return parse_hdf5(data, source)
    except MatReadWarning as warning:
        raise InputError(f"{source}: variable {str(warning).split('"')[1]!r} comes twice") from None
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        raise InputError(f"{source}: not a whole MAT file ({type(error).__name__})") from None


def plain(value: Any) -> Any:
    """A MATLAB value as mappings, lists, text and arrays."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        return {name: plain(getattr(value, name)) for name in fields}
    if not isinstance(value, np.ndarray):
        return None if value.__class__.__module__.startswith("scipy") else value
    if value.dtype.kind == "U":
        return value.item() if value.size == 1 else value.ravel().tolist()
    if value.dtype.kind != "O":
        return value
    items = [plain(one) for one in value.ravel()]
    return items[0] if len(items) == 1 else items


def column(values: object, name: str, source: str) -> np.ndarray:
    """A variable as (n,) float64. InputError unless it is a real numeric vector."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiub" or array.ndim > 2 or (array.ndim == 2 and 1 not in array.shape):
        raise InputError(
            f"{source}: variable {name!r} is {array.dtype} of shape {array.shape}, wanted a vector of numbers"
        )
    return array.ravel().astype(float)
