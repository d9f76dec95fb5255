"""Loops in worker processes: equal outcomes, and no task lost to the crash of another."""

import os
import signal
import time

import numba
import pytest
from threadpoolctl import threadpool_info

from exodrake.core import parallel
from exodrake.core.errors import InputError
from exodrake.core.parallel import each

HOARD = []


def square(number):
    time.sleep(0.02 * (3 - number % 4))  # so that they do not finish in order
    return number**2


def picky(number):
    if number == 1:
        raise ValueError("one is not wanted")
    return number


def deadly(number):
    time.sleep(0.3)
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def threads(_):
    import scipy.linalg  # noqa: F401

    pools = [item["num_threads"] for item in threadpool_info() if item["user_api"] == "blas"]
    return max(pools), numba.get_num_threads()


def hoard(number):
    """The number, and the process that keeps 400 MB for good."""
    HOARD.append(bytearray(400_000_000))
    time.sleep(1.1)  # loky looks once a second
    return number, os.getpid()


def values(outcomes):
    return {item.number: item.value for item in outcomes}


@pytest.mark.parametrize("jobs", [1, 2])
def test_outcomes_do_not_depend_on_the_number_of_processes(jobs):
    assert values(each(square, ((number,) for number in range(9)), jobs)) == {n: n**2 for n in range(9)}


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_task_that_raises_returns_its_reason_and_others_continue(jobs):
    outcomes = {item.number: item for item in each(picky, ((number,) for number in range(4)), jobs)}
    assert outcomes[1].reason == "ValueError: one is not wanted" and "in picky" in outcomes[1].trace
    assert [outcomes[number].value for number in (0, 2, 3)] == [0, 2, 3]


def interrupted_in_compiled_code():
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise SystemError("a result with an exception set") from error


def test_ctrl_c_in_compiled_code_ends_the_loop():
    with pytest.raises(KeyboardInterrupt):
        list(each(interrupted_in_compiled_code, [(), ()]))


def test_a_crash_gives_up_only_the_task_that_caused_it():
    outcomes = {item.number: item for item in each(deadly, ((number,) for number in range(6)), 2)}
    assert {n: item.value for n, item in outcomes.items()} == {n: None if n == 2 else n for n in range(6)}
    assert "crashed" in outcomes[2].reason


def test_a_worker_that_has_grown_is_replaced_in_silence(recwarn):
    found = [outcome.value for outcome in each(hoard, [(k,) for k in range(6)], jobs=2)]
    assert sorted(number for number, _ in found) == list(range(6)) and len({pid for _, pid in found}) > 2
    assert not [item for item in recwarn if "worker" in str(item.message)]


@pytest.mark.parametrize(("jobs", "simulations"), [(1, numba.get_num_threads()), (2, 1)])
def test_linear_algebra_has_one_thread_and_so_have_simulations_of_a_worker(jobs, simulations):
    assert set(values(each(threads, [(0,), (1,)], jobs)).values()) == {(1, simulations)}


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_read_only_as_workers_become_free(jobs):
    read = []

    def tasks():
        for number in range(1000):
            read.append(number)
            yield (number,)

    outcomes = each(square, tasks(), jobs)
    next(outcomes)
    outcomes.close()
    assert len(read) <= 2 * jobs


def test_absent_scheduler_is_an_input_error(monkeypatch):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.setattr(parallel, "TIMEOUT", "1s")
    with pytest.raises(InputError, match=r"127\.0\.0\.1:9.*no Dask scheduler answers"):
        next(each(square, [(1,)], cluster="127.0.0.1:9"))
