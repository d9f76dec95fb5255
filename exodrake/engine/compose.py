"""Generates one module of plain functions from a machine, which numba compiles.

The module holds the functions of parts and effects under prefixed names, effects spliced at their points, what the
Drake leaves call, and the schedule of a frame. It is one file, because numba caches compiled code by file and cannot
see changes in imported functions.

A point's function asks one flag whether any effect is present there; only then does it call its spliced form, in which
the value passes through each present effect in the effect library's order. Flags and parameters of a part's effects
travel as one array: as arguments of their own, some hundred of them, they would cost more than the physics.
"""

import ast
import importlib
import inspect
import re
import sys
from types import ModuleType, SimpleNamespace

from exodrake.core.errors import InputError
from exodrake.engine.cache import load_text, once
from exodrake.engine.schedule import generate_begin, generate_equations, generate_moves, generate_run
from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.machine import Machine, stack
from exodrake.model.part import SCALAR, Part, Point, State, module_name, part_modules, point_key, prefix

# Functions of parts allocate nothing (without reference counts an array costs a call nothing, with them some 10 ns),
# and only compiled code calls them (wrappers for others would be a fifth of the compilation).
INTERNAL = "_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True"
PLAIN, INLINED = f"@njit({INTERNAL})\n", f"@njit({INTERNAL}, forceinline=True)\n"
# What every module begins with. `target[:] = source` would compile numba's message about other lengths, for seconds.
COMMON = f'''
{INLINED}def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]


@njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def fill(values, flags, places, nulls):
    """A flag for each point of a part (is an effect present?), then the parameters `values` of its effects."""
    e = np.zeros(flags + len(values))
    copy(values, e[flags:])
    for k in range(len(nulls)):
        if values[places[k, 0]] != nulls[k]:
            e[places[k, 1]] = 1.0
    return e
'''
PARAMETERS = "n"  # the argument by which the functions of parts know their parameters


class ModuleSource:
    """Source of a module of a part or an effect: functions, points, constants and imports as syntax trees."""

    def __init__(self, module: ModuleType) -> None:
        self.module, self.name, self.prefix = module, module_name(module), prefix(module.__name__)
        tree = ast.parse(inspect.getsource(module))
        assigned = {ast.unparse(node.targets[0]) for node in tree.body if isinstance(node, ast.Assign)}
        self.points = {name: p for name, p in vars(module).items() if isinstance(p, Point) and name in assigned}
        nodes = [*tree.body, *(ast.parse(point.source).body[0] for point in self.points.values())]
        self.functions = {node.name: node for node in nodes if isinstance(node, ast.FunctionDef)}
        self.constants = [node for node in tree.body if isinstance(node, ast.Assign) and constant_names(node)]
        self.imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]

    def equations(self, module: str) -> bool:
        """Whether a module that this one imports from holds equations: one of the library or of the same package."""
        parts = module.split(".")
        if parts[0] == "exodrake":
            return len(parts) > 2 and parts[1] in ("physics", "effects")
        return parts[0] == self.module.__name__.split(".")[0]

    def renames(self) -> dict[str, str]:
        """How the module's own and imported names are called in the generated module."""
        table = {name: f"{self.prefix}__{name}" for name in self.functions}
        table |= {name: f"{self.prefix}__{name}" for node in self.constants for name in constant_names(node)}
        table |= {name: f"{self.prefix}__{point.name}" for name, point in self.points.items()}
        for home, alias in ((n.module, a) for n in self.imports for a in n.names):
            if home and self.equations(home):
                name = alias.asname or alias.name
                own = getattr(self.module, name)
                full = own.name if isinstance(own, Point) else getattr(own, "__name__", alias.name)
                table[name] = f"{prefix(home)}__{full}"
        return table


def constant_names(node: ast.Assign) -> list[str]:
    """Names of a module's literal constants bound by an assignment; none for texts, which no equation uses."""
    try:
        if isinstance(ast.literal_eval(node.value), str):
            return []
    except ValueError:
        return []
    targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
    return [t.id for t in targets if isinstance(t, ast.Name)]


class Rename(ast.NodeTransformer):
    """Renames a module's names, local names excepted, and removes annotations.

    Whole numbers given to a function are named too: of a literal, numba compiles the function once for each value.
    """

    def __init__(self, table: dict[str, str], local: set[str]) -> None:
        self.table, self.local = table, local

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """A name that is not local."""
        if node.id not in self.local and node.id in self.table:
            node.id = self.table[node.id]
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """A call of one of the module's functions."""
        own = isinstance(node.func, ast.Name) and node.func.id in self.table
        for i, given in enumerate(node.args if own else ()):
            if isinstance(given, ast.Constant) and type(given.value) is int:
                node.args[i] = ast.Name(f"INTEGER_{given.value}", ast.Load())
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        """An argument without its annotation."""
        node.annotation = None
        return node


