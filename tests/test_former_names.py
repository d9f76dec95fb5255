"""Machine folders of the versions before import modules by names that have changed since."""

import subprocess
import sys

import pytest

from exodrake.former_names import FORMER


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
