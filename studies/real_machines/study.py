"""The four sets, their diagnosis, error measures as papers state them, and figures: the results of `docs/real.md`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import matplotlib
import numpy as np
from scipy.signal import butter, filtfilt

from exodrake.data.case import Case
from exodrake.data.plot import IMPROVED, MEASURED, NOMINAL, STYLE, new_figure, save_png
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import Problem, make_problem
from exodrake.diagnosis.result import Diagnosis
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot
from studies.real_machines.growing_models import growing_models, predicted
from studies.real_machines.recordings import READERS

FOLDERS = {"emps": "emps", "tendon_sheath": "tendon_sheath", "so101": "sage_so101", "dvrk_wrist": "dvrk_wrist"}
MODELS: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "emps": [
        ("frictionless inertia", ()),
        ("viscous friction", ("carriage.viscous_friction",)),
        ("viscous and Coulomb friction", ("carriage.coulomb_friction",)),
        ("viscous and Coulomb friction, offset", ("carriage.offset",)),
        ("the same, part of the friction builds up after a reversal", ("carriage.presliding_friction",)),
        ("that, viscous friction by direction", ("carriage.direction",)),
    ],
    "tendon_sheath": [
        ("rigid", ()),
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("gain, offset and play", ("sheath.play",)),
    ],
    "sheath_alone": [
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("gain, offset and play with round corners", ("sheath.capstan_play",)),
    ],
    "sheath_law": [
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("with capstan play and bend loss", ("sheath.capstan_play", "sheath.bend_loss")),
    ],
    "so101": [
        ("ideal servo", ()),
        ("latency", ("servo.latency",)),
        ("latency, sag", ("servo.gravity_sag",)),
        ("latency, sag, dead band", ("servo.dead_band",)),
        ("latency, sag, dead band, lag", ("servo.lag",)),
    ],
    "dvrk_wrist": [
        ("rigid cables", ()),
        ("gain and offset", ("cable.offset",)),
        ("gain, offset and play", ("cable.play",)),
        ("with drag by neighbours", ("cable.drag_by_next", "cable.drag_by_previous")),
        ("with drag and coupling", ("cable.coupling_to_next", "cable.coupling_to_previous")),
    ],
}  # fmt: skip
# EMPS forces, [Hz] and order of the filter, factor of its decimation: assumed, since the paper does not state its own
CUT, ORDER, DECIMATION = 20.0, 4, 25
FRICTION_RATE = 1e3  # Hz, at which EMPS was recorded
WIDE, THIN, EDGE = 60.0, 10, 100  # Hz; rows kept of; rows left out at both ends, where filters ring: assumed
DPI = 110


@dataclass(frozen=True, eq=False)
class Result:
    """Results on a set: the diagnosis, fitted robots, tables (title -> rows, the first a header), figures."""

    name: str
    diagnosis: Diagnosis
    robots: dict[str, Robot] = field(default_factory=dict)
    tables: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    figures: tuple[str, ...] = ()


def study(name: str, data: Path, out: Path, progress: Callable[[str], None]) -> Result:
    """One set, diagnosed and tabulated; figures are written into `out`."""
    case, robot = READERS[name](data / FOLDERS[name]), load_robot(name)
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
    place, given = (np.concatenate([i.log[f"{kind}_carriage"] for i in case.logs]) for kind in ("position", "force"))
    numbers, error = inverse_dynamics(place, given)
    parameters = [
        ("", "M kg", "Fv N s/m", "Fc N", "offset N", "force error"),
        ("published", "95.11", "203.5", "20.39", "-3.16", "4.08 %"),
        ("regression of inverse dynamics, repeated here", *(f"{v:.2f}" for v in numbers), f"{error:.2%}"),
        ("closed loop, first half fitted", *emps_numbers(models[3].robot), rows[4][2]),
        ("the same, with friction that builds up", *emps_numbers(models[4].robot), rows[5][2]),
        ("that, all cycles fitted", *emps_numbers(every.robot), ""),
    ]
    span = slice(0, 6240)
    panels = [("force [N]", measured[span], before[span], after[span])]
    over_time(out / "emps.png", case.logs[1].log.time[span], panels)
    kept = {"emps_direction": models[5].robot, "emps_offset": models[4].robot}
    return Result(
        "emps", found, kept, {"Force error on held-out cycles": rows, "Parameters": parameters}, ("emps.png",)
    )


def force_errors(measured: np.ndarray, error: np.ndarray) -> tuple[str, str]:
    """Relative error of a force (n,), plain and decimated."""
    smooth = relative_error(decimated(measured), decimated(error))
    return f"{relative_error(measured, error):.2%}", f"{smooth:.2%}"


def emps_numbers(robot: Robot) -> tuple[str, ...]:
    """Mass [kg], viscous [N s/m] and all dry friction [N], offset [N]."""
    dry = robot["carriage.coulomb_friction.force"] + robot["carriage.presliding_friction.force"]
    mass, viscous = robot["carriage.M"], robot["carriage.viscous_friction.coefficient"]
    return tuple(f"{v:.2f}" for v in (mass, viscous, dry, robot["carriage.offset.force"]))


def tendon_sheath(found: Diagnosis, case: Case, robot: Robot, data: Path, out: Path) -> Result:
    """RMS error of each configuration alone, second half held out; and of each one predicted from the others."""
    files = sorted((data / FOLDERS["tendon_sheath"]).glob("*.txt"), key=lambda f: float(f.stem))
    plain, rounded = MODELS["tendon_sheath"], MODELS["sheath_alone"]
    alone: list[tuple[str, ...]] = [("bend", *(name for name, _ in (*plain, rounded[-1])))]
    for file in files:
        problem = make_problem(READERS["tendon_sheath"](file), robot)
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
    loops(out / "tendon_sheath.png", panels)
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
    over_time(out / "so101.png", time, panels, errors=False)
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
    together = [("model", *(f"{t.name.split('_')[0]} {j}" for t in problem.holdout for j in joints))]
    for r in models:
        together.append((r.name, *(f"{rms_degrees(h[:, i]):.2f}°" for h in r.held for i in range(len(joints)))))
    trial = problem.holdout[-1]
    before, after = (predicted(problem, r.robot, [trial])[0] for r in (models[0], models[3]))
    panels = [
        (f"{j} [°]", *(np.degrees(a[:, i]) for a in (trial.measured, before, after))) for i, j in enumerate(joints)
    ]
    over_time(out / "dvrk_wrist.png", np.arange(len(trial.measured), dtype=float), panels, errors=False)
    tables = {"Each run alone, the moved joint": alone, "One robot for all runs": together}
    return Result("dvrk_wrist", found, {"dvrk_wrist_drag": models[3].robot}, tables, ("dvrk_wrist.png",))


def relative_error(measured: np.ndarray, error: np.ndarray) -> float:
    """|error| / |measured| of a force (n,)."""
    return float(np.linalg.norm(error) / np.linalg.norm(measured))


def decimated(force: np.ndarray) -> np.ndarray:
    """A force (n,) filtered both ways and thinned out, as identification papers do before they compare."""
    return filtfilt(*butter(ORDER, CUT / (0.5 * FRICTION_RATE)), force)[::DECIMATION]  # pyright: ignore


def rms_degrees(residual: np.ndarray) -> float:
    """RMS of an angle's residual (n,) [rad] in degrees."""
    return float(np.degrees(np.sqrt(np.nanmean(residual**2))))


