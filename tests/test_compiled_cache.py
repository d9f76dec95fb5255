"""The cache of generated code: damage costs a compilation, a folder that cannot be used one line."""

import ctypes
import importlib.util
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from exodrake.engine import cache

TEXT = "from numba import njit\n\n\n@njit(cache=True)\ndef double(x):\n    return 2.0 * x\n"
ASK = f"from exodrake.engine.cache import load_text\nprint(load_text('trial', {TEXT!r}).double(21.0))\n"
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1  # of Linux


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """An empty cache, and nothing known of an earlier one."""
    monkeypatch.setattr(cache, "_loaded", {})
    monkeypatch.setenv("EXODRAKE_CACHE", str(tmp_path / "cache"))
    cache.print_once.cache_clear()
    return tmp_path / "cache"


def ask(**options) -> subprocess.Popen:
    """A process of its own that compiles or loads the function, and prints 42.0."""
    return subprocess.Popen([sys.executable, "-c", ASK], stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def obey_modes() -> None:
    """Takes from root what lets it write anywhere."""
    if os.getuid() == 0:
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


def answer(process: subprocess.Popen, lines: int = 0) -> None:
    out, err = process.communicate()
    assert process.returncode == 0 and out == b"42.0\n", err.decode()
    assert len(err.splitlines()) == lines, err.decode()


def machine_code(folder: Path) -> list[Path]:
    return sorted(p for p in (folder / "__pycache__").iterdir() if p.suffix in (".nbi", ".nbc"))


def test_a_damaged_file_is_written_anew(folder, monkeypatch):
    assert cache.load_text("trial", "answer = 41\n").answer == 41
    (file,) = folder.glob("trial_*.py")
    file.write_bytes(b"answer = \xff")
    monkeypatch.setattr(cache, "_loaded", {})
    assert cache.load_text("trial", "answer = 41\n").answer == 41
    assert file.read_text() == "answer = 41\n"


def test_only_the_text_given_is_run(folder, monkeypatch):
    """A compiled file beside it, with the right time and size, could hold anything."""
    assert cache.load_text("trial", "answer = 41\n").answer == 41
    (file,) = folder.glob("trial_*.py")
    code = compile("answer = 66\n", file, "exec")
    stamp = file.stat()
    another = importlib._bootstrap_external._code_to_timestamp_pyc(code, int(stamp.st_mtime), stamp.st_size)
    (folder / "__pycache__").mkdir(exist_ok=True)
    Path(importlib.util.cache_from_source(str(file))).write_bytes(another)
    monkeypatch.setattr(cache, "_loaded", {})
    assert cache.load_text("trial", "answer = 41\n").answer == 41


@pytest.mark.parametrize("damage", [b"", b"text", b"\x80\x04]", "half"])
def test_damaged_machine_code_is_compiled_anew(folder, monkeypatch, damage):
    assert cache.load_text("trial", TEXT).double(21.0) == 42.0
    whole = {p.name: p.read_bytes() for p in machine_code(folder)}
    assert {Path(name).suffix for name in whole} == {".nbi", ".nbc"}
    for spoilt in (".nbi", ".nbc"):
        for path in machine_code(folder):
            if path.suffix == spoilt:
                path.write_bytes(whole[path.name][: len(whole[path.name]) // 2] if damage == "half" else damage)
        monkeypatch.setattr(cache, "_loaded", {})
        function = cache.load_text("trial", TEXT).double
        assert function(21.0) == 42.0 and not function.stats.cache_hits
    monkeypatch.setattr(cache, "_loaded", {})
    again = cache.load_text("trial", TEXT).double
    assert again(21.0) == 42.0 and again.stats.cache_hits


def test_two_processes_that_compile_at_once_agree(folder):
    for process in [ask(), ask()]:
        answer(process)


def test_a_full_disk_costs_the_cache_alone(folder):
    def full():
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))

    answer(ask(preexec_fn=full), lines=1)
    cache.load_text("trial", TEXT)  # the text is there, and no room for the machine code
    answer(ask(preexec_fn=full))


@pytest.mark.parametrize("there", [False, True])
def test_a_cache_that_may_only_be_read_costs_one_line(folder, there):
    if there:
        answer(ask())
    folder.mkdir(exist_ok=True)
    for place in (folder, folder / "__pycache__"):
        if place.exists():
            place.chmod(0o555)
    answer(ask(preexec_fn=obey_modes, env=os.environ | {"HOME": str(folder), "XDG_CACHE_HOME": str(folder)}), lines=1)


def test_a_folder_that_cannot_be_made_costs_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("EXODRAKE_CACHE", str(tmp_path / "file"))
    assert cache.load_text("trial", TEXT).double(21.0) == 42.0
    assert cache.load_text("trial", "answer = 43\n").answer == 43
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and "cache of compiled code cannot be used" in said
