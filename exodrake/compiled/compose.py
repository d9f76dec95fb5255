"""Prints a machine as one module of plain functions that numba compiles.

It holds pages copied under prefixed names, effects spliced at their points, a leaf function per task and output, and
one frame of ten readable ticks. It is written to a real file, named by the hash of its text, because numba caches
compiled code by file and cannot see changes in imported functions.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
from pathlib import Path
from types import ModuleType

from exodrake.compiled.events import generate_events
from exodrake.compiled.flatten import Flatten
from exodrake.compiled.leaf_functions import print_leaves
from exodrake.compiled.schedule import print_frame
from exodrake.compiled.splice import compose_point
from exodrake.core.machine import Machine, module_name, part_modules, prefix

# Pages allocate nothing: without reference counts an array costs a call nothing, with them some ten nanoseconds.
PLAIN, INLINED = "@njit(_nrt=False)\n", "@njit(_nrt=False, forceinline=True)\n"
HEADER = '"""Printed by exodrake.compiled.compose from the table of {name}; do not edit."""\n\n'


class Page:
    """Source of one page: its functions, constants and imports as syntax trees."""

    def __init__(self, module: ModuleType) -> None:
        self.module, self.name, self.prefix = module, module_name(module), prefix(module.__name__)
        tree = ast.parse(inspect.getsource(module))
        self.functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef)]
        self.constants = [node for node in tree.body if isinstance(node, ast.Assign) and constant_names(node)]
        self.imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]

    def siblings(self) -> list[ModuleType]:
        """Pages from which this one imports functions."""
        names = [node.module for node in self.imports if node.module and self.equations(node.module)]
        return [importlib.import_module(name) for name in names]

    def equations(self, module: str) -> bool:
        """Whether a module that this one imports from holds equations: one of the library or of the same package."""
        parts = module.split(".")
        if parts[0] == "exodrake":
            return len(parts) > 2 and parts[1] in ("systems", "effects")
        return parts[0] == self.module.__name__.split(".")[0]

    def renames(self) -> dict[str, str]:
        """How the page's own and imported names are called in the printed module."""
        table = {name: f"{self.prefix}__{name}" for name in (*self.functions, *self.classes)}
        table |= {name: f"{self.prefix}__{name}" for node in self.constants for name in constant_names(node)}
        for node in self.imports:
            if node.module and self.equations(node.module):
                table |= {alias.asname or alias.name: f"{prefix(node.module)}__{alias.name}" for alias in node.names}
        return table


def constant_names(node: ast.Assign) -> list[str]:
    """Names of a page's literal constants bound by an assignment; none for anything else."""
    try:
        ast.literal_eval(node.value)
    except ValueError:
        return []
    targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
    return [t.id for t in targets if isinstance(t, ast.Name) and t.id not in ("BLOCK", "EFFECT")]


class Rename(ast.NodeTransformer):
    """Renames a page's names, local names excepted, and drops annotations."""

    def __init__(self, table: dict[str, str], local: set[str]) -> None:
        self.table, self.local = table, local

    def visit_Name(self, node: ast.Name) -> ast.Name:
        if node.id not in self.local and node.id in self.table:
            node.id = self.table[node.id]
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node


def copy_function(
    function: ast.FunctionDef, table: dict[str, str], name: str, flatten: Flatten | None = None, plain: bool = False
) -> str:
    """A page's function under its new name, decorated for numba.

    `flatten`: for the pages of a block with numbers; `plain`: for its tasks, which numba need not inline.
    """
    node = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(node, ast.FunctionDef)
    stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    local = stored | {a.arg for a in node.args.args}
    Rename(table, local).visit(node)
    if flatten is not None:
        flatten.visit(node)
    node.name, node.returns = name, None
    return (PLAIN if plain else INLINED) + ast.unparse(ast.fix_missing_locations(node))


def all_pages(machine: Machine) -> dict[str, Page]:
    """Every page that the machine's parts and effects need, imported ones first."""
    found: dict[str, Page] = {}

    def add(module: ModuleType) -> None:
        page = Page(module)
        if page.prefix in found:
            return
        for sibling in page.siblings():
            add(sibling)
        found[page.prefix] = page

    for part in machine.parts:
        for module in part_modules(part):
            add(module)
    for effect in machine.effects:
        for function in effect.at.values():
            add(sys.modules[function.__module__])
    for function in machine.variants.values():
        add(sys.modules[function.__module__])
    return found


def print_pages(machine: Machine, pages: dict[str, Page]) -> list[str]:
    """Constants and functions of all pages, points composed with their effects."""
    points = {(p.module or b.module, p.name): (b, p) for b in machine.parts for p in b.points}
    tasks = {(b.module, t.function) for b in machine.parts for t in (*b.tasks, *b.outputs)}
    owners = {prefix(p.__name__): Flatten(machine, b) for b in machine.parts for p in part_modules(b)}
    lines = []
    for page in pages.values():
        table = page.renames()
        for node in page.constants:
            tree = ast.parse(ast.unparse(node)).body[0]
            lines.append(ast.unparse(Rename(table, set()).visit(tree)))
        for name, function in page.functions.items():
            key, own = f"{page.name}.{name}", (page.module, name)
            if key in machine.variants:
                other = machine.variants[key]
                home = pages[prefix(other.__module__)]
                lines.append(copy_function(home.functions[other.__name__], home.renames(), f"{page.prefix}__{name}"))
            elif own in points and (spliced := [e for e in machine.effects if key in e.at]):
                part, point = points[own]
                lines.append(compose_point(machine, part, point, function, spliced))
            else:
                flatten = owners.get(page.prefix)
                lines.append(copy_function(function, table, f"{page.prefix}__{name}", flatten, own in tasks))
    return lines


def print_module(machine: Machine) -> str:
    """The whole module as text."""
    pages = all_pages(machine)
    math = [node for page in pages.values() for node in page.imports if node.module == "math"]
    imports = {f"from math import {alias.name}" for node in math for alias in node.names}
    lines = [
        HEADER.format(name=machine.name),
        "from collections import namedtuple\nfrom math import inf\n",
        "import numpy as np\nfrom numba import njit, prange\n\nfrom exodrake.compiled.memory import vector",
        *sorted(imports),
        *print_leaves(machine),
        *print_pages(machine, pages),
        *print_frame(machine),
        *(line for part in machine.parts for line in generate_events(machine, part)),
    ]
    return "\n\n".join(lines) + "\n"


def cache_folder() -> Path:
    """Where printed modules and their machine code live: EXODRAKE_CACHE, else the user's cache folder."""
    if stated := os.environ.get("EXODRAKE_CACHE"):
        return Path(stated)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exodrake"


_compiled: dict[str, ModuleType] = {}


def compile_machine(machine: Machine) -> ModuleType:
    """The machine's printed module; machine code comes from numba's cache when this text was compiled before."""
    if "printed" in machine.__dict__:
        return machine.__dict__["printed"]
    module = machine.__dict__["printed"] = load_module(machine)  # as cached_property does on a frozen dataclass
    return module


def load_module(machine: Machine) -> ModuleType:
    """Prints and imports a machine."""
    text = print_module(machine)
    name = f"{machine.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if name not in _compiled:
        path = cache_folder() / f"{name}.py"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(f".{os.getpid()}.part")
            part.write_text(text)
            part.replace(path)
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # idle threads sleep, and leave their core to other work
        spec = importlib.util.spec_from_file_location(f"exodrake_printed_{name}", path)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # numba loads cached code by this name
        spec.loader.exec_module(module)
        _compiled[name] = module
    return _compiled[name]
