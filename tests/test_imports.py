"""The package: import direction, what --help may load, former names of modules, pins with hashes and licences."""

import ast
import re
import subprocess
import sys
import tomllib
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from exodrake.former_names import FORMER

PACKAGE = Path(__file__).parent.parent / "exodrake"
LINKED = ("systems", "diagrams")  # folders beside the package, to which links in it lead
FILES = sorted([*PACKAGE.rglob("*.py"), *(file for name in LINKED for file in (PACKAGE / name).rglob("*.py"))])

# what each folder may import besides itself, as the architecture draws it; a folder that is not listed fails the test
LIBRARY = {"core", "model", "physics", "effects", "machines", "data"}
ENGINES = LIBRARY | {"engine"}
METHODS = ENGINES | {"systems", "diagrams", "simulation"}
RESULTS = METHODS | {"analysis", "identification", "estimator", "grasping", "diagnosis"}
BELOW = {
    "core": set(),
    "model": {"core"},
    "data": {"core", "model"},
    "physics": {"core", "model"},
    "effects": {"core", "model", "physics"},
    "machines": LIBRARY - {"machines"},
    "engine": LIBRARY,
    "systems": ENGINES,
    "diagrams": ENGINES | {"systems"},
    "simulation": ENGINES | {"diagrams"},  # simulate(engine="drake")
    **dict.fromkeys(("analysis", "estimator", "grasping", "diagnosis"), METHODS),
    "identification": METHODS | {"diagnosis"},  # a fit is a regression of the same kind
    **dict.fromkeys(("monitor", "experiment", "report", "reference"), RESULTS),
    "cli": RESULTS | {"monitor", "experiment", "report", "reference", ""},  # and the public names
    "__main__": {"cli"},
    "former_names": set(),
}


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


def name_of(path: Path) -> str:
    return ".".join(["exodrake", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")


def test_imports_go_one_way_and_drake_is_imported_in_few_places():
    for path in FILES:
        found = imports(path)
        assert "from pydrake.all import *" not in path.read_text()
        _, *here = name_of(path).split(".")
        drake = [module for module in found if module.split(".")[0] == "pydrake"]
        assert not drake or here[0] in ("systems", "diagrams", "analysis"), f"{path} imports {drake}"
        own = {module.split(".")[1] for module in found if module.startswith("exodrake.")}
        assert not here or own <= BELOW[here[0]] | {here[0], "__version__"}, f"{path} imports {own}"


PACKAGES = set(BELOW) - {"__main__", "former_names"}
ARCHITECTURE = "docs/explain/architecture.md"


def test_diagram_of_imports_and_folder_table_name_each_package():
    for name in ("CONTRIBUTING.md", ARCHITECTURE):
        text = (PACKAGE.parent / name).read_text()
        diagram = text[text.index("core <-") : text.index("<- cli") + len("<- cli")]
        assert set(re.findall(r"\w+", diagram)) == PACKAGES - {"data"}
        assert "`data` stands on `core` and `model` alone" in text
    assert set(re.findall(r"`(\w+)/", text)) >= PACKAGES


def test_no_modules_import_each_other_in_a_circle():
    """Imports inside functions count."""
    names = {name_of(path): imports(path) for path in FILES}
    graph = {name: found & set(names) - {name, "exodrake"} for name, found in names.items()}
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


def printed(code: str, *arguments: str) -> str:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=PACKAGE.parent).stdout


def test_help_and_the_package_itself_are_light():
    heavy = {"numpy", "scipy", "numba", "matplotlib", "pydrake", "sklearn", "yaml", "rich", "shapely", "control"}
    code = "import sys; sys.argv = ['exodrake', *sys.argv[1:]]\nfrom exodrake.cli.main import main\ntry: main()\n"
    code += "except SystemExit: pass\nprint('\\n' + ' '.join(sorted(m for m in sys.modules if '.' not in m)))"
    assert not heavy & set(printed(code, "--help").splitlines()[-1].split())
    code = "import exodrake as exo, sys; print('numpy' in sys.modules); exo.Log; print('pydrake' in sys.modules)"
    assert printed(code).split() == ["False", "False"]


@pytest.mark.parametrize("former", FORMER)
def test_a_former_name_is_the_module_of_today(former):
    """In a process of its own, by `import` and by `from`, before and after the name of today."""
    today, (package, _, name) = FORMER[former], former.rpartition(".")
    lines = f"""
import importlib, sys
from {package} import {name} as one
two, now = importlib.import_module({former!r}), importlib.import_module({today!r})
assert one is two is now is sys.modules[{former!r}]
assert now.__name__ == {today!r} == now.__spec__.name
"""
    subprocess.run([sys.executable, "-P", "-c", lines], check=True)


def test_an_unknown_name_is_still_unknown():
    with pytest.raises(ModuleNotFoundError, match=r"exodrake\.core\.nothing"):
        __import__("exodrake.core.nothing")


ROOT = Path(__file__).parent.parent
PIN = re.compile(r"^([\w.-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})*)$", re.MULTILINE)
ROW = re.compile(r"^\| ([\w.-]+) \| (\d\S*) \| (.+) \|$", re.MULTILINE)


def test_every_pin_has_a_hash_and_a_licence():
    pins = PIN.findall((ROOT / "constraints.txt").read_text())
    rows = ROW.findall((ROOT / "docs" / "licences.md").read_text())
    assert len(pins) > 50 and all(hashes for _, _, hashes in pins)
    listed = sorted((re.sub(r"[-_.]+", "-", name).lower(), number) for name, number, _ in rows)
    assert listed == [(name, number) for name, number, _ in pins]
    assert all(licence != "not stated" for _, _, licence in rows)


def test_what_installs_the_package_is_pinned_and_taken_as_pinned():
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    makefile = (ROOT / "Makefile").read_text()
    listing = [sys.executable, ROOT / ".ci" / "requirements.py", "--pinned", "build"]
    pins = PIN.findall(subprocess.run(listing, capture_output=True, text=True, check=True).stdout)
    assert [name for name, _, hashes in pins if hashes] == ["pip", *sorted(re.match(r"\w+", line)[0] for line in build)]
    assert "--require-hashes" in makefile
    for line in makefile.splitlines():
        assert "--editable" not in line or "--no-build-isolation" in line
