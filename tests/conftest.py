"""Fixtures of several files, and the environment of the tests."""

import os
import shutil
import subprocess
import sys
from collections import Counter

if "PYTEST_XDIST_WORKER" in os.environ:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
# The first import of pydrake puts its own filter before pytest's: an error, too, also in programs that a test starts.
os.environ.setdefault("DRAKE_DEPRECATION_RUNTIME_SEVERITY", "error")

import pytest

import exodrake as exo
from exodrake.core import plugins
from exodrake.engine.cache import cache_folder


def pytest_configure(config):
    """Where nothing is compiled yet, compiles the Exo-Index before the workers start, each of which would do so."""
    alone = "PYTEST_XDIST_WORKER" in os.environ or not getattr(config.option, "numprocesses", None)
    if not alone and not any(cache_folder().glob("machine_*.py")):
        subprocess.run([sys.executable, "-m", "exodrake", "warm-up"], check=True, cwd=config.rootpath)


def pytest_terminal_summary(terminalreporter):
    """How many tests were skipped, and why."""
    found = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.getreports("skipped"))
    for reason, count in found.most_common():
        terminalreporter.write_line(f"skipped: {count} ({reason})")


@pytest.fixture(scope="session")
def robot():
    """The nominal robot."""
    return exo.load_robot()


@pytest.fixture(scope="session")
def loop(robot):
    """The nominal robot's map from one frame to the next."""
    from exodrake.analysis.linear_model import FrameMap

    return FrameMap.from_robot(robot)


@pytest.fixture(scope="session")
def point(loop):
    """Where the loop rests."""
    from exodrake.analysis.linear_model import operating_point

    return operating_point(loop)


@pytest.fixture(scope="session")
def model(loop, point):
    """The loop's linear model there."""
    from exodrake.analysis.linear_model import linearise

    return linearise(loop, point)


@pytest.fixture(scope="session")
def plant(robot):
    """The nominal robot's linear plant, for the search of controllers."""
    from exodrake.analysis.tuning import linearise_plant

    return linearise_plant(robot)


@pytest.fixture(scope="module")
def arm_folder(tmp_path_factory):
    """A folder for machines of a module of tests, whose registration is undone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(plugins.VARIABLE, "")
        yield tmp_path_factory.mktemp("arms")


@pytest.fixture
def few_cycles(monkeypatch):
    """Describing functions at every third amplitude, and limit cycles simulated at one factor."""
    from exodrake.analysis import limit_cycles

    monkeypatch.setattr(limit_cycles, "AMPLITUDES", limit_cycles.AMPLITUDES[::3])
    monkeypatch.setattr(limit_cycles, "FACTORS", (0.9,))


@pytest.fixture
def hasty(monkeypatch):
    """A short search of gains."""
    from exodrake.analysis import tuning

    monkeypatch.setattr(tuning, "SEARCH", tuning.SEARCH | {"maxiter": 1, "popsize": 2})


@pytest.fixture
def short_cases(monkeypatch):
    """Cases of the reference simulator with motions of a few seconds."""
    from exodrake.reference import cases

    for name, seconds in (("SWEEPS", 15.0), ("CHIRP", 3.0), ("HOLDS", 4.0), ("GRASPS", 6.0)):
        monkeypatch.setattr(cases, name, seconds)


@pytest.fixture
def place(tmp_path):
    """An empty folder for each draw."""

    def fresh():
        shutil.rmtree(tmp_path)
        tmp_path.mkdir()
        return tmp_path

    return fresh
