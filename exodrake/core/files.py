"""Files written whole or not at all, and read without a traceback."""

import contextlib
import os
from pathlib import Path

from exodrake.core.errors import InputError


def is_file(path: str | Path) -> bool:
    """True for a file that can be seen; False for a name too long, or a folder that may not be looked into."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: str | Path) -> bool:
    """The same for a folder."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


def read_bytes(path: str | Path) -> bytes:
    """Contents of a file. InputError naming the file if it is absent, a folder, or may not be read."""
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({_reason(error)})") from None


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file whole: into a temporary neighbour, flushed, then renamed over the target.

    A reader, or a crash half way, sees the old file or the new one. Pipes and devices are written directly, since
    renaming would replace them. InputError naming the file if the folder is absent or may not be written.
    """
    target = Path(path)
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(data)
            return
        _write_and_rename(target, data)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from None


def write_text(path: str | Path, text: str) -> None:
    """`write_bytes` of UTF-8 text."""
    write_bytes(path, text.encode())


def write_folder(folder: str | Path, contents: dict[str, bytes]) -> list[Path]:
    """Write files into a folder, made if absent, by `write_bytes`. InputError if it cannot be made or written."""
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{target}: cannot make this folder ({error.strerror})") from None
    for name, data in contents.items():
        write_bytes(target / name, data)
    return [target / name for name in contents]


def _write_and_rename(target: Path, data: bytes) -> None:
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with open(temporary, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
