"""The missing law, found in logs of a carriage that a few lines of our own simulate, with laws that no effect holds.

Every form of arm, servo and cable machine, and the built-in ones, have points where one may be missing.
"""

import ast
import builtins
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arm_folders import made
from scipy.stats import multivariate_normal

import exodrake as exo
from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.formats import read_log
from exodrake.data.log import Log
from exodrake.diagnosis.discovery import law_code
from exodrake.diagnosis.discovery.discover import discover, list_candidates, weigh_scales
from exodrake.diagnosis.discovery.law_code import (
    add_laws,
    law_points,
    load_effects,
    module_text,
    robot_on,
    write_law,
)  # fmt: skip
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.effects import law_table
from exodrake.engine.compose import generate_module
from exodrake.report.diagnosis_html import law_figure
from exodrake.report.wording import law_lines
from exodrake.simulation.protocols import protocol
from exodrake.simulation.simulate import simulate

TICKS, FRAME = 16, 1e-3
KNOWN = frozenset(  # effects that the diagnosis knows
    f"carriage.{name}" for name in ("coulomb_friction", "viscous_friction", "offset", "direction", "load_friction")
)

FORMS = ("inverse", "closed-loop", "cable")
ARMS = [(form, urdf) for form in FORMS for urdf in ("linear_axis", "rotary_axis", "cable_arm")]
OWN = {f"{form}_{urdf}".replace("-", "_"): ("--urdf", urdf, "--form", form) for form, urdf in ARMS}
OWN |= {"servos": ("--joints", "a,b"), "one_servo": ("--joints", "a")}
BUILT_IN = ("exo_index", "emps", "tendon_sheath", "so101", "dvrk_wrist")


def lugre(x, v, force, memory, dt):
    """LuGre friction: 20 N sliding, 34 N at break-away, Stribeck speed 0.05 m/s, presliding some 0.1 mm."""
    level, stiffness = 20.0 + 14.0 * np.exp(-((v / 0.05) ** 2)), 2e5
    rate = v - stiffness * abs(v) * memory / level
    return force - stiffness * memory - 200.0 * rate, memory + dt * rate


def saturating_spring(x, v, force, memory, dt):
    """A spring that saturates: 60 tanh(x / 0.015) N."""
    return force - 60.0 * np.tanh(x / 0.015), memory


def gain_over_place(x, v, force, memory, dt):
    """A drive whose force depends on the place: 1 - 6 x."""
    return force * (1.0 - 6.0 * x), memory


def healthy(x, v, force, memory, dt):
    """Nothing but the drive."""
    return force, memory


def carriage(law, reference, seed):
    """Log of a carriage under its drive at 1 kHz, the law acting on the force; semi-implicit Euler."""
    noise, n = 2.5e-8 * np.random.default_rng(seed).standard_normal(len(reference)), len(reference)
    place, push, dt = np.zeros(n), np.zeros(n), FRAME / TICKS
    x = v = memory = force = 0.0
    before = earlier = 0.0
    for k in range(n):
        for tick in range(TICKS):
            if tick == 1:
                place[k] = x + noise[k]
            if tick == 2:
                rate = 0.5 * (place[k] - earlier) / FRAME
                force = 35.15065188 * 243.45 * (160.18 * (reference[k] - place[k]) - rate)
                earlier, before = before, place[k]
            net, memory = law(x, v, force, memory, dt)
            v += dt * net / 95.11
            x += dt * v
        push[k] = force
    still = np.zeros(n)
    columns = {"position_ref": reference, "position_start": still, "speed_start": still, "position": place}
    columns = {f"{name}_carriage": values for name, values in (columns | {"force": push}).items()}
    return Log(FRAME * np.arange(n), columns)


def motion(seed):
    """A wandering reference (4000,) [m] from rest at 0, some 0.1 m wide."""
    rng, t = np.random.default_rng(seed), FRAME * np.arange(4000)
    waves = [
        a * (1.0 - np.cos(2 * np.pi * f * t)) for a, f in zip((0.035, 0.012), (0.5, 1.4) * rng.uniform(0.8, 1.2, 2))
    ]
    return np.sum(waves, axis=0) - 0.02 * (1.0 - np.cos(2 * np.pi * 0.27 * t))


@cache
def case_of(law):
    """Two logs of a law, and a third one held out."""
    roles = ("fit", "fit", "holdout")
    logs = [CaseLog(carriage(law, motion(k), k), f"{k}", role, None, f"{k}.csv") for k, role in enumerate(roles)]
    return Case(law.__name__, {}, tuple(logs), FRAME)


@cache
def isolated(law):
    """The isolation of a law's case."""
    with one_blas_thread():
        return isolate(make_problem(case_of(law), exo.load_robot("emps"), KNOWN))


@cache
def discovered(law):
    """The law that a discovery finds."""
    with one_blas_thread():
        return discover(isolated(law))


