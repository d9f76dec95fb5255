"""Free laws on machines of one's own: every form of arm, servo and cable machine, beside the built-in ones."""

import ast
import builtins
from dataclasses import replace

import pytest
from arm_folders import made

import exodrake as exo
from exodrake.core.threads import one_blas_thread
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.law_machine import module_text
from exodrake.diagnosis.pipeline import isolated
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


def test_discovery_finds_the_friction_that_an_inverse_arm_is_not_told_of(arm_folder):
    """Coulomb friction, a constant against the speed, is injected, and no effect may be tried."""
    robot = made(arm_folder, "turning", "--urdf", "rotary_axis", "--form", "inverse")
    rusty, whole = robot.splice("arm.coulomb_friction"), protocol("random-motion", robot)
    items = []
    for k, role in enumerate(("fit", "holdout")):
        reference = replace(whole, values=whole.values[100 * k : 100 * k + 300])
        items.append(CaseLog(exo.simulate(rusty, reference, seed=k), role, role, None, f"{role}.csv"))
    with one_blas_thread():
        problem, found = isolated(
            make_problem(Case("rusty", {}, tuple(items), robot.machine.frame), robot, frozenset())
        )
        law = discover(problem, found)
    assert law.found and law.block == "arm" and "speed" in law.words
    assert law.closure is not None and law.closure.low > 0.5
