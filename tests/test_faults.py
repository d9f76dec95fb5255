"""Killed processes, closed pipes, full disks, signals: an answer is there whole or not at all, and is never lost."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import exodrake as exo
from exodrake.cli.main import cli

# A command with a ready answer in place of the minutes of a diagnosis. With WORK it works a minute before that.
# a process that a shell starts in the background, and its children, ignore Ctrl-C; a terminal's do not
PROGRAM = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {tests!r})

def ready(case, robot=None, progress=None, tried=None, discovers=None, answered=None, negligible=None):
    from report_synthetic import VERDICTS, diagnosis
    if "WORK" in os.environ:
        print("working", flush=True)
        time.sleep(60)
    return diagnosis(VERDICTS[0])

if {{"diagnose", "blind"}} & {{*sys.argv}}:
    import exodrake.diagnosis.pipeline as pipeline
    pipeline.diagnose = ready
if "simulate" in sys.argv:
    import exodrake.cli.simulate
    exodrake.cli.simulate.make_files = lambda *_: {{"figure.png": b"x" * 5000, "recording.html": b"y" * 5000}}
from exodrake.__main__ import run
"""
# Runs it, then again and again in forks that kill themselves at their first, second ... change of the file system.
KILLED = """
import json, shutil, signal
from pathlib import Path
from exodrake.cli.main import cli

def contents():
    return {str(p): p.read_bytes().hex() for p in Path().rglob("*") if p.is_file() and ".part" not in str(p)}

def killed_at(moment):
    count = 0
    def hook(event, arguments):
        nonlocal count
        writes = event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax+")
        if writes or event in ("os.rename", "os.mkdir", "os.remove", "shutil.rmtree"):
            count += 1
            if count == moment:
                os.kill(os.getpid(), signal.SIGKILL)
    if not (fork := os.fork()):
        sys.addaudithook(hook)
        cli(sys.argv[1:], standalone_mode=False)
        os._exit(0)
    return os.waitpid(fork, 0)[1]

before = contents()
cli(sys.argv[1:], standalone_mode=False)
whole, runs, moment = contents(), [], 0
while not runs or runs[-1][0]:
    moment += 1
    shutil.rmtree("out", ignore_errors=True)
    for file in whole.keys() - before.keys():
        Path(file).unlink(missing_ok=True)
    runs.append((killed_at(moment), contents()))
Path("../answer.json").write_text(json.dumps([before, whole, runs]))
"""
NAMES = [f"{kind}_{w}" for kind in ("tension_ref", "tension", "stroke") for w in ("AF", "MF", "AE")]
LOG = exo.Log(0.02 * np.arange(30), dict.fromkeys(NAMES, np.linspace(0, 1e-3, 30)))


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a log, a case and a set of two cases."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    exo.write_log(LOG, "a.csv")
    for folder in ("case", "set/one", "set/two"):
        Path(folder).mkdir(parents=True)
        exo.write_log(LOG, f"{folder}/a.csv")
        Path(folder, "case.yaml").write_text("logs: [{file: a.csv}]")
    return tmp_path / "here"


def start(program: str, *words, **options) -> subprocess.Popen:
    """A process of its own."""
    source = PROGRAM.format(tests=str(Path(__file__).parent)) + program
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.Popen([sys.executable, "-c", source, *map(str, words)], text=True, **pipes)


