"""Everything that can be said of a case before its diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from exodrake.core.robot import Robot
from exodrake.core.text import short_repr
from exodrake.data.case import Case, read_case
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks import check_case, suspicions_of
from exodrake.diagnosis.checks.compare import compare
from exodrake.diagnosis.problem import columns_of, required_of
from exodrake.preflight.identifiability import Identifiability, identifiability
from exodrake.preflight.signals import Channel, Clock, Excitation, channels, clocks, excitations


@short_repr
@dataclass(frozen=True, eq=False)
class Preflight:
    """Checks of a case before its diagnosis: clocks, channels, excitation and identifiability.

    Attributes:
        case: as read.
        clocks: of its logs as recorded.
        channels: of the compared columns.
        excitations: of the references.
        identifiability: which effects it could show and distinguish.
        problems: sentences; none for a good case.
    """

    case: Case
    clocks: tuple[Clock, ...]
    channels: tuple[Channel, ...]
    excitations: tuple[Excitation, ...]
    identifiability: Identifiability
    problems: tuple[str, ...]


def preflight(
    path: str | Path,
    robot: Robot,
    tried: frozenset[str] | None = None,
    allow_outside: bool = False,
    progress: Callable[[str], object] = lambda text: None,
) -> Preflight:
    """Checks a case before its diagnosis.

    Args:
        path: case folder or log.
        robot: nominal robot.
        tried: ids of the effects that a diagnosis would try; its own choice by default.
        allow_outside: whether logs may lie outside the folder.
        progress: called with what is done.

    Raises:
        InputError: where a diagnosis has one.
    """
    case = read_case(path, required_of(robot.machine), robot.machine.frame, allow_outside)
    robot = robot.with_parameters(case.robot, source=case.name) if case.robot else robot
    check_case(case, robot.machine)
    columns_of(case, robot.machine)
    progress("comparing the logs with the nominal robot")
    comparison = compare(case, robot)
    parts = clocks(Path(path), robot.machine.frame), channels(comparison), excitations(case, robot)
    sentences = [sentence for part in parts for item in part for sentence in item.problems()]
    problems = (*case.notes, *sentences, *suspicions_of(comparison), *calibration_notes(robot.machine))
    return Preflight(case, *parts, identifiability(case, robot, tried, progress), tuple(dict.fromkeys(problems)))
