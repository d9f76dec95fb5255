"""Provenance of an answer: date, code, command, robot and files. It holds no absolute path."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from exodrake.core.provenance import configuration, robot_digest
from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.problem import Problem


@dataclass(frozen=True)
class Provenance:
    """Provenance of an answer: code, command, robot, calibration and files.

    Attributes:
        date: Coordinated Universal Time in the form of ISO 8601.
        version: of the package.
        code: first digits of the SHA-256 of the code that finds answers.
        command: as it was typed, absolute paths by their last part; empty for a call from Python.
        robot: file of the nominal robot.
        parameters: first digits of the SHA-256 of its parameters, the overrides of the case included, with variants,
            tolerances and limits.
        calibration: source of the numbers of the tests.
        files: file of the case -> SHA-256; none for a case that was not read from files.
    """

    date: str
    version: str
    code: str
    command: str
    robot: str
    parameters: str
    calibration: str
    files: dict[str, str]


def provenance_of(problem: Problem) -> Provenance:
    """The provenance of an answer that is made now."""
    robot, code = problem.robot, configuration()
    return Provenance(
        date=datetime.now(UTC).replace(microsecond=0).isoformat(),
        version=code["version"],
        code=code["code"],
        command="",
        robot=robot.source or robot.machine.name,
        parameters=robot_digest(robot),
        calibration=calibration_of(robot.machine).source or "none",
        files=dict(problem.case.hashes),
    )
