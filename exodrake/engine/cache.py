"""Generated code as modules: files in a cache folder, beside which numba keeps their machine code."""

import hashlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

from exodrake.core.files import write_whole

CACHED = "cache=True"  # in generated code
MAKING = RLock()  # of the values that are made once
_loaded: dict[str, ModuleType] = {}


def cache_folder() -> Path:
    """Where generated modules and their machine code live: EXODRAKE_CACHE, else the user's cache folder."""
    if stated := os.environ.get("EXODRAKE_CACHE"):
        return Path(stated)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exodrake"


def load_text(stem: str, text: str) -> ModuleType:
    """Runs source as a module, whatever its file `stem_HASH.py` holds; numba's cache has what was compiled before."""
    name = f"{stem}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if name not in _loaded:
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # idle threads sleep, and leave their core to other work
        module = ModuleType(f"exodrake_generated_{name}")
        sys.modules[module.__name__] = module  # numba loads cached code by this name
        try:
            path = write_if_different(cache_folder() / f"{name}.py", text)
            run(text, path, module)
        except (OSError, RuntimeError) as error:  # no room, no right, no home folder, or nowhere for numba
            print_once(str(error))
            run(text.replace(CACHED, "cache=False"), Path(f"{name}.py"), module)
        _loaded[name] = module
    return _loaded[name]


def run(text: str, path: Path, module: ModuleType) -> None:
    """Runs source that a file holds in a module. RuntimeError if its machine code can be kept nowhere."""
    exec(compile(text, path, "exec"), module.__dict__)
    if CACHED not in text:
        return
    from numba.core.caching import FunctionCache

    class MendingCache(FunctionCache):
        """A cache whose damage costs a compilation and not the run; does without what cannot be written."""

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super().load_overload(sig, target_context)
            except Exception:  # whatever damaged bytes lead unpickling to
                with suppress(OSError):
                    self.flush()
                return None

        def save_overload(self, sig: Any, data: Any) -> None:
            with suppress(OSError):
                super().save_overload(sig, data)

    for function in vars(module).values():
        if isinstance(getattr(function, "_cache", None), FunctionCache):
            function._cache = MendingCache(function.py_func)


def write_if_different(path: Path, text: str) -> Path:
    """Writes a file whole, unless it holds this text already."""
    if not path.exists() or path.read_bytes() != text.encode():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode())
    return path


@cache
def print_once(reason: str) -> None:
    """One line on standard error."""
    print(f"exodrake: the cache of compiled code cannot be used, so each run compiles anew: {reason}", file=sys.stderr)


def once[T](owner: Any, name: str, make: Callable[[], T]) -> T:
    """A value kept beside the fields of an instance, as `cached_property` does, made by one of several threads."""
    if name not in owner.__dict__:
        with MAKING:
            if name not in owner.__dict__:
                owner.__dict__[name] = make()
    return owner.__dict__[name]
