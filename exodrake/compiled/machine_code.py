"""Numba's cache of machine code, whose damage costs a compilation, not the run."""

from __future__ import annotations

from contextlib import suppress
from types import ModuleType
from typing import Any

from numba.core.caching import FunctionCache


class MendingCache(FunctionCache):
    """Compiles anew what cannot be read, and does without what cannot be written."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever damaged bytes lead unpickling to
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Writes machine code for a signature."""
        with suppress(OSError):
            super().save_overload(sig, data)


def mend(module: ModuleType) -> None:
    """Gives the compiled functions of a module, which are not compiled yet, such a cache."""
    for function in vars(module).values():
        if isinstance(getattr(function, "_cache", None), FunctionCache):
            function._cache = MendingCache(function.py_func)
