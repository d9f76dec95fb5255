"""Tasks side by side on the threads that numba may use."""

import threading
import time

import numba
import pytest
from diagnosis_cases import FRAMES, case_of, robot_with

from exodrake.core.parallel import HELPERS, side_by_side
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot

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
    assert HELPERS.busy == 0


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
    assert HELPERS.busy == 0
    assert side_by_side([lambda: 7]) == [7]


def test_an_isolation_is_the_same_on_one_thread_and_on_three(monkeypatch):
    problem = make_problem(case_of(robot_with("mocap.offset", 1, offset=0.1), 1, FRAMES // 4), load_robot(), TRIED)
    monkeypatch.setattr(numba, "set_num_threads", lambda count: None)
    found = {}
    for count in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda count=count: count)
        sets = isolate(problem).search.sets
        found[count] = {key: (*f.chi2, *f.explanation.x) for key, f in sets.items()}
    assert len(found[1]) > 1 and found[1] == found[3]
