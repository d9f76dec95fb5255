"""NPZ: one float64 array (n,) per column, its key the heading `tension_AF [N]`."""

import io
import zipfile
import zlib
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.columns import headings, log_from_columns
from exodrake.data.log import Log

ENDINGS = (".npz",)


def read(data: bytes, source: str) -> Log:
    """Parse an NPZ log. InputError for a damaged file, pickled objects, text, arrays not (n,) or unequal in length."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, KeyError, AttributeError, TypeError, SyntaxError, MemoryError) as error:
        raise InputError(f"{source}: not a whole NPZ file of numbers ({_first_line(error)})") from None
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{source}: not a whole NPZ file ({_first_line(error)})") from None
    for name, values in arrays.items():
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            raise InputError(
                f"{source}: column {name!r} is {values.dtype} of shape {values.shape}, wanted numbers (n,)"
            )
    return log_from_columns(((name, values.astype(float)) for name, values in arrays.items()), source)


def write(log: Log) -> bytes:
    """The log as compressed NPZ in SI."""
    stream = io.BytesIO()
    arrays: dict[str, Any] = dict(zip(headings(log), [log.time, *log.signals.values()], strict=True))
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
