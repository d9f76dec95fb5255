"""Processes that this one starts: they import nothing from the current folder, and end when this one does.

A call in a process of its own, `in_child`: a file that crashes a reader, or never ends in it, costs that file alone.
"""

import math
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from exodrake.core.errors import InputError

ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")}
SAFE_PATH = {"PYTHONSAFEPATH": "1"}  # `python -m` and `-c` would look for modules in the current folder first
LOOK = 0.5  # s between two looks at whether the parent is there: assumed
CPU_TIME = 6.0  # s, assumed: of the processor, for a small file; readers take milliseconds
PATIENCE = 20.0  # assumed: of the clock for one of those, on a busy machine or in a reader that waits
BYTES_PER_SECOND = 2e6  # assumed: a tenth of what the slowest reader does
MEMORY = 2 << 30  # bytes of address space; a log of the size that is read takes a tenth
_lock = Lock()
_child: tuple[Connection, subprocess.Popen, int] | None = None  # and the process that owns it: after a fork the parent


def in_child[T](function: Callable[..., T], *arguments: Any, source: str, size: int) -> T:
    """Calls a function of this package in the child process to read the file `source` of some size [bytes].

    InputError as the function raises, or naming the file if the call crashes, takes too long or too much memory.
    """
    global _child
    time_limit = CPU_TIME + size / BYTES_PER_SECOND
    with _lock:
        if _child is None or _child[2] != os.getpid() or _child[1].poll() is not None:
            pipe, theirs = Pipe()
            command = [sys.executable, "-P", "-m", "exodrake.core.processes", str(theirs.fileno()), str(os.getpid())]
            silent: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
            # its modules come from where those of this process do
            environment = os.environ | SAFE_PATH | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | ONE_THREAD
            process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment, **silent)
            theirs.close()
            _child = pipe, process, os.getpid()
        pipe, process, _ = _child
        try:
            pipe.send((function, arguments, time_limit))
            if not pipe.poll(PATIENCE * time_limit):
                raise TimeoutError
            answer = pipe.recv()
        except BaseException as error:
            endless = isinstance(error, TimeoutError)
            endless = endless or (isinstance(error, EOFError) and process.wait() == -signal.SIGXCPU)
            process.kill()
            process.wait()
            pipe.close()
            if endless:
                raise InputError(f"{source}: not read: its reader does not come to an end") from None
            if isinstance(error, EOFError | OSError):
                raise InputError(f"{source}: not read: its reader crashes on it, so the file is damaged") from None
            raise
    if isinstance(answer, MemoryError):
        raise InputError(f"{source}: not read: its content takes more than {MEMORY >> 30} GB of memory")
    if isinstance(answer, Exception):
        raise answer
    return answer


def serve(pipe: Connection) -> None:
    """Answers calls until the other end is closed."""
    for limit, most in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CORE, 0)):
        with suppress(ValueError, OSError):  # a lower limit is in force, or the system has none
            resource.setrlimit(limit, (most, most))
    with suppress(EOFError, OSError):
        while True:
            function, arguments, time_limit = pipe.recv()
            used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            _, most = resource.getrlimit(resource.RLIMIT_CPU)
            wanted = math.ceil(used + time_limit)  # the system ends the process after that, even if the parent is gone
            resource.setrlimit(resource.RLIMIT_CPU, (wanted if most < 0 else min(wanted, most), most))
            try:
                answer = function(*arguments)
            except Exception as error:
                answer = error
            pipe.send(answer)


@contextmanager
def safe_path() -> Iterator[None]:
    """Processes that a library starts meanwhile import nothing from the current folder."""
    before = dict(os.environ)
    os.environ.update(SAFE_PATH)
    try:
        yield
    finally:
        for name in SAFE_PATH.keys() - before.keys():
            os.environ.pop(name, None)
        os.environ.update({name: before[name] for name in SAFE_PATH.keys() & before.keys()})


def end_with(parent: int) -> None:
    """Ends this process once the process of that id, which started it, has ended, even by `kill -9`, not by Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # reaches every process of a terminal, and is the parent's matter

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="parent").start()


if __name__ == "__main__":
    end_with(int(sys.argv[2]))
    serve(Connection(int(sys.argv[1])))
