"""Generated code as modules: files in a cache folder, beside which numba keeps their machine code."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from types import ModuleType

_loaded: dict[str, ModuleType] = {}


def cache_folder() -> Path:
    """Where generated modules and their machine code live: EXODRAKE_CACHE, else the user's cache folder."""
    if stated := os.environ.get("EXODRAKE_CACHE"):
        return Path(stated)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exodrake"


def load_text(stem: str, text: str) -> ModuleType:
    """Imports generated code; machine code comes from numba's cache when this text was compiled before.

    Args:
        stem: first part of the file name; a hash of the text follows.
        text: the source.
    """
    name = f"{stem}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if name not in _loaded:
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # idle threads sleep, and leave their core to other work
        spec = importlib.util.spec_from_file_location(f"exodrake_generated_{name}", source_file(name, text))
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # numba loads cached code by this name
        spec.loader.exec_module(module)
        _loaded[name] = module
    return _loaded[name]


def source_file(name: str, text: str) -> Path:
    """The file of that text, in the cache folder or, where that cannot be written, in a temporary one."""
    try:
        return write_if_different(cache_folder() / f"{name}.py", text)
    except OSError as error:
        return write_if_different(temporary_folder(str(error)) / f"{name}.py", text)


def write_if_different(path: Path, text: str) -> Path:
    """Writes a file whole, unless it holds this text already."""
    if not path.exists() or path.read_bytes() != text.encode():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}.part")
        part.write_bytes(text.encode())
        part.replace(path)
    return path


@cache
def temporary_folder(reason: str) -> Path:
    """A folder for this process; says once why."""
    print(f"exodrake: compiled code is kept for this run only, the cache cannot be used: {reason}", file=sys.stderr)
    return Path(tempfile.mkdtemp(prefix="exodrake-"))
