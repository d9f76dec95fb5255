"""Docstrings name shape and unit of arrays and the fields of dataclasses; ruff checks their form."""

import inspect
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from pkgutil import walk_packages

import exodrake as exo
from exodrake import analysis, estimator, grasping, identification

SHAPE = re.compile(r"\((\.\.\.|\w[\w .*+-]*),[\w .*+,()-]*\)")  # (n,) or (rows, 3)
UNIT = re.compile(r"\[[^\[\]]+\]")  # [N], [rad/s], [SI] of any signal, [-] of none


def functions(module):
    """(name, function) of the public functions, methods and properties that a module defines."""
    for name, value in vars(module).items():
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value):
            for member, found in vars(value).items():
                found = found.fget if isinstance(found, property) else getattr(found, "__func__", found)
                if not member.startswith("_") and inspect.isfunction(found):
                    yield f"{name}.{member}", found


def takes_or_returns_array(function):
    """Tell whether an annotation of a function names an array."""
    return any("ndarray" in str(annotation) for annotation in function.__annotations__.values())


def modules():
    """Modules that define public names, and those of the rooms beside the diagnosis."""
    found = {import_module(name) for name in exo.PUBLIC.values()}
    for package in (analysis, estimator, grasping, identification):
        found |= {import_module(item.name) for item in walk_packages(package.__path__, package.__name__ + ".")}
    return sorted(found, key=lambda module: module.__name__)


PUBLIC = {
    f"{module.__name__.removeprefix('exodrake.')}.{name}": function
    for module in modules()
    for name, function in functions(module)
    if takes_or_returns_array(function)
}


def test_docstrings_name_shape_and_unit_of_arrays():
    assert len(PUBLIC) > 60
    for name, function in PUBLIC.items():
        text = inspect.getdoc(function) or ""
        assert SHAPE.search(text) and UNIT.search(text), f"{name}: {text}"


def test_docstrings_of_dataclasses_name_each_field_in_a_line_of_its_own():
    found = {name: value for name in exo.PUBLIC if is_dataclass(value := getattr(exo, name))}
    assert {"Log", "Case", "Robot", "Diagnosis"} <= set(found)
    for name, value in found.items():
        section = (inspect.getdoc(value) or "").partition("\nAttributes:\n")[2].partition("\n\n")[0]
        named = re.findall(r"^    (\w+): \S", section, re.MULTILINE)
        assert [field.name for field in fields(value) if field.name not in named] == [], name
