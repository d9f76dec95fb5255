"""Free laws on machines of one's own: every form of arm, servo and cable machine, beside the built-in ones."""

import ast
import builtins
from dataclasses import replace

import numpy as np
import pytest
from arm_folders import made

import exodrake as exo
from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.discovery import law_code
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.law_code import law_points, module_text
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.simulation.references import protocol

FORMS = ("inverse", "closed-loop", "cable")
ARMS = [(form, urdf) for form in FORMS for urdf in ("linear_axis", "rotary_axis", "cable_arm")]
OWN = {f"{form}_{urdf}".replace("-", "_"): ("--urdf", urdf, "--form", form) for form, urdf in ARMS}
OWN |= {"servos": ("--joints", "a,b"), "one_servo": ("--joints", "a")}
BUILT_IN = ("exo_index", "emps", "tendon_sheath", "so101", "dvrk_wrist")


def unknown_names(source):
    """(function, name) that a module's functions read, and neither they, the module nor Python define."""
    tree, found = ast.parse(source), set()
    known = set(dir(builtins)) | {f.name for f in tree.body if isinstance(f, ast.FunctionDef)}
    known |= {a.name for line in tree.body if isinstance(line, ast.ImportFrom) for a in line.names}
    for function in (f for f in tree.body if isinstance(f, ast.FunctionDef)):
        names = [n for n in ast.walk(function) if isinstance(n, ast.Name)]
        own = {a.arg for a in function.args.args} | {n.id for n in names if isinstance(n.ctx, ast.Store)}
        found |= {(function.name, n.id) for n in names if n.id not in known | own}
    return found


@pytest.mark.parametrize("name", [*BUILT_IN, *OWN])
def test_laws_of_every_machine_read_the_arguments_of_their_points_alone(arm_folder, name):
    robot = exo.load_robot(name) if name in BUILT_IN else made(arm_folder, name, *OWN[name])
    source = module_text(robot.machine)
    assert "law = " in source and not unknown_names(source)


def test_discovery_finds_the_friction_that_an_inverse_arm_is_not_told_of(arm_folder, monkeypatch):
    """0.02 N m against the speed are added to the efforts. Two points have laws; the test above reads those of all.

    Compilation takes most of the time: that of all laws as long again, that of the arm's effects too.
    """
    arm = made(arm_folder, "turning", "--urdf", "rotary_axis", "--form", "inverse")
    bare = replace(arm.machine, effects=())
    robot = replace(arm, machine=bare, values=arm.values[[arm.machine.index[p.name] for p in bare.parameters]])
    few = [point for point in law_points(bare) if point.key in ("arm.pushed", "reading_torque.shown")]
    monkeypatch.setattr(law_code, "law_points", lambda machine: few)
    whole, items = protocol("random-motion", robot), []
    for k, role in enumerate(("fit", "holdout")):
        log = exo.simulate(robot, replace(whole, values=whole.values[100 * k : 100 * k + 300]), seed=k)
        effort = log.signals["effort_axis"] + 0.02 * np.sign(log.signals["velocity_axis"])
        log = replace(log, signals=log.signals | {"effort_axis": effort})
        items.append(CaseLog(log, role, role, None, f"{role}.csv"))
    with one_blas_thread():
        problem = make_problem(Case("rusty", {}, tuple(items), robot.machine.frame), robot, frozenset())
        law = discover(problem, isolate(problem))
    assert law.found and law.id == "arm.learned_pushed" and law.words == "force over speed"
    (curve,) = law.curves.values()
    assert curve.low[0] < -0.02 < curve.high[0] and curve.low[-1] < 0.02 < curve.high[-1]
    assert law.closure is not None and law.closure.low > 0.5
