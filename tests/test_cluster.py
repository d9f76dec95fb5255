"""Loops on a real Dask cluster of two worker processes, one of which is killed on the way."""

import os
import signal
import time
from dataclasses import replace

import pytest

import exodrake as exo
from exodrake.core import parallel
from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.diagnosis.many import diagnose_all, read_stored
from exodrake.reference import make
from exodrake.reference.answers import read_committed
from exodrake.reference.cases import MIXES
from exodrake.simulation import protocols
from exodrake.simulation.protocols import on_machine
from tests.short_sets import answers

distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes of one thread each, on this machine; one that is killed is started anew."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as found:
        yield found


def workers(cluster):
    """Process ids of the workers."""
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        return sorted(client.run(os.getpid).values())


def slowly(number):
    time.sleep(0.1)
    return os.getpid(), number**2


def threads():
    import numba
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    return max(item["num_threads"] for item in threadpool_info()), numba.get_num_threads()


def test_a_killed_worker_loses_no_task(cluster):
    before = workers(cluster)
    found, helpers = {}, set()
    for outcome in each(slowly, ((number,) for number in range(40)), cluster=cluster.scheduler_address):
        assert outcome.number not in found
        helper, found[outcome.number] = outcome.value
        helpers.add(helper)
        if len(found) == 10:
            os.kill(before[0], signal.SIGKILL)
    assert found == {number: number**2 for number in range(40)}
    assert before[1] in helpers and workers(cluster) != before


def test_every_task_has_one_thread_and_one_whose_workers_die_each_time_is_given_up_alone(cluster):
    assert [item.value for item in each(threads, [()], cluster=cluster.scheduler_address)] == [(1, 1)]
    outcomes = list(each(os._exit, [(1,)], cluster=cluster.scheduler_address))
    assert [item.value for item in outcomes] == [None] and "KilledWorker" in outcomes[0].reason
    assert next(each(slowly, [(3,)], cluster=cluster.scheduler_address)).value[1] == 9


def sheath_case(number):
    """Two logs of 4 s of a rigid sheath: a case that is diagnosed in less than a second."""
    nominal, logs = exo.load_robot("tendon_sheath"), []
    for k in range(2):
        motion = on_machine(protocols.random_motion, nominal, duration=4.0, seed=2 * number + k, fastest=1.0)
        logs.append(CaseLog(exo.simulate(nominal, motion, seed=2 * number + k), "random", "fit", None, f"{k}.csv"))
    return Case(f"{number}", {}, tuple(logs), nominal.machine.frame)


def test_a_killed_worker_and_a_second_run_lose_no_case_and_answer_none_twice(cluster, tmp_path):
    places, local = {}, {}
    for number in range(5):
        folder = tmp_path / "cases" / f"{number}"
        write_case(sheath_case(number), folder)
        places[folder], local[folder] = tmp_path / "there" / f"{number}", tmp_path / "here" / f"{number}"
    some, address = dict(list(places.items())[:2]), cluster.scheduler_address
    assert diagnose_all(some, cluster=address, robot="tendon_sheath") == {}
    kept = {place: read_stored(place)["seconds"] for place in some.values()}
    victims, counted = workers(cluster)[:1], []

    def progress(done, failed, total):
        if done > 2 and victims:
            os.kill(victims.pop(), signal.SIGKILL)
        counted.append((done, failed, total))

    assert diagnose_all(places, cluster=address, progress=progress, robot="tendon_sheath") == {}
    assert counted == [(done, 0, 5) for done in range(2, 6)] and not victims
    assert {place: read_stored(place)["seconds"] for place in some.values()} == kept
    assert diagnose_all(local, robot="tendon_sheath") == {}
    assert answers(tmp_path / "there") == answers(tmp_path / "here") and len(answers(tmp_path / "here")) == 5


def test_a_set_made_there_is_the_set_made_here(cluster, tmp_path):
    made = {
        where: make.make(tmp_path / where, 5, 2, mixes=[replace(MIXES["healthy"], duration=0.25)], cluster=address)
        for where, address in (("here", None), ("there", cluster.scheduler_address))
    }
    logs = {
        where: {path.relative_to(tmp_path / where): path.read_bytes() for path in (tmp_path / where).glob("*/*")}
        for where in made
    }
    assert logs["here"] == logs["there"] and len(logs["here"]) == 12
    committed = [read_committed(labels, tmp_path / where / "seal.txt") for where, labels in made.items()]
    assert committed[0] == committed[1]


def test_a_lost_scheduler_is_an_input_error_and_outcomes_are_kept(monkeypatch):
    monkeypatch.setattr(parallel, "TIMEOUT", "2s")
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50)
    outcomes = each(slowly, ((number,) for number in range(1000)), cluster=cluster.scheduler_address)
    assert next(outcomes).reason is None
    cluster.close()
    with pytest.raises(InputError, match="the scheduler has gone"):
        list(outcomes)
