"""Loops over tasks: in this process, in worker processes (joblib's loky), or on a Dask cluster; and on threads.

Simulations run side by side on several threads, linear algebra on one: two threads of it compete for the cores with
each other and with other tasks (a 40 us prediction then takes 15 ms), and add in another order, so digits change.
"""

import logging
import os
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import chain, islice
from math import inf
from threading import Lock, RLock
from typing import Any, cast

from exodrake.core.errors import InputError, require_extra
from exodrake.core.processes import ONE_THREAD, SAFE_PATH, end_with, safe_path

ONE_TASK = RLock()  # a limit of linear algebra holds for the whole process: threads of a worker take turns
TIMEOUT = "10s"  # for a scheduler to answer
QUEUED = 2  # tasks sent to a cluster per worker, so that no worker waits for its next task
GROWN = "A worker stopped while some jobs"  # loky replaces one that has grown by 300 MB, as the allocator keeps memory
CRASHED = "the worker process crashed (out of memory?)"
COUNTING, busy_helpers = Lock(), 0  # helper threads of this process that do not wait for others


def one_blas_thread() -> Any:
    """Limit linear algebra to one thread, as a context: a second thread does not speed up small products."""
    return thread_limit("blas")


def thread_limit(api: str | None = None, count: int = 1) -> Any:
    """Limit the thread pools of an API ("blas", "openmp"; all of them by default) to some threads, as a context."""
    import scipy.linalg  # noqa: F401  loads its own BLAS, which can be limited only once it is loaded
    from threadpoolctl import threadpool_limits

    return threadpool_limits(count, user_api=api)