COMMANDS = {
    "export": ("export", "a.csv", "--out", "out.npz"),
    "diagnose": ("diagnose", "case", "--json", "out.json", "--out-robot", "out.yaml"),
    "diagnose many": ("diagnose", "set/one", "set/two", "--out", "out", "--jobs", "1"),
    "blind run": ("blind", "run", "set"),
    "simulate": ("simulate", "caging:hold=0.1", "--out", "out"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_any_change_of_a_file_each_answer_is_whole_or_absent(place, name):
    process = start(KILLED, *COMMANDS[name])
    said = process.communicate()
    assert process.returncode == 0, said
    before, whole, runs = json.loads((place / "../answer.json").read_text())
    new = whole.keys() - before.keys()
    assert new and len(runs) > 2 * len(new)
    for status, left in runs:
        assert status in (0, signal.SIGKILL) and before.items() <= left.items() <= whole.items()
        assert name != "simulate" or left in (before, whole)  # one folder, so all or none
    assert runs[-1] == [0, whole]


@pytest.mark.parametrize("name", ["export", "diagnose", "simulate"])
def test_a_full_disk_is_one_line_and_leaves_nothing(place, name):
    def full():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))

    before = sorted(place.rglob("*"))
    process = start("run()", *COMMANDS[name], preexec_fn=full, env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"})
    out, err = process.communicate()
    assert process.returncode == 2 and len(err.splitlines()) == 1 and "File too large" in err, (out, err)
    after = [path for path in sorted(place.rglob("*")) if path.is_file()]
    assert after == [path for path in before if path.is_file()]


@pytest.mark.parametrize("where", ["closed pipe", "full"])
def test_an_answer_is_written_though_nobody_takes_the_summary(place, where):
    if where == "full":
        out = open("/dev/full", "w")  # noqa: SIM115
    else:
        reader, writer = os.pipe()
        os.close(reader)
        out = os.fdopen(writer, "w")
    with out:
        process = start("run()", *COMMANDS["diagnose"], stdout=out)
        err = process.communicate()[1]
    assert exo.load_robot("out.yaml") and json.loads(Path("out.json").read_text())["verdict"]
    assert process.returncode in (1, 2) and len(err.splitlines()) == (where == "full"), err


@pytest.mark.parametrize(
    ("name", "number"), [("diagnose", signal.SIGINT), ("diagnose many", signal.SIGTERM), ("blind run", signal.SIGINT)]
)
def test_a_signal_is_one_line_and_status_130(place, name, number):
    process = start("run()", *COMMANDS[name], env=os.environ | {"WORK": "1"})
    assert process.stdout.readline() == "working\n"
    process.send_signal(number)
    out, err = process.communicate()
    assert process.returncode == 130 and not out and len(err.splitlines()) == 1 and err.startswith("interrupted"), err
    assert not list(place.glob("out*")) and not list(place.glob("set/*/diagnosis.json"))


def test_ctrl_c_within_a_destructor_is_not_lost():
    program = "import signal\nclass Fragile:\n    def __del__(self):\n        signal.raise_signal(signal.SIGINT)\n"
    program += "def main():\n    Fragile()\n    time.sleep(60)\n"
    program += "import exodrake.cli.main\nexodrake.cli.main.main = main\nrun()"
    process = start(program)
    out, err = process.communicate()
    assert process.returncode == 130 and not out and err == "interrupted\n"


def test_the_process_that_reads_for_another_ends_with_it():
    program = "from exodrake.core.processes import in_child\nimport os, time\n"
    program += "print(in_child(os.getpid, source='', size=0), flush=True)\ntime.sleep(60)"
    process = start(program)
    reader = int(process.stdout.readline())
    os.kill(reader, 0)
    process.kill()
    process.communicate()
    for _ in range(100):
        if not Path(f"/proc/{reader}").exists():
            return
        time.sleep(0.1)
    raise AssertionError("it is still there")


def test_closed_standard_streams_do_no_harm(place):
    exo.write_log(LOG, "a.mat")
    process = start("run()", "export", "a.mat", "--out", "b.csv", preexec_fn=lambda: os.closerange(0, 3))
    process.communicate()
    assert process.returncode == 0 and exo.read_log("b.csv").equals(LOG)


def test_memory_that_runs_out_is_one_line_that_names_the_work(place, monkeypatch):
    def little(*_, **__):
        raise MemoryError

    monkeypatch.setattr("exodrake.read_log", little)
    monkeypatch.setattr(sys, "argv", ["exodrake", "export", "a.csv"])
    result = CliRunner().invoke(cli, ["export", "a.csv", "--out", "b.npz"])
    assert result.exit_code == 2 and result.stderr == "error: out of memory: exodrake export a.csv\n"


def test_names_of_cases_are_not_read_as_markup(place):
    Path("set/one").rename("set/[red]x[bold]")
    process = start("run()", "diagnose", "set/[red]x[bold]", "set/two", "--out", "out", "--jobs", "1")
    out, err = process.communicate()
    assert process.returncode == 0 and "[red]x[bold]" in out, (out, err)