def inverse_dynamics(place: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, float]:
    """Mass [kg], viscous [N s/m] and Coulomb [N] friction and offset [N] by regression, and the relative error left.

    The method of the published EMPS results; positions (n,) [m] and forces (n,) [N] are filtered both ways, subsampled.
    """
    low, high = butter(ORDER, WIDE / (0.5 * FRICTION_RATE))  # pyright: ignore
    smooth, wanted = filtfilt(low, high, place), filtfilt(low, high, force)[EDGE:-EDGE:THIN]
    speed = np.gradient(smooth, 1.0 / FRICTION_RATE)
    columns = (np.gradient(speed, 1.0 / FRICTION_RATE), speed, filtfilt(low, high, np.sign(speed)), np.ones_like(speed))
    matrix = np.column_stack(columns)[EDGE:-EDGE:THIN]
    found = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    return found, relative_error(wanted, wanted - matrix @ found)


def over_time(path: Path, time: np.ndarray, panels: Sequence[tuple], errors: bool = True) -> None:
    """Draws panels over time (n,) [s], one above the other: label, measured, nominal, improved (n,) each.

    errors: whether the error of the improved robot is drawn below each panel.
    """
    import matplotlib

    step = 2 if errors else 1
    with matplotlib.rc_context(STYLE):
        figure = new_figure(9.0, 1.9 * step * len(panels) * (0.75 if errors else 1.0) + 0.5)
        heights = [2, 1] * len(panels) if errors else None
        axes = figure.subplots(step * len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for k, (label, measured, nominal, improved) in enumerate(panels):
            axes[step * k].plot(time, measured, **MEASURED, label="measured")
            axes[step * k].plot(time, nominal, **NOMINAL, label="nominal")
            axes[step * k].plot(time, improved, **IMPROVED, label="improved")
            axes[step * k].set_ylabel(label)
            if errors:
                axes[step * k + 1].plot(time, measured - improved, color=IMPROVED["color"], lw=0.8)
                axes[step * k + 1].axhline(0.0, color=MEASURED["color"], lw=0.5)
                axes[step * k + 1].set_ylabel("error left")
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(time[0], time[-1])
        figure.align_ylabels()
        save_png(figure, path, DPI)


def loops(path: Path, panels: Sequence[tuple]) -> None:
    """Draws hysteresis loops side by side: title; command, measured and predicted angle (n,) [deg]."""
    with matplotlib.rc_context(STYLE):
        figure = new_figure(2.6 * len(panels), 2.9)
        axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
        for axis, (title, command, measured, predicted) in zip(axes, panels, strict=True):
            axis.plot(command, measured, **MEASURED, label="measured")
            axis.plot(command, predicted, **IMPROVED, label="predicted")
            axis.set_title(title)
            axis.set_xlabel("command [°]")
        axes[0].set_ylabel("angle [°]")
        axes[0].legend()
        save_png(figure, path, DPI)


STUDIES = {"emps": emps, "tendon_sheath": tendon_sheath, "so101": so101, "dvrk_wrist": dvrk_wrist}
