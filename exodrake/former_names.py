"""Former names of modules, by which machine folders and plugins of the versions before import them.

`exodrake.core.machine` is `exodrake.model.machine`, and so on: the same module under both names.
"""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

MODEL = ("display", "effect", "machine", "mechanism", "part", "robot", "units")
FORMER = {f"exodrake.core.{name}": f"exodrake.model.{name}" for name in MODEL}
FORMER |= {
    f"exodrake.compiled{name}": f"exodrake.engine{name}"
    for name in ("", ".cache", ".compose", ".inputs", ".run", ".schedule")
}


class FormerNames(MetaPathFinder, Loader):
    """Finds a module by its former name, before its file is found as a second module."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """The specification of a former name; None for any other."""
        return ModuleSpec(fullname, self) if fullname in FORMER else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module of today, whose own specification the import keeps aside."""
        module = import_module(FORMER[spec.name])
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leaves the module as it is, and gives it its own specification back."""
        former = module.__spec__
        module.__spec__ = former.loader_state if former else None


def know_former_names() -> None:
    """Makes former names importable."""
    if not any(isinstance(finder, FormerNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, FormerNames())
