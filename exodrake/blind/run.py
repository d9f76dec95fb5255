"""Diagnosing every case of a blind set, resumably: a case with a whole diagnosis.json is done, any other is not."""

import json
from pathlib import Path
from typing import Any

from exodrake.errors import InputError

ANSWER = "diagnosis.json"


def cases_of(folder):
    """Case folders of a set, sorted. InputError if there is none."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    cases = sorted(path.parent for path in folder.glob("*/case.yaml") if not path.parent.name.startswith("."))
    if not cases:
        raise InputError(f"{folder}: no case in it (a folder with case.yaml)")
    return cases


def finished(case):
    """True if the case has a diagnosis that can be read."""
    try:
        return "verdict" in json.loads((case / ANSWER).read_text())
    except (OSError, ValueError):
        return False


def diagnose_one(case):
    """Name, diagnosis as JSON text, and None; or name, None and the reason why there is none."""
    from exodrake.case import read_case
    from exodrake.diagnosis import diagnose

    case = Path(case)
    try:
        answer = diagnose(read_case(case)).to_json()
        return case.name, answer if isinstance(answer, str) else json.dumps(answer, indent=1, default=float), None
    except Exception as error:  # one bad case must not end a night's run
        return case.name, None, f"{type(error).__name__}: {error}"


def backend(jobs, cluster):
    """joblib configuration: processes here, or an existing Dask cluster. InputError if Dask is absent or nobody
    answers.
    """
    from joblib import parallel_config

    if not cluster:
        return parallel_config(backend="loky", n_jobs=jobs)
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--cluster: Dask is not installed; install exodrake[cluster]") from None
    try:
        client = Client(cluster, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {cluster}: no Dask scheduler answers ({error})") from None
    return parallel_config(backend="dask", client=client, n_jobs=-1)


def run(folder, jobs=1, cluster=None, progress=None):
    """Diagnose the unfinished cases of a set; an interruption loses nothing that was written.

    progress: called with (done, total). Returns {case: reason} for those that failed; they stay unfinished.
    InputError as `cases_of`, `backend`.
    """
    from joblib import Parallel, delayed

    from exodrake.files import write_text

    cases = cases_of(folder)
    waiting = [case for case in cases if not finished(case)]
    done, failed = len(cases) - len(waiting), {}
    report = progress or (lambda done, total: None)
    report(done, len(cases))
    if not waiting:
        return failed
    with backend(jobs, cluster):
        work = (delayed(diagnose_one)(str(case)) for case in waiting)
        results: Any = Parallel(return_as="generator_unordered")(work)
        for name, text, reason in results:
            if text is None:
                failed[name] = reason
            else:
                write_text(Path(folder) / name / ANSWER, text)
            done += 1
            report(done, len(cases))
    return failed
