"""exodrake: simulate a tendon-driven robot and explain how far, where and why it differs from the real one.

`import exodrake as exo` stays light: the module of a public name is imported at its first use. The names
stand in `__init__.pyi`, which type checkers read.
"""

import ast as _ast
import os as _os
from importlib import import_module as _import_module
from inspect import signature as _signature
from pathlib import Path as _Path
from typing import Any as _Any

from exodrake.former_names import know_former_names as _know_former_names

_know_former_names()
__version__ = "1.0.0"

for _name in ("NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"):  # stated, if only as nothing: else numba lets a file
    _os.environ.setdefault(_name, "")  # in the current folder, .numba_config.yaml, say where compiled code comes from


def _public_names() -> dict[str, str]:
    """Public name -> module that defines it, from the imports of the stub."""
    stub = _ast.parse(_Path(__file__).with_suffix(".pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, _ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


PUBLIC = _public_names()
__all__ = list(PUBLIC)  # pyright: ignore


def _plain_signature(value: _Any) -> _Any:
    """The same; a dataclass says in its signature what a field begins with, where Python would say `<factory>`."""
    fields = getattr(value, "__dataclass_fields__", {}).values()
    if made := {f.name: f.default_factory() for f in fields if callable(f.default_factory)}:
        whole = _signature(value)
        changed = [p.replace(default=made.get(name, p.default)) for name, p in whole.parameters.items()]
        value.__signature__ = whole.replace(parameters=changed)
    return value


def __getattr__(name: str) -> _Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'exodrake' has no attribute {name!r}")
    value = _plain_signature(getattr(_import_module(PUBLIC[name]), name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__"})
