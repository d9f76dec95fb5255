"""Prints `kernels` for a machine: a file beside the machine's own printed module, which numba caches."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import inspect
import os
import sys
from types import ModuleType

from exodrake.compiled.cache import cache_folder
from exodrake.compiled.compose import compile_machine
from exodrake.core.machine import Machine
from exodrake.monitor import kernels


def printed(machine: Machine) -> str:
    """The page with its annotated names bound to the machine's leaf functions."""
    tree = ast.parse(inspect.getsource(kernels))
    bound = [n.target.id for n in tree.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]
    tree.body = [n for n in tree.body if not isinstance(n, ast.AnnAssign)]
    where = compile_machine(machine).__name__
    tree.body.insert(1, ast.parse(f"from {where} import {', '.join(bound)}").body[0])
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def compile_kernels(machine: Machine) -> ModuleType:
    """The printed page; machine code comes from numba's cache when this text was compiled before."""
    if "live" in machine.__dict__:
        return machine.__dict__["live"]
    text = printed(machine)
    name = f"{machine.name}_live_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        part = path.with_suffix(f".{os.getpid()}.part")
        part.write_text(text)
        part.replace(path)
    spec = importlib.util.spec_from_file_location(f"exodrake_printed_{name}", path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # numba loads cached code by this name
    spec.loader.exec_module(module)
    machine.__dict__["live"] = module  # as cached_property does on a frozen dataclass
    return module
