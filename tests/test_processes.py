"""Processes that exodrake starts import nothing from the current folder, and end with the one that started them."""

import os
import select
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import exodrake as exo

ROOT = Path(exo.__file__).parent.parent
TRAP = "import os, pathlib\npathlib.Path(os.environ['TRAPPED'], __name__.replace('.', '_')).touch()\n"
MODULES = ("scipy", "numpy", "pyarrow", "cloudpickle", "joblib", "mcap", "numba", "exodrake", "threading", "signal")
LOOP = """
from exodrake.core.parallel import each
from tests.test_processes import double
if __name__ == "__main__":
    print(sorted(outcome.value for outcome in each(double, [(1,), (2,)], jobs=2)))
"""
BUSY = """
from exodrake.core.processes import in_child
from tests.test_processes import say_and_stay
in_child(say_and_stay, {pipe!r}, source="a", size=10**9)
"""
STAYING = """
from exodrake.core.parallel import each
from tests.test_processes import say_and_stay
if __name__ == "__main__":
    list(each(say_and_stay, [({pipe!r},)] * 2, jobs=2))
"""


def double(number):
    return 2 * number


def say_and_stay(pipe):
    with open(pipe, "wb", buffering=0) as held:
        held.write(b".")
        while True:
            os.getpid()


@pytest.fixture
def trapped(tmp_path, monkeypatch):
    """A current folder with modules that must not run; it gives the names of those that did."""
    here, ran = tmp_path / "here", tmp_path / "ran"
    here.mkdir(), ran.mkdir()
    for name in MODULES:
        (here / f"{name}.py").write_text(TRAP)
    package = here / "exodrake" / "core"
    package.mkdir(parents=True)
    for file in (package.parent / "__init__.py", package / "__init__.py", package / "child.py"):
        file.write_text(TRAP)
    monkeypatch.chdir(here)
    monkeypatch.setenv("TRAPPED", str(ran))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    return lambda: sorted(file.name for file in ran.iterdir())


CONSOLE = [sys.executable, "-P", "-c", "from exodrake.__main__ import run; run()"]  # as the installed command starts


def ran(*command):
    return subprocess.run([*map(str, command)], capture_output=True, text=True)


@pytest.mark.parametrize(
    ("ending", "start"),
    [(".mat", CONSOLE), (".parquet", CONSOLE), (".mcap", CONSOLE), (".mat", [sys.executable, "-m", "exodrake"])],
    ids=["installed, mat", "parquet", "mcap", "module"],
)
def test_a_reader_runs_no_module_of_the_current_folder(trapped, tmp_path, ending, start):
    if start is not CONSOLE:  # Python itself takes the package, and what it begins with, from the current folder
        for name in ("exodrake", "threading", "signal"):
            Path(f"{name}.py").unlink()
        shutil.rmtree("exodrake")
    file = tmp_path / f"log{ending}"
    exo.write_log(exo.Log(0.02 * np.arange(5), {"tension_AF": np.arange(5.0)}), file)
    done = ran(*start, "export", file, "--out", tmp_path / "out.csv")
    assert (done.returncode, trapped()) == (0, []), done.stderr
    assert exo.read_log(tmp_path / "out.csv")["tension_AF"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_workers_and_what_cleans_up_after_them_run_no_module_of_the_current_folder(trapped, tmp_path):
    loop = tmp_path / "loop.py"
    loop.write_text(LOOP)
    done = ran(sys.executable, loop)
    assert (done.stdout, trapped()) == ("[2, 4]\n", []), done.stderr


def test_compiled_code_is_not_loaded_from_where_a_file_of_the_current_folder_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"):
        monkeypatch.delenv(name, raising=False)
    Path(".numba_config.yaml").write_text(
        "cache_dir: theirs\ncache_locator_classes: theirs.Locator\ndisable_performance_warnings: 1\n"
    )
    call = "import exodrake, numba; c = numba.config; "
    call += "print([c.CACHE_DIR, c.CACHE_LOCATOR_CLASSES, c.DISABLE_PERFORMANCE_WARNINGS])"
    assert ran(sys.executable, "-c", call).stdout == "['', '', 1]\n"  # 1: numba did read the file


@pytest.mark.parametrize(("text", "count"), [(BUSY, 1), (STAYING, 2)], ids=["reader", "workers"])
def test_busy_processes_end_with_a_parent_that_is_killed(tmp_path, monkeypatch, text, count):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pipe, script = tmp_path / "pipe", tmp_path / "start.py"
    os.mkfifo(pipe)
    script.write_text(text.format(pipe=str(pipe)))
    held = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # ends once no process has it open
    with subprocess.Popen([sys.executable, script]) as parent:
        said = b""
        while len(said) < count:
            assert select.select([held], [], [], 60.0)[0]
            said += os.read(held, 10)
        parent.kill()
    assert select.select([held], [], [], 60.0)[0] and os.read(held, 10) == b""
    os.close(held)
