"""Loops in worker processes and tasks on threads: equal outcomes, and no task lost to the crash of another."""

import os
import signal
import threading
import time

import numba
import pytest
from threadpoolctl import threadpool_info

from exodrake.core import parallel
from exodrake.core.errors import InputError
from exodrake.core.parallel import each, side_by_side

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
    if number == 1:
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
    outcomes = {item.number: item for item in each(deadly, ((number,) for number in range(4)), 2)}
    assert {n: item.value for n, item in outcomes.items()} == {0: 0, 1: None, 2: 2, 3: 3}
    assert "crashed" in outcomes[1].reason


def test_a_worker_that_has_grown_is_replaced_in_silence(recwarn):
    found = [outcome.value for outcome in each(hoard, [(k,) for k in range(5)], jobs=2)]
    assert sorted(number for number, _ in found) == list(range(5)) and len({pid for _, pid in found}) > 2
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


TRIED = frozenset(("tendon.capstan_friction", "mocap.offset", "sensor.drift"))


@pytest.fixture(params=[1, 2, 3])
def limit(request, monkeypatch):
    """So many threads, whatever numba began with in this process."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)
    monkeypatch.setattr(numba, "set_num_threads", lambda count: None)
    return request.param


def test_results_come_in_the_order_of_the_tasks(limit):
    def late(k):
        time.sleep(0.002 * (5 - k))
        return k

    assert side_by_side([lambda k=k: late(k) for k in range(6)]) == list(range(6))
    assert side_by_side([]) == []


def test_tasks_within_tasks_never_take_more_threads_than_allowed(limit):
    lock, running, most = threading.Lock(), set(), []

    def leaf():
        with lock:
            running.add(threading.get_ident())
            most.append(len(running))
        time.sleep(0.002)
        with lock:
            running.discard(threading.get_ident())
        return 1

    found = side_by_side([lambda: sum(side_by_side([leaf] * 4)) for _ in range(5)])
    assert found == [4] * 5
    assert max(most) <= limit
    assert parallel.busy_helpers == 0


def test_as_many_tasks_as_threads_run_at_once(limit):
    together = threading.Barrier(limit)  # opens once all are there
    assert len(side_by_side([lambda: together.wait(60.0)] * limit)) == limit


def test_after_an_error_no_task_begins_and_it_is_raised(limit):
    begun, failed = [], threading.Event()

    def task(k):
        begun.append(k)
        if k == 1:
            failed.set()
            raise ZeroDivisionError
        if k:
            failed.wait()
            time.sleep(0.2)  # longer than an error takes to be seen
        return k

    with pytest.raises(ZeroDivisionError):
        side_by_side([lambda k=k: task(k) for k in range(50)])
    assert len(begun) <= 2 + limit
    assert parallel.busy_helpers == 0
    assert side_by_side([lambda: 7]) == [7]


def test_an_isolation_is_the_same_on_one_thread_and_on_three(monkeypatch):
    from diagnosis_cases import FRAMES, case_of, load_robot, make_problem, robot_with  # not in each worker

    from exodrake.diagnosis.isolation import isolate

    problem = make_problem(case_of(robot_with("mocap.offset", 1, offset=0.1), 1, FRAMES // 4), load_robot(), TRIED)
    monkeypatch.setattr(numba, "set_num_threads", lambda count: None)
    found = {}
    for count in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda count=count: count)
        sets = isolate(problem).search.sets
        found[count] = {key: (*f.chi2, *f.explanation.x) for key, f in sets.items()}
    assert len(found[1]) > 1 and found[1] == found[3]