def side_by_side[T](tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Results of tasks, which may call it, too, in order, on this thread and on idle ones as far as numba may use some.

    A task gains by it while compiled code or numpy lets other threads run. After an error no other task begins.
    """
    import numba

    waiting, results, limit = iter(range(len(tasks))), [cast(T, None)] * len(tasks), numba.get_num_threads()

    def work() -> None:
        numba.set_num_threads(limit)  # numba keeps it for each thread
        try:
            for k in waiting:
                results[k] = tasks[k]()
        finally:
            list(waiting)  # after an error no task begins
            count_helpers(-1)  # this thread waits from here on: tasks within the last ones may have its core

    count = count_helpers(max(0, min(len(tasks), limit) - 1), limit - 1)
    if not count:
        return [task() for task in tasks]
    try:
        with ThreadPoolExecutor(count) as pool:
            helpers = [pool.submit(work) for _ in range(count)]
            work()
    finally:
        count_helpers(1)
    for helper in helpers:
        helper.result()
    return results


def count_helpers(wanted: int, most: float = inf) -> int:
    """Number of the wanted helper threads that may begin, where `most` may be busy; -1: one has ended, or waits."""
    global busy_helpers
    with COUNTING:
        count = int(min(wanted, max(0, most - busy_helpers)))
        busy_helpers += count
        return count


@dataclass(frozen=True)
class Outcome:
    """Result of task `number` (counted from 0 in the order given): its value, or the reason of its failure."""

    number: int
    value: Any = None
    reason: str | None = None
    trace: str = ""


def each(
    function: Callable[..., Any], tasks: Iterable[tuple], jobs: int = 1, cluster: str | None = None
) -> Generator[Outcome]:
    """Run function(*task) for each task and yield the outcomes as they finish.

    A task that raises yields an outcome with the reason. A worker that crashes costs each task in flight one retry,
    alone on the workers, so that only the task to blame is given up; a Dask scheduler retries as its
    `distributed.scheduler.allowed-failures` says. Tasks are read only as workers become free. Closing the generator
    ends the tasks in flight. `jobs`: worker processes, -1 for one per core, 1 for this process alone; `cluster`:
    address of a Dask scheduler in their place. InputError if it does not answer, or goes away.
    """
    if jobs == 1 and not cluster:
        for number, task in enumerate(tasks):
            yield Outcome(number, *attempt(function, task, alone=False))
        return
    from joblib import cpu_count

    workers = DaskWorkers(cluster) if cluster else LokyWorkers(jobs if jobs > 0 else cpu_count())
    in_flight: dict[Future, tuple[int, tuple]] = {}
    retries: list[tuple[int, tuple]] = []  # tasks in flight at a crash, each of which is a round of its own
    try:
        for round_number, waiting in enumerate(chain([enumerate(tasks)], (iter([task]) for task in retries))):
            while True:
                for number, task in islice(waiting, max(0, workers.capacity() - len(in_flight))):
                    in_flight[workers.submit(attempt, function, task)] = number, task
                if not in_flight:
                    break
                for future in wait(in_flight, return_when=FIRST_COMPLETED).done:
                    number, task = in_flight.pop(future)
                    error = future.exception()
                    if error is None:
                        yield Outcome(number, *future.result())
                    elif not isinstance(error, BrokenExecutor):  # Dask's KilledWorker, or unsendable arguments
                        yield Outcome(number, reason=f"{type(error).__name__}: {error}")
                    elif round_number:
                        yield Outcome(number, reason=CRASHED)
                    else:
                        retries.append((number, task))
    except CancelledError:  # a cluster cancels what it can no longer run
        raise InputError(workers.lost) from None
    finally:
        workers.close()


def attempt(function: Callable[..., Any], task: tuple, alone: bool = True) -> tuple[Any, str | None, str]:
    """Call with one thread, or with one of linear algebra: (value, None, "") or (None, reason, traceback)."""
    import numba

    before = numba.get_num_threads()
    with ONE_TASK, thread_limit(None if alone else "blas"):
        try:
            numba.set_num_threads(1 if alone else before)
            return function(*task), None, ""
        except Exception as error:  # one bad task must not end a long run
            cause: BaseException | None = error  # a compiled function makes a SystemError of Ctrl-C
            while cause is not None:
                if isinstance(cause, KeyboardInterrupt):
                    raise KeyboardInterrupt from None
                cause = cause.__cause__
            trace = traceback.format_exc()
            for place in sorted(filter(None, sys.path), key=len, reverse=True):  # files by their names in Python
                trace = trace.replace(place + os.sep, "")
            return None, f"{type(error).__name__}: {error}", trace
        finally:
            numba.set_num_threads(before)


class LokyWorkers:
    """Processes on this machine; loky starts new ones in place of those that a crash, or their size, has ended."""

    lost = "the worker processes were ended; what was done until then is kept"

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        warnings.filterwarnings("ignore", GROWN, UserWarning)

    def capacity(self) -> int:
        """Number of tasks to have in flight: not more, so that a crash costs none beyond those that run."""
        return self.jobs

    def submit(self, *call: Any) -> Future:
        """Start a call."""
        with safe_path():  # for the processes that clean up after loky; those of workers have it for good
            try:
                return self.find_executor().submit(*call)
            except BrokenExecutor:  # a worker crashed between the two calls
                return self.find_executor().submit(*call)

    def close(self) -> None:
        """End the tasks in flight and release the workers; loky's thread, which waits for them, prints no traceback."""
        before = threading.excepthook

        def report(args: threading.ExceptHookArgs) -> None:
            if args.thread is None or type(args.thread).__module__.partition(".")[0] != "joblib":
                before(args)

        threading.excepthook = report
        try:
            self.find_executor().shutdown(wait=True, kill_workers=True)
        finally:
            threading.excepthook = before

    def find_executor(self) -> Any:
        """The executor of this process: a new one if there is none, or a crash has broken it."""
        from joblib.externals.loky import get_reusable_executor

        return get_reusable_executor(
            self.jobs, env=ONE_THREAD | SAFE_PATH, initializer=end_with, initargs=(os.getpid(),)
        )


class DaskWorkers:
    """An existing Dask cluster; workers may come and go. InputError if Dask is absent or no scheduler answers."""

    def __init__(self, address: str) -> None:
        with require_extra("--cluster: Dask is not installed; install exodrake[cluster]"):
            from distributed import Client
        try:
            self.client = Client(address, timeout=TIMEOUT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--cluster {address}: no Dask scheduler answers ({error})") from None
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # `lost` says it in one line
        self.lost = f"--cluster {address}: the scheduler has gone; what was done until then is kept"
        self.executor = self.client.get_executor(pure=False)
        self.submit = self.executor.submit

    def capacity(self) -> int:
        """Number of tasks to have in flight."""
        try:
            workers: Any = self.client.nthreads()
        except OSError:
            raise InputError(self.lost) from None
        return QUEUED * max(1, len(workers))

    def close(self) -> None:
        """End the tasks in flight and release the workers."""
        self.executor.shutdown(wait=False)
        self.client.close(timeout=TIMEOUT)
