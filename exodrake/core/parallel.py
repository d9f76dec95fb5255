"""One function for many tasks: in this process, in several, or on a Dask cluster. What every loop goes through.

    for outcome in each(function, tasks, jobs=4):   # or cluster="tcp://192.168.1.20:8786"
        ...                                         # as they finish, in any order

The answers are the same wherever a task runs: it gets its inputs by value and nothing else, and one thread. Two threads
of linear algebra not only fight for the cores (a 40 µs prediction then takes 15 ms), they also add up in another order.

A task that raises gives an outcome with the reason. A process that dies (memory, a crash) takes its task with it: those
that were running when it died are run again, one at a time, so that only the one to blame is given up. On a cluster
Dask does this, as often as its `distributed.scheduler.allowed-failures` says (3). Only a few more tasks than there are
workers are read at a time, so that a hundred thousand of them need no memory.
"""

from __future__ import annotations

import logging
import signal
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import islice
from threading import Lock
from typing import Any

from exodrake.core.errors import InputError

ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")}
ONE_AT_A_TIME = Lock()  # numba's own thread pool ends a process in which two threads enter it at once
PATIENCE = "10s"  # for a scheduler to answer
AHEAD = 2  # tasks sent to a cluster per worker, so that none waits for the next


@dataclass(frozen=True)
class Outcome:
    """What became of task `number` (its place in the order given): its value, or why there is none, with traceback."""

    number: int
    value: Any = None
    reason: str | None = None
    trace: str = ""


def each(
    function: Callable[..., Any], tasks: Iterable[tuple], jobs: int = 1, cluster: str | None = None
) -> Generator[Outcome]:
    """Outcomes of function(*task), as they finish; closing the generator ends what is under way.

    Args:
        function: importable by name where it runs. tasks: read one by one as there is room.
        jobs: processes; -1 for one a core. cluster: address of a Dask scheduler, in place of `jobs`.
    Raises:
        InputError: if no scheduler answers, or it goes away; outcomes given until then stand.
    """
    if cluster:
        yield from through(DaskPool(cluster), function, tasks)
    elif jobs == 1:
        with one_thread():
            yield from (Outcome(number, *attempt(function, task)) for number, task in enumerate(tasks))
    else:
        yield from through(LocalPool(cores() if jobs < 1 else jobs), function, tasks)


def cores() -> int:
    """Processor cores that this process may use."""
    from joblib import cpu_count

    return cpu_count()


def attempt(function: Callable[..., Any], task: tuple) -> tuple[Any, str | None, str]:
    """Value, None and nothing; or None, the reason why there is none, and the traceback."""
    try:
        return function(*task), None, ""
    except Exception as error:  # one bad task must not end a night's run
        return None, f"{type(error).__name__}: {error}", traceback.format_exc()


def alone(function: Callable[..., Any], task: tuple) -> tuple[Any, str | None, str]:
    """`attempt` on a worker: one thread, one task at a time."""
    with ONE_AT_A_TIME, one_thread():
        return attempt(function, task)


def one_blas_thread() -> AbstractContextManager:
    """Holds linear algebra to one thread: in small products a second one only waits, at a core's cost."""
    return one_each("blas")


def one_each(kind: str | None = None) -> AbstractContextManager:
    """Holds the thread pools of that kind ("blas", "openmp"; all by default) to one thread."""
    import scipy.linalg  # noqa: F401  brings its own BLAS, which can only be held once it is there
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, user_api=kind)


@contextmanager
def one_thread() -> Iterator[None]:
    """Holds linear algebra and compiled loops to one thread."""
    import numba

    before = numba.get_num_threads()
    with one_each():
        numba.set_num_threads(1)
        try:
            yield
        finally:
            numba.set_num_threads(before)


