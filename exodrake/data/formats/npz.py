"""NPZ: one float64 array (n,) per column, its key the heading `tension_AF [N]`.

Read in this process, unlike the other binary formats: NumPy refuses pickles and checks lengths and checksums, and what
it may allocate is bounded (0.5 GB at most, where the child process costs each command 0.3 s).
"""

import io
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import Log, check_size, headings, log_from_columns, refuse_doubled

ENDINGS = (".npz",)
SAMPLE = 8  # bytes


def read(data: bytes, source: str) -> Log:
    """Parse an NPZ log. InputError for a damaged file, pickled objects, text, arrays not (n,) or unequal in length."""
    arrays = read_arrays(data, source)
    for name, values in arrays.items():
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            found = f"{values.dtype} of shape {values.shape}"
            raise InputError(f"{source}: column {name!r} is {found}, wanted numbers (n,)")
    return log_from_columns(((name, values.astype(float)) for name, values in arrays.items()), source)


def read_arrays(data: bytes, source: str) -> dict[str, np.ndarray]:
    """Arrays of an NPZ file by name, or the one of an NPY file under "". InputError for a damaged or too large file."""
    try:
        loaded = np.load(io.BytesIO(data), allow_pickle=False)
        if not isinstance(loaded, np.ndarray):
            check_size(sum(item.file_size for item in loaded.zip.infolist()) // SAMPLE, source)
            refuse_doubled((item.filename.removesuffix(".npy") for item in loaded.zip.infolist()), source)
        arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
        check_size(sum(array.size for array in arrays.values()), source)  # items of a byte or of none are many
        return arrays
    except InputError:
        raise
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        known = data.startswith((b"PK", b"\x93NUMPY"))  # else NumPy takes the file for a pickle
        reason = (str(error) or type(error).__name__).splitlines()[0] if known else "it does not begin as one"
        raise InputError(f"{source}: not a whole NumPy file of numbers ({reason})") from None


def write(log: Log) -> bytes:
    """The log as compressed NPZ in SI."""
    stream = io.BytesIO()
    arrays: dict[str, Any] = dict(zip(headings(log), [log.time, *log.signals.values()], strict=True))
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()
