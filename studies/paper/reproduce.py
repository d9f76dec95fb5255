"""All chapters, the estimator's first."""

from __future__ import annotations

from dataclasses import dataclass

from studies.paper.claim import FULL, Chapter, Claim, Effort
from studies.paper.study import Study


@dataclass(frozen=True, eq=False)
class Reproduction:
    """chapters of the page, the study behind Fig. 10 and 11, the seed and the seconds it took."""

    chapters: tuple[Chapter, ...]
    study: Study
    seed: int
    seconds: float

    @property
    def claims(self) -> tuple[Claim, ...]:
        """The register, chapter by chapter."""
        return tuple(claim for chapter in self.chapters for claim in chapter.claims)


def reproduce(effort: Effort = FULL, seed: int = 0) -> Reproduction:
    """Computes every chapter from simulation, in a minute on one core; compiling the simulator takes one more."""
    from time import perf_counter

    from threadpoolctl import threadpool_limits

    from exodrake.machines.robot_file import load_robot
    from studies.paper import arms, centres, equations, estimation, hardware, reach
    from studies.paper.study import study

    start, robot = perf_counter(), load_robot()
    with threadpool_limits(1):  # many small products: a second thread only waits
        found = study(robot, effort, seed)
    chapters = (
        estimation.chapter(found),
        arms.chapter(),
        equations.chapter(robot),
        hardware.chapter(robot, found.rate),
        centres.chapter(centres.record(effort.marker_seconds, seed)),
        reach.chapter(robot, effort.tensions),
    )
    return Reproduction(chapters, found, seed, perf_counter() - start)
