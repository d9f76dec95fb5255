"""CSV, gzipped."""

import gzip
import io
import zlib

from exodrake.core.errors import InputError
from exodrake.core.files import MAX_BYTES, limited
from exodrake.data.formats import csv
from exodrake.data.log import Log

ENDINGS = (".csv.gz",)


def read(data: bytes, source: str) -> Log:
    """Read a compressed CSV as `csv.read` does. InputError for a file that is no gzip or is cut short."""
    return csv.read(unpack(data, source), source)


def unpack(data: bytes, source: str) -> bytes:
    """Gunzipped bytes. InputError for more of them than a file may have."""
    try:
        with gzip.open(io.BytesIO(data)) as stream:
            return limited(stream.read(MAX_BYTES + 1), source)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{source}: not a whole gzip file ({error})") from None


def write(log: Log) -> bytes:
    """Compress the text of `csv.write`. No time stamp inside, so the same log gives the same bytes."""
    return gzip.compress(csv.write(log), compresslevel=6, mtime=0)
