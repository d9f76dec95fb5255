"""The exam: real machines, each from its folder to a verdict, judged against the experts' fit and held-out motion.

An answer agrees if its causes are of the kinds that experts fitted to the same recording, and none of these is missing
from its effects; rivals of a cause count as it does. The error on motion that was not fitted is compared with that of
the best simple model which those experts give. Who fitted what, and to what error: DATA/README.md. [D]: the model of
those who recorded the xl330, Duclusaud et al., ICRA 2025.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, markdown_table
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import CAUSE, Diagnosis
from exodrake.diagnosis.search import name_kind
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot
from studies.real_machines.recordings import READERS, halve_log

LATENCY, LAG, SPEED = "delay", "lag", "speed limit"
DRY, VISCOUS, OFFSET, PLAY = "dry friction", "viscous friction", "offset", "backlash"
SAG, INERTIA, GAIN, COUPLING = "load", "inertia", "gain", "crosstalk"
LOAD = "load-dependent friction"


@dataclass(frozen=True)
class Paper:
    """One recording of the exam."""

    name: str
    fit: str  # experts' fit in words
    wanted: tuple[str, ...]  # kinds of effect that the fit has
    allowed: tuple[str, ...]  # further kinds that experts name as possible, or cannot tell from those
    simple: Mapping[str, float]  # column, or its beginning -> error of the best simple model on held-out motion [SI]
    build: Callable[[Path], tuple[Case, Robot]]  # case and robot from the folder of all recordings
    relative: bool = False  # whether `simple` is relative to the measured signal


@dataclass(frozen=True, eq=False)
class Mark:
    """What an answer is worth."""

    paper: Paper
    found: Diagnosis
    agrees: bool  # whether its causes are those of the experts' fit
    # column -> error on held-out motion of the nominal and of the improved robot, and of the simple model
    errors: Mapping[str, tuple[float, float, float]]

    @property
    def no_worse(self) -> bool:
        """Whether the error on held-out motion is no larger than the simple model's, RMS over the columns."""
        return sum((a / s) ** 2 for _, a, s in self.errors.values()) <= len(self.errors)


def owner(data: Path, name: str) -> tuple[Robot, Callable[[str], CaseLog]]:
    """Robot of an owner's machine folder, and a reader of its recordings by name."""
    from exodrake.core.plugins import add_plugin
    from exodrake.data.import_log import import_recording, read_mapping

    add_plugin(data / name / name)

    def read(recording: str) -> CaseLog:
        file, mapped = f"{recording}.csv", read_mapping(data / name / name / "mapping.yaml")
        return CaseLog(import_recording(data / name / file, mapped).log, recording, "fit", None, file)

    return load_robot(str(data / name / name / "robot.yaml")), read


def split(name: str, fitted: Sequence[str], held: Sequence[str] = ()) -> Callable[[Path], tuple[Case, Robot]]:
    """Some recordings of an owner's machine fitted, others held out; first halves and second halves without others."""

    def build(data: Path) -> tuple[Case, Robot]:
        robot, read = owner(data, name)
        logs = (*map(read, fitted), *(replace(read(r), role="holdout") for r in held))
        logs = logs if held else tuple(part for item in logs for part in halve_log(item.log, item.protocol))
        return Case(name, {}, logs, robot.machine.frame), robot

    return build


def ours(name: str, folder: str, *runs: str, held: str = "") -> Callable[[Path], tuple[Case, Robot]]:
    """A set that the project has a reader for; runs: some folders of it, as the reader splits them.

    With `held`, another one, they are fitted whole, and it is held out.
    """

    def build(data: Path) -> tuple[Case, Robot]:
        places = [data / folder / run for run in (*runs, held) if run] or [data / folder]
        cases = [READERS[name](place) for place in places]
        logs = [item for case in cases for item in case.logs]
        if held:
            logs = [replace(i, role="holdout" if c is cases[-1] else "fit") for c in cases for i in c.logs]
        return replace(cases[0], logs=tuple(logs)), load_robot(name)

    return build


def joints(*errors: float) -> dict[str, float]:
    """Errors of the SO-101's joints [mrad] as columns [rad]."""
    names = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
    return {f"angle_{name}": error * 1e-3 for name, error in zip(names, errors, strict=True)}