class LocalPool:
    """Processes on this machine. A new pool takes the place of one that a dying process has broken."""

    def __init__(self, jobs: int) -> None:
        self.jobs, self.executor = jobs, None

    def width(self) -> int:
        """Tasks to have under way: one a process, so that a death leaves no doubt but among those."""
        return self.jobs

    def submit(self, *call: Any) -> Future:
        """Start a call."""
        if self.executor is None:
            from joblib.externals.loky import ProcessPoolExecutor

            self.executor = ProcessPoolExecutor(self.jobs, env=ONE_THREAD, initializer=leave_interrupts_to_the_parent)
        try:
            return self.executor.submit(*call)
        except BrokenExecutor as error:  # broken by a process that died idle: as if it had died on this call
            future: Future = Future()
            future.set_exception(error)
            return future

    def gone(self) -> InputError:
        """What to raise when it no longer takes tasks."""
        return InputError("the processes were ended; what was done until then is kept")

    def close(self) -> None:
        """End the processes, whatever they do."""
        if self.executor is not None:
            self.executor.shutdown(wait=True, kill_workers=True)
            self.executor = None


def leave_interrupts_to_the_parent() -> None:
    """Ctrl-C reaches every process of a terminal; the parent ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class DaskPool:
    """An existing Dask cluster; workers may come and go. InputError if Dask is absent or nobody answers."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--cluster: Dask is not installed; install exodrake[cluster]") from None
        try:
            self.client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--cluster {address}: no Dask scheduler answers ({error})") from None
        logging.getLogger("distributed.client").setLevel(
            logging.CRITICAL
        )  # its traceback of what `gone` says in a line
        self.address = address
        self.executor: Executor = self.client.get_executor(pure=False)

    def width(self) -> int:
        """Tasks to have under way."""
        try:
            workers: Any = self.client.nthreads()
            return AHEAD * max(1, len(workers))
        except OSError:
            raise self.gone() from None

    def gone(self) -> InputError:
        """What to raise when the scheduler no longer answers."""
        return InputError(f"--cluster {self.address}: the scheduler has gone; what was done until then is kept")

    def submit(self, *call: Any) -> Future:
        """Start a call."""
        return self.executor.submit(*call)

    def close(self) -> None:
        """Cancel what is under way and leave the cluster to others."""
        self.executor.shutdown(wait=False)
        self.client.close(timeout=PATIENCE)


def through(pool: LocalPool | DaskPool, function: Callable[..., Any], tasks: Iterable[tuple]) -> Iterator[Outcome]:
    """Outcomes by way of a pool; at the end those whose process died with others beside it, each alone."""
    suspects: list[tuple[int, tuple]] = []
    try:
        for number, task, future in finished(pool, function, enumerate(tasks), pool.width):
            if died(future):
                suspects.append((number, task))
                pool.close()
            else:
                yield settled(number, future)
        for number, _, future in finished(pool, function, iter(suspects), lambda: 1):
            if died(future):
                pool.close()
            yield settled(number, future)
    except CancelledError:  # nobody here cancels
        raise pool.gone() from None
    finally:
        pool.close()


def finished(
    pool: LocalPool | DaskPool,
    function: Callable[..., Any],
    waiting: Iterator[tuple[int, tuple]],
    width: Callable[[], int],
) -> Iterator[tuple[int, tuple, Future]]:
    """(number, task, done future) as they finish, with about `width` under way."""
    running: dict[Future, tuple[int, tuple]] = {}
    while True:
        for number, task in islice(waiting, max(0, width() - len(running))):
            running[pool.submit(alone, function, task)] = number, task
        if not running:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        if any(died(future) for future in done):
            done, _ = wait(running)  # the others of a broken pool end at once, too
        for future in done:
            yield *running.pop(future), future


def died(future: Future) -> bool:
    """Whether a done future's process died in a pool on this machine."""
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def settled(number: int, future: Future) -> Outcome:
    """The outcome of a done future. CancelledError if the cluster gave it up."""
    try:
        return Outcome(number, *future.result())
    except BrokenExecutor:
        return Outcome(number, reason="the process that worked on it died (out of memory?)")
    except CancelledError:
        raise
    except Exception as error:  # Dask's word on a task whose workers died, or inputs that cannot be sent
        return Outcome(number, reason=f"{type(error).__name__}: {error}")
