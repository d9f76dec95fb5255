"""Processes that this one starts: they import nothing from the current folder, and end when this one does."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SAFE_PATH = {"PYTHONSAFEPATH": "1"}  # `python -m` and `-c` would look for modules in the current folder first
LOOK = 0.5  # s between two looks at whether the parent is there: assumed


def python_command(*arguments: str) -> list[str]:
    """The command of a Python whose modules come from where this one's do."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> dict[str, str]:
    """The environment of `python_command`, and of what it starts in turn."""
    return os.environ | SAFE_PATH | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


@contextmanager
def safe_path() -> Iterator[None]:
    """Processes that a library starts meanwhile import nothing from the current folder."""
    before = {name: os.environ.get(name) for name in SAFE_PATH}
    os.environ.update(SAFE_PATH)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def end_with(parent: int) -> None:
    """Ends this process once the process of that id, which started it, has ended, even by `kill -9`."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="parent").start()
