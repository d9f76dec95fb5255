"""Threads of linear algebra and of compiled loops, limited to one.

Two threads of linear algebra compete for the cores with each other and with other tasks (a 40 us prediction then takes
15 ms) and add in another order, which changes the last digits of an answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")}


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra and compiled loops to one thread."""
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


def thread_limit(api: str | None = None) -> Any:
    """Limit the thread pools of an API ("blas", "openmp"; all of them by default) to one thread, as a context."""
    import scipy.linalg  # noqa: F401  loads its own BLAS, which can be limited only once it is loaded
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, user_api=api)
