"""Threads: simulations side by side on several, linear algebra on one.

Two threads of linear algebra compete for the cores with each other and with other tasks (a 40 us prediction then takes
15 ms) and add in another order, which changes the last digits of an answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from math import inf
from threading import Lock
from typing import Any, cast

ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")}


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra and simulations to one thread."""
    import numba

    before = numba.get_num_threads()
    with thread_limit():
        numba.set_num_threads(1)
        try:
            yield
        finally:
            numba.set_num_threads(before)


def one_blas_thread() -> Any:
    """Limit linear algebra to one thread, as a context: a second thread does not speed up small products."""
    return thread_limit("blas")


def thread_limit(api: str | None = None, count: int = 1) -> Any:
    """Limit the thread pools of an API ("blas", "openmp"; all of them by default) to some threads, as a context."""
    import scipy.linalg  # noqa: F401  loads its own BLAS, which can be limited only once it is loaded
    from threadpoolctl import threadpool_limits

    return threadpool_limits(count, user_api=api)


def side_by_side[T](tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Results of tasks, in their order, on this thread and on idle ones as far as numba may use several.

    Tasks may call it, too: what is idle then helps with theirs. A task gains by it while it simulates or works on
    arrays, as compiled code and numpy let other threads run. After an error no other task begins.
    """
    import numba

    waiting, results, limit = iter(range(len(tasks))), [cast(T, None)] * len(tasks), numba.get_num_threads()

    def work() -> None:
        try:
            for k in waiting:
                results[k] = tasks[k]()
        finally:  # after an error no task begins
            list(waiting)

    def help_out() -> None:
        numba.set_num_threads(limit)  # numba keeps it for each thread
        try:
            work()
        finally:
            HELPERS.leave()

    count = HELPERS.enter(min(len(tasks), limit) - 1, limit - 1)
    if not count:
        work()
        return results
    try:
        with ThreadPoolExecutor(count) as pool:
            helpers = [pool.submit(help_out) for _ in range(count)]
            try:
                work()
            finally:
                HELPERS.leave()  # this thread waits from here on: tasks within the last ones may have its core
    finally:
        HELPERS.enter(1)
    for helper in helpers:
        helper.result()
    return results


class Helpers:
    """Count of busy helper threads of this process, less those that wait for others."""

    def __init__(self) -> None:
        self.lock, self.busy = Lock(), 0

    def enter(self, wanted: int, most: float = inf) -> int:
        """Number of the wanted helpers that may begin, where `most` may be busy at once."""
        with self.lock:
            count = int(max(0, min(wanted, most - self.busy)))
            self.busy += count
            return count

    def leave(self) -> None:
        """One helper has ended, or waits."""
        with self.lock:
            self.busy -= 1


HELPERS = Helpers()
