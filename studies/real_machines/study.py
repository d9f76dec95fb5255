"""Diagnosis of the four sets, fits of growing models, and figures: the results of `docs/real.md`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from exodrake.data.case import Case
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.result import Diagnosis
from exodrake.machines.library import reader
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot
from studies.real_machines import figures
from studies.real_machines.growing_models import growing_models, predicted
from studies.real_machines.measures import decimated, inverse_dynamics, relative_error, rms_degrees
from studies.real_machines.recordings import FOLDERS, MODELS

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Result:
    """Results on a set: the diagnosis, fitted robots, tables (title -> rows, the first a header), figures."""

    name: str
    diagnosis: Diagnosis
    robots: dict[str, Robot] = field(default_factory=dict)
    tables: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    figures: tuple[str, ...] = ()


def study(name: str, data: Path, out: Path, progress: Progress) -> Result:
    """One set, diagnosed and tabulated; figures are written into `out`."""
    case, robot = reader(name)(data / FOLDERS[name]), load_robot(name)
    found = diagnose(case, robot, lambda stage, detail: progress(f"{name}: {stage.text} {detail}"))
    progress(f"{name}: growing models")
    return STUDIES[name](found, case, robot, data, out)


def emps(found: Diagnosis, case: Case, robot: Robot, data: Path, out: Path) -> Result:
    """Relative force error on held-out cycles, as published; parameters against the published ones."""
    problem = make_problem(case, robot)
    force, trial = problem.columns.index("force_carriage"), problem.holdout[0]
    measured = trial.measured[:, force]
    before, after = (predicted(problem, found.robots[k], [trial])[0][:, force] for k in ("nominal", "improved"))
    models = growing_models(problem, MODELS["emps"])
    rows: list[tuple[str, ...]] = [("model", "force error", "decimated", "published")]
    for item, published in zip(models, ("69 %", "17 %", "", "4.08 %", "4.08 %", "3.11 %"), strict=True):
        rows.append((item.name, *force_errors(measured, item.held[0][:, force]), published))
    rows.append(("**what the diagnosis named**", *force_errors(measured, measured - after), ""))
    every = growing_models(replace(problem, fit=(*problem.fit, *problem.holdout)), MODELS["emps"][:5])[-1]
    parameters = [
        ("", "M kg", "Fv N s/m", "Fc N", "offset N", "force error"),
        ("published", "95.11", "203.5", "20.39", "-3.16", "4.08 %"),
        ("regression of inverse dynamics, repeated here", *regressed(case)),
        ("closed loop, first half fitted", *emps_numbers(models[3].robot), rows[4][2]),
        ("the same, with friction that builds up", *emps_numbers(models[4].robot), rows[5][2]),
        ("that, all cycles fitted", *emps_numbers(every.robot), ""),
    ]
    span = slice(0, 6240)
    panels = [("force [N]", measured[span], before[span], after[span])]
    figures.over_time(out / "emps.png", case.logs[1].log.time[span], panels)
    kept = {"emps_direction": models[5].robot, "emps_offset": models[4].robot}
    return Result(
        "emps", found, kept, {"Force error on held-out cycles": rows, "Parameters": parameters}, ("emps.png",)
    )


def force_errors(measured: np.ndarray, error: np.ndarray) -> tuple[str, str]:
    """Relative error of a force (n,), plain and decimated."""
    smooth = relative_error(decimated(measured), decimated(error))
    return f"{relative_error(measured, error):.2%}", f"{smooth:.2%}"


def regressed(case: Case) -> tuple[str, ...]:
    """The published method on all cycles: mass, viscous and dry friction, offset, relative force error."""
    place, force = (np.concatenate([i.log[f"{kind}_carriage"] for i in case.logs]) for kind in ("position", "force"))
    values, error = inverse_dynamics(place, force)
    return (*(f"{v:.2f}" for v in values), f"{error:.2%}")


def emps_numbers(robot: Robot) -> tuple[str, ...]:
    """Mass [kg], viscous [N s/m] and all dry friction [N], offset [N]."""
    dry = robot["carriage.coulomb_friction.force"] + robot["carriage.presliding_friction.force"]
    mass, viscous = robot["carriage.M"], robot["carriage.viscous_friction.coefficient"]
    return tuple(f"{v:.2f}" for v in (mass, viscous, dry, robot["carriage.offset.force"]))


def tendon_sheath(found: Diagnosis, case: Case, robot: Robot, data: Path, out: Path) -> Result:
    """RMS error of each configuration alone, second half held out; and of each one predicted from the others."""
    read, files = (
        reader("tendon_sheath"),
        sorted((data / FOLDERS["tendon_sheath"]).glob("*.txt"), key=lambda f: float(f.stem)),
    )
    plain, rounded = MODELS["tendon_sheath"], MODELS["sheath_alone"]
    alone: list[tuple[str, ...]] = [("bend", *(name for name, _ in (*plain, rounded[-1])))]
    for file in files:
        problem = make_problem(read(file), robot)
        models = (*growing_models(problem, plain), growing_models(problem, rounded)[-1])
        alone.append((f"{file.stem}°", *(f"{rms_degrees(r.held[0]):.2f}°" for r in models)))
    law: list[tuple[str, ...]] = [("configuration held out", "predicted from the others")]
    panels = []
    for held in case.logs:
        logs = tuple(replace(i, role="holdout" if i is held else "fit") for i in case.logs)
        problem = make_problem(replace(case, logs=logs), robot)
        top = growing_models(problem, MODELS["sheath_law"])[-1]
        bend = held.protocol.removeprefix("bend_") + "°"
        law.append((bend, f"{rms_degrees(top.held[0]):.2f}°"))
        trial = problem.holdout[0]
        angles = (trial.reference[:, 0], trial.measured[:, 0], trial.measured[:, 0] - top.held[0][:, 0])
        panels.append((f"{bend} from the others", *map(np.degrees, angles)))
    figures.loops(out / "tendon_sheath.png", panels)
    tables = {"Each configuration alone, second half held out": alone, "Capstan law over configurations": law}
    problem = make_problem(replace(case, logs=tuple(replace(i, role="fit") for i in case.logs)), robot)
    every = replace(problem, fit=(*problem.fit, *problem.holdout))
    kept = {"tendon_sheath_law": growing_models(every, MODELS["sheath_law"])[-1].robot}
    return Result("tendon_sheath", found, kept, tables, ("tendon_sheath.png",))


def so101(found: Diagnosis, case: Case, robot: Robot, data: Path, out: Path) -> Result:
    """RMS error joint by joint with each further effect, and the cause that matters most in each joint."""
    problem = make_problem(case, robot)
    models = growing_models(problem, MODELS["so101"])
    joints = robot.machine.axes.joints
    rows: list[tuple[str, ...]] = [("joint", *(r.name for r in models), "most of it")]
    for i, joint in enumerate(joints):
        leaders = dominant(problem, models[-1].robot, i)
        rows.append((joint, *(f"{np.degrees(r.rms[i]):.2f}°" for r in models), leaders))
    trial = problem.holdout[-1]
    before, after = (predicted(problem, found.robots[k], [trial])[0] for k in ("nominal", "improved"))
    span = slice(0, 500)
    time = robot.machine.frame * np.arange(len(trial.measured))[span]
    panels = [
        (f"{j} [°]", *(np.degrees(a[span, i]) for a in (trial.measured, before, after))) for i, j in enumerate(joints)
    ]
    figures.over_time(out / "so101.png", time, panels, errors=False)
    return Result(
        "so101", found, {"so101_all": models[-1].robot}, {"RMS error on the second halves": rows}, ("so101.png",)
    )


def dominant(problem: Problem, robot: Robot, joint: int) -> str:
    """The effect without which a joint's held-out error grows most."""
    channel = robot.machine.axes.joints[joint]
    grown = {}
    for effect in robot.machine.effects:
        first = effect.parameters[0]
        place = robot.machine.index[f"{effect.id}.{first.name}.{channel}"]
        values = robot.values.copy()
        values[place] = first.null
        left = predicted(problem, replace(robot, values=values), problem.holdout)
        error = [t.measured[:, joint] - p[:, joint] for t, p in zip(problem.holdout, left, strict=True)]
        grown[effect.id] = float(np.nanmean(np.concatenate(error) ** 2))
    return max(grown, key=lambda k: grown[k])


