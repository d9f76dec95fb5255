"""Files written whole or not at all, and read without a traceback."""

import contextlib
import hashlib
import os
import shutil
import stat
import tempfile
from pathlib import Path

from exodrake.core.errors import InputError

is_file, is_folder = os.path.isfile, os.path.isdir  # False for what the system refuses: a name too long, a null byte
MAX_BYTES = 500_000_000  # assumed; an hour of 30 columns at 50 Hz takes 100 MB as text, the largest kind of file


def read_bytes(path: str | Path) -> bytes:
    """Contents of a regular file. InputError naming the file if it is absent, no such, too large or not to be read."""
    refuse_special(path)
    try:
        with open(path, "rb") as stream:
            return limit_size(stream.read(MAX_BYTES + 1), path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)})") from None


def hash_file(path: str | Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits. InputError as `read_bytes`."""
    return hashlib.sha256(read_bytes(path)).hexdigest()


def refuse_special(path: str | Path) -> None:
    """InputError for a pipe or device, which may have no end."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise InputError(f"{path}: a pipe or device, wanted a file")


def limit_size(data: bytes, source: str | Path) -> bytes:
    """The data; InputError naming their source if they are more than MAX_BYTES."""
    if len(data) > MAX_BYTES:
        raise InputError(f"{source}: larger than {MAX_BYTES / 1e6:g} MB, and not read")
    return data


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file whole: into a temporary neighbour, flushed, then renamed over the target.

    A reader, or a crash half way, sees the old file or the new one. Pipes and devices are written directly, since
    renaming would replace them. InputError naming the file if the folder is absent or may not be written.
    """
    target = Path(path)
    try:
        (Path.write_bytes if target.exists() and not target.is_file() else write_whole)(target, data)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from None


def write_whole(target: Path, data: bytes) -> None:
    """`write_bytes` of a regular file; OSError if it cannot be written."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        _write_and_flush(temporary, data)
        os.replace(temporary, target)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_text(path: str | Path, text: str) -> None:
    """`write_bytes` of UTF-8 text."""
    write_bytes(path, text.encode())


def make_folder(folder: str | Path) -> None:
    """Make a folder, and those above it. InputError if that cannot be."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: cannot be made ({_reason(error)})") from None


def check_folder(folder: Path) -> None:
    """InputError unless the folder is one, or can be made, and takes files."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a file, wanted a folder")
    there = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        tempfile.TemporaryFile(dir=there).close()  # modes do not say what /proc refuses
    except OSError:
        raise InputError(f"{there}: takes no files") from None


def write_folder(folder: str | Path, contents: dict[str, bytes]) -> list[Path]:
    """Write files into a folder together; a new one appears with all of them or not at all. InputError if it cannot."""
    target = Path(folder)
    there = target.exists()
    part = (target if there else target.parent) / f".{target.name}.{os.getpid()}.part"
    try:
        part.mkdir(parents=True)
        for name, data in contents.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            _write_and_flush(part / name, data)
        if not there:
            part.replace(target)
        for name in contents if there else ():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(part / name, target / name)
    except (OSError, ValueError) as error:
        raise InputError(f"{target}: cannot be written ({_reason(error)})") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return [target / name for name in contents]


def _write_and_flush(path: Path, data: bytes) -> None:
    with open(path, "wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
