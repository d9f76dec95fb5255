"""The import direction of the package, read off its source, and what `exodrake --help` may load."""

import ast
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "exodrake"
LINKED = ("systems", "diagrams")  # folders beside the package, to which links in it lead
FILES = sorted([*PACKAGE.rglob("*.py"), *(file for name in LINKED for file in (PACKAGE / name).rglob("*.py"))])

# what each folder may import besides itself, as the architecture draws it: siblings do not import each other; a folder
# that is not listed fails the test
LIBRARY = {"core", "physics", "effects", "machines", "data"}
ENGINES = LIBRARY | {"compiled"}
METHODS = ENGINES | {"systems", "diagrams", "simulation"}
RESULTS = METHODS | {"analysis", "identification", "estimator", "grasping", "diagnosis"}
BELOW = {
    "core": set(),
    "data": {"core"},
    "physics": {"core"},
    "effects": {"core", "physics"},
    "machines": LIBRARY - {"machines"},
    "compiled": LIBRARY,
    "systems": ENGINES,
    "diagrams": ENGINES | {"systems"},
    "simulation": ENGINES | {"diagrams"},  # simulate(engine="drake")
    **dict.fromkeys(("analysis", "estimator", "grasping", "diagnosis"), METHODS),
    "identification": METHODS | {"diagnosis"},  # a fit is a regression of the same kind
    **dict.fromkeys(("monitor", "experiment", "report", "reference"), RESULTS),
    "cli": RESULTS | {"monitor", "experiment", "report", "reference", ""},  # and the public names
    "__main__": {"cli"},
}


def part_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def is_module(name: str) -> bool:
    place = PACKAGE.parent.joinpath(*name.split("."))
    return place.with_suffix(".py").is_file() or (place / "__init__.py").is_file()


def imports(path: Path) -> set[str]:
    """Absolute names of all modules a file imports, inside functions too, but not for type checking only."""
    tree = ast.parse(path.read_text(), str(path))
    typing_only = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    package = ["exodrake", *path.relative_to(PACKAGE).parts[:-1]]
    found = set()
    for node in ast.walk(tree):
        if node in typing_only:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            named = {f"{module}.{alias.name}" for alias in node.names}
            found |= {name if module == "exodrake" or is_module(name) else module for name in named}
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_one_way(path):
    here = part_of(".".join(["exodrake", *path.relative_to(PACKAGE).with_suffix("").parts]))
    if not here:
        return
    for module in imports(path):
        if module.split(".")[0] != "exodrake":
            continue
        there = part_of(module)
        assert there in BELOW[here] | {here, "__version__"}, f"{path} imports {module}"


PACKAGES = set(BELOW) - {"__main__"}
ARCHITECTURE = "docs/explain/architecture.md"


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", ARCHITECTURE])
def test_diagram_of_imports_names_each_package(name):
    text = (PACKAGE.parent / name).read_text()
    diagram = text[text.index("core <-") : text.index("<- cli") + len("<- cli")]
    assert set(re.findall(r"\w+", diagram)) == PACKAGES - {"data"}
    assert "`data` stands on `core` alone" in text


def test_folder_table_names_each_package():
    assert set(re.findall(r"`(\w+)/", (PACKAGE.parent / ARCHITECTURE).read_text())) >= PACKAGES


def test_no_modules_import_each_other_in_a_circle():
    """Imports inside functions count."""
    names = {".".join(["exodrake", *path.relative_to(PACKAGE).with_suffix("").parts]): path for path in FILES}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    graph = {name: imports(path) & set(names) - {name, "exodrake"} for name, path in names.items()}
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


def may_use_drake(path: Path) -> bool:
    parts = path.relative_to(PACKAGE).parts
    return parts[0] in ("systems", "diagrams", "analysis")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_in_few_places(path):
    drake = [module for module in imports(path) if module.split(".")[0] == "pydrake"]
    assert not drake or may_use_drake(path), f"{path} imports {drake}"
    assert "from pydrake.all import *" not in path.read_text()


def loaded_by(*arguments: str) -> set[str]:
    code = (
        "import sys; sys.argv = ['exodrake', *sys.argv[1:]]\n"
        "from exodrake.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print('\\n' + ' '.join(sorted(m for m in sys.modules if '.' not in m)))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    )
    return set(run.stdout.splitlines()[-1].split())


def test_help_is_light():
    heavy = {"numpy", "scipy", "numba", "matplotlib", "pydrake", "sklearn", "yaml", "rich", "shapely", "control"}
    assert not heavy & loaded_by("--help")
    assert not heavy & loaded_by("--version")


def test_the_package_itself_is_light():
    code = "import exodrake as exo, sys; print('numpy' in sys.modules); exo.Log; print('pydrake' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    assert run.stdout.split() == ["False", "False"]