def dvrk_wrist(found: Diagnosis, case: Case, robot: Robot, data: Path, out: Path) -> Result:
    """RMS error of the moved joint run by run, and of one robot for all runs, with and without coupling."""
    joints = robot.machine.axes.joints
    alone: list[tuple[str, ...]] = [("run", "joint", "gain and offset", "gain, offset and play")]
    for run in dict.fromkeys(item.protocol for item in case.logs):
        logs = tuple(item for item in case.logs if item.protocol == run)
        problem = make_problem(replace(case, logs=logs), robot)
        moved = int(np.argmax(problem.fit[0].reference[:, : len(joints)].std(axis=0)))
        models = growing_models(problem, MODELS["dvrk_wrist"][:3])
        alone.append((run, joints[moved], *(f"{np.degrees(r.rms[moved]):.2f}°" for r in models[1:])))
    problem = make_problem(case, robot)
    models = growing_models(problem, MODELS["dvrk_wrist"])
    together: list[tuple[str, ...]] = [
        ("model", *(f"{t.name.split('_')[0]} {j}" for t in problem.holdout for j in joints))
    ]
    together += [
        (r.name, *(f"{rms_degrees(h[:, i]):.2f}°" for h in r.held for i in range(len(joints)))) for r in models
    ]
    trial = problem.holdout[-1]
    before, after = (predicted(problem, r.robot, [trial])[0] for r in (models[0], models[3]))
    panels = [
        (f"{j} [°]", *(np.degrees(a[:, i]) for a in (trial.measured, before, after))) for i, j in enumerate(joints)
    ]
    figures.over_time(out / "dvrk_wrist.png", np.arange(len(trial.measured), dtype=float), panels, errors=False)
    tables = {"Each run alone, the moved joint": alone, "One robot for all runs": together}
    return Result("dvrk_wrist", found, {"dvrk_wrist_drag": models[3].robot}, tables, ("dvrk_wrist.png",))


STUDIES = {"emps": emps, "tendon_sheath": tendon_sheath, "so101": so101, "dvrk_wrist": dvrk_wrist}