class Flatten(ast.NodeTransformer):
    """Parameters by name in the modules of parts, by index in the generated module: `n.kappa[i]` is `n[37 + i]`.

    A named tuple of seventy parameters travels by value at each call; a slice of the flat vector is a pointer.
    """

    def __init__(self, machine: Machine, part: Part) -> None:
        at = stack({field.name: machine.width(field.axis) for field in part.fields})
        self.indices = {f.name: (at[f.name].start, machine.width(f.axis) * (f.axis != SCALAR)) for f in part.fields}

    def index(self, node: ast.AST) -> tuple[int, int] | None:
        """Start and width (0: a scalar) of the parameter that a node names."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == PARAMETERS:
            return self.indices.get(node.attr)
        return None

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """`n.name[channel]`."""
        found = self.index(node.value)
        if found is None:
            return self.generic_visit(node)
        return item(ast.BinOp(ast.Constant(found[0]), ast.Add(), self.visit(node.slice)))

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """`n.name`."""
        found = self.index(node)
        if found is None:
            return self.generic_visit(node)
        start, width = found
        if not width:
            return item(ast.Constant(start))
        return ast.Tuple([item(ast.Constant(start + i)) for i in range(width)], ast.Load())


def item(index: ast.expr) -> ast.Subscript:
    """`n[index]`."""
    return ast.Subscript(ast.Name(PARAMETERS, ast.Load()), index, ast.Load())


def copy_function(
    function: ast.FunctionDef, table: dict[str, str], name: str, flatten: Flatten | None = None, plain: bool = False
) -> str:
    """A module's function under its new name; `plain`: for tasks of parts, which numba need not inline."""
    node = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(node, ast.FunctionDef)
    stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    local = stored | {a.arg for a in node.args.args}
    Rename(table, local).visit(node)
    if flatten is not None:
        flatten.visit(node)
    node.name, node.returns = name, None
    return (PLAIN if plain else INLINED) + ast.unparse(ast.fix_missing_locations(node))


def module_sources(machine: Machine) -> dict[str, ModuleSource]:
    """Every module that the machine's parts and effects need by prefix, imported ones first."""
    found: dict[str, ModuleSource] = {}

    def add(module: ModuleType) -> None:
        source = ModuleSource(module)
        if source.prefix not in found:
            for name in (node.module for node in source.imports if node.module and source.equations(node.module)):
                add(importlib.import_module(name))
            found[source.prefix] = source

    laws = [law for effect in machine.effects for law in effect.at.values()]
    for module in (module for part in machine.parts for module in part_modules(part)):
        add(module)
    for function in (*laws, *machine.variants.values()):
        add(sys.modules[function.__module__])
    return found


def generate_functions(machine: Machine, sources: dict[str, ModuleSource]) -> list[str]:
    """Constants and functions of all modules, points composed with their effects."""
    points = {(p.module or b.module, p.name): (b, p) for b in machine.parts for p in b.points}
    tasks = {(b.module, t.function) for b in machine.parts for t in (*b.tasks, *b.outputs)}
    owners = {prefix(p.__name__): Flatten(machine, b) for b in machine.parts for p in part_modules(b)}
    lines = []
    for source in sources.values():
        table = source.renames()
        for node in source.constants:
            tree = ast.parse(ast.unparse(node)).body[0]
            lines.append(ast.unparse(Rename(table, set()).visit(tree)))
        for name, function in source.functions.items():
            key, own = f"{source.name}.{name}", (source.module, name)
            if key in machine.variants:
                other = machine.variants[key]
                home = sources[prefix(other.__module__)]
                lines.append(copy_function(home.functions[other.__name__], home.renames(), f"{source.prefix}__{name}"))
            elif own in points and (spliced := [e for e in machine.effects if key in e.at]):
                part, point = points[own]
                lines.append(compose_point(machine, part, point, function, spliced))
            else:
                flatten = owners.get(source.prefix)
                lines.append(copy_function(function, table, f"{source.prefix}__{name}", flatten, own in tasks))
    return lines


def generate_module(machine: Machine) -> str:
    """The whole module as text, which names no machine: those of the same equations share their module."""
    sources = module_sources(machine)
    imports = [node for source in sources.values() for node in source.imports if node.module == "math"]
    functions = [generate_effects(machine, part) for part in machine.parts] + generate_functions(machine, sources)
    functions += [generate_begin(machine), generate_run(machine)]
    functions += [generate_moves(machine)] if machine.command_link else []
    functions += [line for part in machine.parts for line in generate_equations(machine, part)]
    numbers = {int(n) for n in re.findall(r"INTEGER_(\d+)", "".join(functions))}
    lines = [
        '"""Generated by exodrake.engine.compose; do not edit."""\n\n',
        "from collections import namedtuple\nfrom math import inf\n",
        "import numpy as np\nfrom numba import njit",
        *(f"INTEGER_{n} = np.int64({n})" for n in sorted(numbers)),
        *sorted({f"from math import {alias.name}" for node in imports for alias in node.names}),
        COMMON,
        *functions,
    ]
    return "\n\n".join(lines) + "\n"