def test_healthy_robot_lacks_no_law():
    assert not discovered(healthy).found


def test_presliding_beside_coulomb_friction_is_not_told_from_a_memory_of_the_reading():
    """Coulomb friction explains most of LuGre friction; the logs do not tell in which of two parts the rest is."""
    law = discovered(lugre)
    assert law.found and law.reason.endswith("what carriage.coulomb_friction leaves") and law.p_noise < 1e-6
    assert not law.distinguished and "carriage.learned_pushed" in (law.id, law.runner_up.id)


def test_saturating_spring_is_a_force_over_place():
    law = discovered(saturating_spring)
    curve = law.curves[""]
    assert law.id == "carriage.learned_pushed" and law.words == "force over place"
    assert curve.value == pytest.approx(60.0 * np.tanh(curve.u / 0.015), abs=6.0)
    assert "tanh" in curve.formula and curve.formula in "".join(law_lines(law))
    assert law.closure.value > 0.9
    assert "<svg" in law_figure(law).svg


def test_gain_that_depends_on_place_is_linear_in_it():
    law = discovered(gain_over_place)
    curve = law.curves[""]
    assert law.words == "gain over place"
    assert np.all((curve.low <= -6.0 * curve.u) & (-6.0 * curve.u <= curve.high)) and np.ptp(curve.value) > 0.5
    assert curve.formula.startswith("f(u) = - ") and curve.formula.endswith(" u")
    assert law.closure.value > 0.9


def bare(robot):
    """A robot whose machine has no effects: those of the library take longer to compile than the laws."""
    machine = replace(robot.machine, effects=())
    values = robot.values[[robot.machine.index[p.name] for p in machine.parameters]]
    return replace(robot, machine=machine, values=values)


def test_law_that_is_withheld_from_the_library_is_found_with_its_point_and_form():
    """Joints that stiffen with their bend, on the finger exoskeleton; nothing of the library may explain it."""
    stiff, items = exo.load_robot().splice("finger.hardening"), []
    for k, role in enumerate(("fit", "holdout")):
        log = exo.simulate(stiff, f"random-motion:seed={k},duration=7", seed=k)
        items.append(CaseLog(log, role, role, None, f"{role}.csv"))
    robot = bare(exo.load_robot())
    with one_blas_thread():
        problem = make_problem(Case("stiff", {}, tuple(items), robot.machine.frame), robot, frozenset())
        law = discover(isolate(problem))
    assert (law.id, law.words) == ("finger.learned_passive", "torque over bend")
    assert law.closure.low > 0.5


def test_law_is_sought_in_the_parts_that_are_named_alone():
    with one_blas_thread():
        here = discover(isolated(saturating_spring), blocks=("carriage",))
        elsewhere = discover(isolated(saturating_spring), blocks=("scale",))
    assert here.id == "carriage.learned_pushed" and {other.id.split(".")[0] for other in here.others} == {"carriage"}
    assert {other.id.split(".")[0] for other in elsewhere.others} <= {"scale"}


def test_gain_of_a_law_is_that_of_a_normal_distribution():
    """The rows are N(0, I) without the law, N(0, I + F S F') with it; a channel that adds nothing is left out."""
    rng, n = np.random.default_rng(2), 60
    f, channel = rng.normal(size=(4, n)), np.array([0, 1, 2, 2])
    f[1] *= 1e-3
    y = 3.0 * f[0] + rng.normal(size=n)
    scales, modes, gain = weigh_scales(f @ f.T, f @ y, channel)
    assert scales[0] > 0.0 and scales[1] == 0.0
    law = (f.T * scales[channel] ** 2) @ f
    normal = [multivariate_normal(np.zeros(n), cov).logpdf(y) for cov in (np.eye(n) + law, np.eye(n))]
    assert gain == pytest.approx(normal[0] - normal[1])
    assert modes @ f == pytest.approx(-law @ np.linalg.solve(np.eye(n) + law, y))


WRITTEN = """
import exodrake as exo
from exodrake.simulation.protocols import from_log
exo.add_plugin("law")
robot = exo.load_robot("law/robot.yaml")
for engine in ("compiled", "drake"):
    log = exo.simulate(robot, from_log("case/2.csv", robot), None, False, engine)
    exo.write_log(log, engine + ".csv")
"""


