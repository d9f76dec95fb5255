"""Whether an answer depends on the processor: the practice cases by the linear algebra of several of them.

python -m studies.processors --data folder --out folder     # half an hour on one core; prints the table

OpenBLAS picks its code by the processor; OPENBLAS_CORETYPE names another one. Answers by today's code are kept.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import click

from exodrake.core.errors import InputError
from exodrake.core.processes import ONE_THREAD
from exodrake.core.provenance import configuration
from studies.page_text import made

KERNELS = ("Haswell", "SkylakeX", "Sandybridge")  # AMD's Zen runs the code of Haswell in the wheels of numpy and scipy
L2_SIZE = "512"  # kB: where a virtual machine hides its cache, Haswell's code crashes in a plain product without it
ALIKE = 0.1  # of a 90 % interval, by which a value may differ
WHICH = (
    "import numpy, scipy.linalg, threadpoolctl;"
    "print(*{p['architecture'] for p in threadpoolctl.threadpool_info() if p['user_api'] == 'blas'})"
)


def environment(kernel: str) -> dict[str, str]:
    """Environment variables of a process whose linear algebra is that of a processor."""
    path = os.pathsep.join(filter(None, sys.path))  # modules come from where this process has them
    own = {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_L2_SIZE": L2_SIZE, "PYTHONPATH": path}
    return os.environ | ONE_THREAD | own


def used(kernel: str) -> list[str]:
    """The kernels that numpy and scipy use where one is wanted: others where the processor lacks its instructions."""
    return subprocess.run(
        [sys.executable, "-c", WHICH], env=environment(kernel), capture_output=True, text=True, check=True
    ).stdout.split()


def answered(case: Path, out: Path, kernel: str) -> dict[str, Any]:
    """The answer to a case by the linear algebra of a processor, kept in `out` while the code is the same."""
    path = out / kernel / f"{case.name}.json"
    if not path.exists() or json.loads(path.read_text())["provenance"]["code"] != configuration()["code"]:
        path.parent.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, "-m", "exodrake", "diagnose", str(case), "--jobs", "1", "--json", str(path)]
        run = subprocess.run(words, env=environment(kernel), capture_output=True, text=True)
        if run.returncode:
            why = run.stderr.strip()[-500:] or f"ended by {run.returncode}, as where a processor lacks instructions"
            raise InputError(f"{case} with {kernel}: {why}")
    return json.loads(path.read_text())


def named(answer: dict[str, Any]) -> tuple[Any, ...]:
    """What must not depend on the processor: verdict, place, effects with role, channels and rivals."""
    effects = [
        (e["id"], e["role"], e["wires"], e["joints"], sorted(e["channels"]), [r["id"] for r in e["rivals"]])
        for e in answer["effects"]
    ]
    return answer["verdict"], answer["where"]["block"], effects


def intervals(answer: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The 90 % intervals of all parameters that an answer names."""
    for effect in answer["effects"]:
        for name, interval in effect["parameters"].items():
            yield interval
            yield from effect["channels"].get(name, {}).values()


def apart(answers: list[dict[str, Any]]) -> float:
    """Largest difference of a value between answers that name the same, in widths of its narrowest interval."""
    found = [0.0]
    for same in zip(*map(intervals, answers), strict=True):
        if any(i["value"] is None for i in same):  # channels differ, and count one by one
            continue
        values, width = [i["value"] for i in same], min(i["high"] - i["low"] for i in same)
        found.append((max(values) - min(values)) / width if max(values) > min(values) else 0.0)
    return max(found)


def row(case: Path, answers: list[dict[str, Any]]) -> str:
    """The row of a case in the table."""
    first, same = answers[0], all(named(a) == named(answers[0]) for a in answers)
    effects = ", ".join(f"`{e['id']}`" for e in first["effects"]) or "–"
    closures = [a["closure"]["overall"]["value"] for a in answers if a["closure"]["overall"]["value"] is not None]
    spread = f"{max(closures) - min(closures):.1e}" if closures else "–"
    widths = f"{apart(answers):.3f}" if same else "–"
    return f"| {case.name} | {first['verdict']} | {effects} | {'yes' if same else 'no'} | {widths} | {spread} |"


@click.command()
@click.option("--data", type=click.Path(path_type=Path), default="../shared/data/practice", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Answers, kept for the next run.")
@click.option("--kernels", default=",".join(KERNELS), show_default=True)
@click.option("--jobs", default=1, show_default=True, help="Processor cores to use.")
def main(data: Path, out: Path, kernels: str, jobs: int) -> None:
    """Diagnose all cases of a folder by the linear algebra of several processors, and print the table."""
    cases, wanted = sorted(p.parent for p in data.glob("*/case.yaml")), kernels.split(",")
    if not cases:
        raise click.ClickException(f"{data}: no cases")
    for kernel in wanted:
        if used(kernel) != [kernel]:
            raise click.ClickException(f"{kernel}: this processor uses {', '.join(used(kernel))} instead")
    click.echo(
        f"{made()}\n\n| case | verdict | effects | the same | apart | closure apart |\n|---|---|---|---|---|---|"
    )
    with ThreadPoolExecutor(jobs) as pool:
        for case in cases:
            click.echo(row(case, list(pool.map(partial(answered, case, out), wanted))))


if __name__ == "__main__":
    main()