def generate_effects(machine: Machine, part: Part) -> str:
    """`part_places` and `part_nulls`, by which `fill` knows at which points the effects of a part are present."""
    effects, points = machine.effects_on(part), [point_key(part, p) for p in part.points]
    at = stack({(e.id, one.name): machine.width(one.axis) for e in effects for one in e.parameters})
    first = [(at[e.id, e.parameters[0].name], e) for e in effects]
    rows = [(k, points.index(key), float(e.parameters[0].null)) for span, e in first for key in e.at
            for k in range(span.start, span.stop)]  # fmt: skip
    places = f"{part.name}_places = np.array({[row[:2] for row in rows]}, dtype=np.int64).reshape(-1, 2)"
    return f"{places}\n{part.name}_nulls = np.array({[row[2] for row in rows]})"


def effect_values(
    machine: Machine, part: Part, effect: Effect, item: EffectParameter | State, channel: str | None
) -> list[str]:
    """A parameter (in e) or a state (in z) of an effect as source: of a channel, or of all where the point has none."""
    kind, vector, first = ("states", "z", 0) if isinstance(item, State) else ("parameters", "e", len(part.points))
    items = [(e.id, one) for e in machine.effects_on(part) for one in getattr(e, kind)]
    sizes = {(owner, one.name): machine.width(one.axis) * getattr(one, "width", 1) for owner, one in items}
    span, width, found = stack(sizes)[effect.id, item.name], machine.width(item.axis), []
    for at in range(first + span.start, first + span.stop, width):
        one = channel and item.axis != SCALAR
        found += [f"{vector}[{at} + {channel}]"] if one else [f"{vector}[{at + i}]" for i in range(width)]
    return found


def compose_point(machine: Machine, part: Part, point: Point, function: ast.FunctionDef, effects: list[Effect]) -> str:
    """The function of a point and its spliced form."""
    key = point_key(part, point)
    names = [a.arg for a in function.args.args]
    name = f"{prefix((point.module or part.module).__name__)}__{point.name}"
    flag = [point_key(part, p) for p in part.points].index(key)
    channel = names[2] if point.axis != SCALAR else None
    value, context = names[3 if channel else 2], names[4 if channel else 3 :]
    body = []  # lines through which the value passes
    for effect in effects:
        act, own = effect.at[key], channel if effect.axis == point.axis or effect.axis == SCALAR else None
        states = [place for state in effect.states for place in effect_values(machine, part, effect, state, own)]
        values = [effect_values(machine, part, effect, parameter, own) for parameter in effect.parameters]
        parameters = [v[0] if len(v) == 1 else f"({', '.join(v)})" for v in values]
        given = choose_context(effect, key, context, len(parameters) + len(states))
        call = f"{prefix(act.__module__)}__{act.__name__}({', '.join([value, *given, *parameters, *states])})"
        filtered = [value, *states] if key in effect.filters else [value]
        target = ", ".join(states if key in effect.advances else filtered)
        body += [f"    if {guard(machine, part, effect, own)}:", f"        {target} = {call}"]
    returns = [] if any(key in effect.advances for effect in effects) else [f"    return {value}"]
    header, call = f"({', '.join(names)}):", f"{name}__spliced({', '.join(names)})"
    spliced = [PLAIN + f"def {name}__spliced{header}", *body, *returns]
    plain = [INLINED + f"def {name}{header}", f'    """{ast.get_docstring(function)}"""']
    plain += [f"    if e[{flag}] != 0.0:", f"        {'return ' if returns else ''}{call}", *returns]
    return "\n".join([*spliced, "\n", *plain])


def choose_context(effect: Effect, key: str, context: list[str], own: int) -> list[str]:
    """Those of a point's arguments after the value that a law names, else all. InputError if neither fits."""
    code = effect.at[key].__code__
    names = [effect.names.get(name, name) for name in code.co_varnames[1 : max(1, code.co_argcount - own)]]
    if code.co_argcount > own and set(names) <= set(context):
        return names
    if code.co_argcount == own + 1 + len(context):
        return context
    given, taken = ", ".join(["a value", *context]), ", ".join(code.co_varnames[: code.co_argcount])
    raise InputError(
        f"{effect.id}: {code.co_name}({taken}) does not fit {key}, which gives {given}; "
        f"{own} parameters and states of the effect follow"
    )


def guard(machine: Machine, part: Part, effect: Effect, channel: str | None) -> str:
    """Condition under which the effect is present."""
    first = effect.parameters[0]
    return " or ".join(f"{v} != {float(first.null)!r}" for v in effect_values(machine, part, effect, first, channel))


def compile_machine(machine: Machine) -> ModuleType:
    """The generated module of a machine: `begin`, `run` and what the Drake leaves call."""
    return once(machine, "generated", lambda: load_text("machine", generate_module(machine)))


def equations(machine: Machine, part: Part) -> SimpleNamespace:
    """The compiled functions of a part's module by name, with the effects of the machine: see `generate_equations`."""
    head, module = f"{part.name}__equation__", compile_machine(machine)
    return SimpleNamespace(**{k.removeprefix(head): f for k, f in vars(module).items() if k.startswith(head)})