def test_law_is_written_as_an_effect_that_both_engines_run(tmp_path):
    write_case(case_of(saturating_spring), tmp_path / "case")
    law = discovered(saturating_spring)
    write_law(tmp_path / "law", law.id, law.text, law.robot, "case")
    done = subprocess.run([sys.executable, "-c", WRITTEN], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    compiled, drake = (read_log(tmp_path / f"{engine}.csv") for engine in ("compiled", "drake"))
    measured = case_of(saturating_spring).logs[2].log
    assert all(np.array_equal(compiled[c], drake[c]) for c in compiled.columns)
    error, motion_std = compiled["force_carriage"] - measured["force_carriage"], np.std(measured["force_carriage"])
    assert np.sqrt(np.mean(error**2)) < 0.05 * motion_std


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
    machine = (exo.load_robot(name) if name in BUILT_IN else made(arm_folder, name, *OWN[name])).machine
    source = module_text(machine)
    assert "law = " in source and not unknown_names(source)
    if name in BUILT_IN:
        laws = law_points(machine)
        assert len(laws) >= 3 and {law.key for law in laws} <= {p for e in add_laws(machine).effects for p in e.at}


def test_files_of_laws_that_earlier_versions_found_act_as_they_did():
    machine = exo.load_robot("emps").machine
    text = module_text(machine)
    former = text.replace("maxwell_element", "faded").replace("lose_speed", "dragged")
    made = [generate_module(replace(machine, effects=load_effects(t, "emps"))) for t in (text, former)]
    new, old = (re.sub(r"free_laws_emps_\w{12}", "laws", t) for t in made)
    assert former != text and new == old


def rubbed(speed):
    """Effort against friction [N m] of 0.02 N m and 0.02 N m s/rad."""
    return 0.02 * np.sign(speed) + 0.02 * speed


def test_discovery_finds_the_friction_that_an_inverse_arm_is_not_told_of(arm_folder, monkeypatch):
    """Dry and viscous friction are added to the efforts. Two points have laws; a test above reads those of all."""
    arm = made(arm_folder, "turning", "--urdf", "rotary_axis", "--form", "inverse")
    robot = bare(arm)
    few = [point for point in law_points(robot.machine) if point.key in ("arm.pushed", "reading_torque.shown")]
    monkeypatch.setattr(law_code, "law_points", lambda machine: few)
    whole, items = protocol("random-motion", robot), []
    for k, role in enumerate(("fit", "holdout")):
        log = exo.simulate(robot, replace(whole, values=whole.values[100 * k : 100 * k + 300]), seed=k)
        effort = log.signals["effort_axis"] + rubbed(log.signals["velocity_axis"])
        log = replace(log, signals=log.signals | {"effort_axis": effort})
        items.append(CaseLog(log, role, role, None, f"{role}.csv"))
    with one_blas_thread():
        problem = make_problem(Case("rusty", {}, tuple(items), robot.machine.frame), robot, frozenset())
        law = discover(isolate(problem))
    assert law.found and law.id == "arm.learned_pushed" and law.words == "force over speed"
    (curve,) = law.curves.values()
    ends = rubbed(curve.u[[0, -1]])
    assert np.all((curve.low[[0, -1]] < ends) & (ends < curve.high[[0, -1]])) and ends[0] < -0.02 and ends[1] > 0.02
    assert law.closure is not None and law.closure.low > 0.5


def test_no_law_is_sought_over_what_stays_as_it_is(arm_folder):
    """The mass of a link is a number; the effort on its joint is not."""
    robot = bare(made(arm_folder, "steady", "--urdf", "rotary_axis", "--form", "inverse"))
    laws = [point for point in law_points(robot.machine) if point.key in ("arm.pushed", "arm.weighed")]
    machine = add_laws(robot.machine)
    log = exo.simulate(robot, protocol("random-motion:duration=4", robot))
    problem = make_problem(
        Case("steady", {}, (CaseLog(log, "fit", "fit", None, "fit.csv"),), 0.005), robot, frozenset()
    )
    values = law_code.values_on(problem.silent(), robot.machine, machine)
    tried = list_candidates(replace(problem, robot=robot_on(problem.robot, machine)), values, laws)
    assert {law.key for law in laws} == {"arm.pushed", "arm.weighed"}
    assert {candidate.law.key for candidate in tried} == {"arm.pushed"}


def test_absent_laws_leave_the_bits():
    robot = exo.load_robot("emps")
    reference = exo.Reference(np.column_stack([motion(0), np.zeros(4000), np.zeros(4000)]))
    plain = simulate(robot, reference, seed=1)
    other = simulate(robot_on(robot, add_laws(robot.machine)), reference, seed=1)
    assert all(np.array_equal(plain[c], other[c]) for c in plain.columns)


def test_curve_is_the_interpolant_of_numpy():
    rng = np.random.default_rng(1)
    k, w = np.sort(rng.normal(size=8)), rng.normal(size=8)
    u = rng.uniform(-3, 3, 200)
    assert [law_table.curve(x, *k, *w) for x in u] == pytest.approx(np.interp(u, k, w))
    inner = u[(u > k[0]) & (u < k[-1])]
    difference = [(law_table.curve(x + 1e-7, *k, *w) - law_table.curve(x - 1e-7, *k, *w)) / 2e-7 for x in inner]
    assert [law_table.slope(x, *k, *w) for x in inner] == pytest.approx(difference, rel=1e-4)
