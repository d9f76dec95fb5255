"""The import direction of the package, read off its source, and what `exodrake --help` may load."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "exodrake"
FILES = sorted(PACKAGE.rglob("*.py"))

BOTTOM = {"errors", "units", "files", "log", "clock", "case", "casefile", "formats", "parallel", "counting", "frozen"}
UPPER = {"identification", "grasping", "analysis", "diagnosis", "blind", "live"}
# a part of the package may import itself, the bottom, and all below it; parts not listed here (cli, commands, figures,
# viewer) stand on top of all, and nothing listed may import them unless said so
BELOW = {
    **{name: set() for name in BOTTOM},
    "block": set(),
    "systems": {"block"},
    "robots": {"block", "systems"},
    "effects": {"block", "systems", "robots"},
    "diagrams": {"block", "systems", "robots", "effects"},
    **{name: {"block", "systems", "robots", "effects", "diagrams", "figures"} | UPPER for name in UPPER},
}
LAZY_AT_THE_BOTTOM = {("log", "figures")}  # Log.plot hands itself to the drawing


def part_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


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
            found |= {f"{module}.{alias.name}" for alias in node.names} if module == "exodrake" else {module}
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_one_way(path):
    here = part_of(".".join(["exodrake", *path.relative_to(PACKAGE).with_suffix("").parts]))
    if here not in BELOW:
        return
    for module in imports(path):
        if module.split(".")[0] != "exodrake":
            continue
        there = part_of(module)
        allowed = BELOW[here] | BOTTOM | {here, "__version__"}
        assert there in allowed or (here, there) in LAZY_AT_THE_BOTTOM, f"{path} imports {module}"


def may_use_drake(path: Path) -> bool:
    parts = path.relative_to(PACKAGE).parts
    return (
        parts == ("systems", "leaf.py")
        or (parts[0] == "diagrams" and "drake" in parts[-1])
        or parts[0].removesuffix(".py") in {"analysis", "viewer"}
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_in_few_places(path):
    drake = [module for module in imports(path) if module.split(".")[0] == "pydrake"]
    assert not drake or may_use_drake(path), f"{path} imports {drake}"
    assert "from pydrake.all import *" not in path.read_text()


def loaded_by(*arguments: str) -> set[str]:
    code = (
        "import sys; sys.argv = ['exodrake', *sys.argv[1:]]\n"
        "from exodrake.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print('\\n' + ' '.join(sorted(m for m in sys.modules if '.' not in m)))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    )
    return set(run.stdout.splitlines()[-1].split())


def test_help_is_light():
    heavy = {"numpy", "scipy", "numba", "matplotlib", "pydrake", "sklearn", "yaml", "rich", "shapely"}
    assert not heavy & loaded_by("--help")
    assert not heavy & loaded_by("--version")


def test_the_package_itself_is_light():
    code = "import exodrake as exo, sys; print('numpy' in sys.modules); exo.Log; print('pydrake' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    assert run.stdout.split() == ["False", "False"]


def test_every_public_name_is_there():
    import exodrake

    for name in exodrake.PUBLIC:
        assert getattr(exodrake, name).__name__ == name
    with pytest.raises(AttributeError):
        exodrake.nothing_of_the_kind  # noqa: B018