HOBBY = "chirp1 prbs1 prbs2 ramp1 ramp2 triangle1 triangle2 square1 square2 square3"
HOBBY_HELD = "prbs3 ramp5 triangle5 square6 step8"
XL330 = tuple(
    f"xl_{n}" for n in ("200_sin_sin", "400_sin_sin", "400_sin_time_square", "800_sin_time_square", "800_up_and_down")
)
HSM150 = ("hsm_neg_0.045_1", "hsm_pos_0.065_1", "hsm_neg_0.04_1")
SERVO = (LATENCY, LAG, PLAY, SAG)
PAPERS = (
    Paper("wam", "Coulomb and viscous friction on both joints", (DRY, VISCOUS), (OFFSET,),
          {"effort_J2": 2.05, "effort_J4": 0.36}, split("wam", ("wam_1", "wam_2"))),
    Paper("hsm150", "Coulomb, viscous, offset", (DRY, VISCOUS, OFFSET), (), {"effort": 2.2e-3},
          split("hsm150", HSM150, ("hsm_pos_0.06_1",))),
    Paper("hobby_servo", "delay and speed limit", (LATENCY, SPEED), (),
          {"angle": float(np.sqrt(np.mean(np.square([0.079, 0.017, 0.042, 0.110, 0.042]))))},
          split("hobby_servo", *([f"hobby_{n}" for n in names.split()] for names in (HOBBY, HOBBY_HELD)))),
    Paper("xl330", "Coulomb, viscous, inertia, torque constant, mass, friction by load [D]; nothing closes it",
          (DRY,), (VISCOUS, INERTIA, GAIN, SAG, OFFSET, LOAD), {"effort": 0.132},
          split("xl330", XL330, ("xl_800_sin_sin",))),
    Paper("fairino", "dry friction; more terms help little", (DRY,), (VISCOUS, OFFSET), {"effort": 2.75},
          split("fairino", ("fai_S",), ("fai_zhixian",))),
    Paper("emps", "Coulomb, viscous, offset or friction by direction", (DRY, VISCOUS), (OFFSET,),
          {"force": 0.0408}, ours("emps", "emps/DATA_EMPS.mat"), relative=True),
    Paper("tendon sheath", "play that grows with bend, offset", (PLAY,), (OFFSET, GAIN),
          {"angle": radians(1.9)}, ours("tendon_sheath", "tendon_sheath")),
    Paper("dVRK wrist", "offset, play of the joint's own cable, neighbours", (OFFSET, PLAY),
          (GAIN, COUPLING, "friction"), {"angle": radians(1.2)}, ours("dvrk_wrist", "dvrk_wrist")),
    Paper("SO-101, two motions", "latency, dead band, sag, lag", SERVO, ("hysteresis", SPEED),
          {k: float(np.hypot(a, b) / np.sqrt(2.0)) for (k, a), b in zip(
              joints(9.3, 17.0, 19.0, 2.4, 2.1, 1.5).items(), joints(9.0, 42.2, 38.9, 9.9, 11.2, 30.0).values(),
              strict=True)},
          ours("so101", "sage_so101", "friction_gravity", "prbs_excitation")),
    Paper("SO-101, backlash run", "latency, dead band, sag", (LATENCY, PLAY, SAG), (LAG, OFFSET, SPEED, "hysteresis"),
          joints(2.8, 5.3, 9.5, 7.7, 9.1, 11.7),
          ours("so101", "sage_so101", "backlash_detection", held="friction_gravity")),
    Paper("SO-101, multisine", "latency, dead band, sag, lag", SERVO, ("hysteresis", SPEED), {},
          ours("so101", "sage_so101", "multisine")),
)  # fmt: skip


def marked(paper: Paper, data: Path) -> Mark:
    """The mark of one recording. InputError where it cannot be diagnosed."""
    case, robot = paper.build(data)
    found = diagnose(case, robot)
    kinds = {e.id: e.kind for e in found.effects}
    known = {e.id: e for e in robot.machine.effects}
    causes = [e for e in found.effects if e.role == CAUSE]
    classes = [{e.kind, *(name_kind(known[r.id]) for r in e.rivals)} for e in causes]
    expected = {*paper.wanted, *paper.allowed}
    fits = bool(causes) and all(c & expected for c in classes)
    seen = {*kinds.values(), *(k for c in classes for k in c)}
    errors, problem = {}, found.problem
    if paper.simple and problem is not None and problem.holdout:
        # with the samples about rest that a diagnosis leaves out: the simple models are judged on all
        restless = make_problem(case, replace(robot, machine=replace(robot.machine, resting={})))
        whole = replace(problem, holdout=restless.holdout)
        rows = np.array([whole.silent(found.robots[name]) for name in ("nominal", "retuned", "improved")])
        gaps = measure(whole, [rows] * len(whole.judged)).signals
        for i, column in enumerate(problem.columns):
            limit = next((v for name, v in paper.simple.items() if column.startswith(name)), None)
            if limit is not None:
                size = np.sqrt(np.nanmean(np.concatenate([t.measured[:, i] for t in whole.holdout]) ** 2))
                limit *= float(size) if paper.relative else 1.0
                errors[column] = gaps[column].before, gaps[column].after, limit
    return Mark(paper, found, fits and seen >= set(paper.wanted), errors)


def answer(mark: Mark) -> str:
    """The answer in a cell: verdict, causes, refinements."""
    effects = mark.found.effects
    causes = [f"**{e.id}**" + (f" (or {', '.join(r.id for r in e.rivals)})" if e.rivals else "")
              for e in effects if e.role == CAUSE]  # fmt: skip
    rest = [e.id for e in effects if e.role != CAUSE]
    return f"{mark.found.verdict}: {', '.join(causes) or 'no cause'}" + (f"; {', '.join(rest)}" if rest else "")


def rms(mark: Mark) -> str:
    """Held-out errors in a cell: nominal, improved and simple model, RMS over the columns, relative to the latter."""
    if not mark.errors:
        return "not compared"
    before, after = (np.sqrt(np.mean([(e[k] / e[2]) ** 2 for e in mark.errors.values()])) for k in (0, 1))
    return f"{before:.3g} -> {after:.3g}" + ("" if mark.no_worse else " (worse)")


def table(marks: Sequence[Mark]) -> str:
    """The exam as a table, wrong answers first."""
    order = sorted(marks, key=lambda m: (m.agrees, m.no_worse))
    head = ("recording", "experts' fit", "answer: causes; refinements", "left", "error [simple model's]", "agrees")
    rows = []
    for m in order:
        left, agrees = f"{m.found.remainder.value:.1%}", "yes" if m.agrees else "**no**"
        rows.append((m.paper.name, m.paper.fit, answer(m), left, rms(m), agrees))
    return markdown_table(head, rows)


def exam(data: Path, progress: Callable[[str], None] = lambda step: None) -> list[Mark]:
    """Marks of all recordings whose folders are there."""
    found = []
    for paper in PAPERS:
        progress(paper.name)
        try:
            found.append(marked(paper, data))
        except InputError as error:
            progress(f"{paper.name}: {error}")
    return found
