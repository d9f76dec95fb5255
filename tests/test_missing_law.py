"""The missing law, found in logs of a carriage that a few lines of our own simulate, with laws that no effect holds."""

import json
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from kernels import skip_without
from scipy.stats import binomtest, multivariate_normal

import exodrake as exo
from exodrake.compiled.splice import state_indices
from exodrake.core.threads import one_blas_thread
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.log import Log
from exodrake.data.log_file import read_log
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.evidence import TIGHTER, Eliminated, weigh
from exodrake.diagnosis.discovery.law_machine import MachineMap, laws_of, with_laws
from exodrake.diagnosis.discovery.missing_law import MissingLaw
from exodrake.diagnosis.discovery.search import ranked
from exodrake.diagnosis.discovery.watch import state_places
from exodrake.diagnosis.gap import Where
from exodrake.diagnosis.likelihood import SAMPLE
from exodrake.diagnosis.pipeline import isolated, with_law
from exodrake.diagnosis.problem import make_problem
from exodrake.effects import law_table
from exodrake.simulation.simulate import simulate
from studies.missing_law_page import ERROR, limit
from studies.processors import ALIKE, environment

TICKS, FRAME = 16, 1e-3
KNOWN = frozenset(  # effects that the diagnosis knows
    f"carriage.{name}" for name in ("coulomb_friction", "viscous_friction", "offset", "direction", "load_friction")
)


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
def discovered(law):
    """What the discovery says of them."""
    with one_blas_thread():
        problem, found = isolated(make_problem(case_of(law), exo.load_robot("emps"), KNOWN))
        return discover(problem, found)


def test_healthy_robot_lacks_no_law():
    assert not discovered(healthy).found


def test_lugre_friction_is_friction_over_speed_with_a_peak_at_break_away():
    law = discovered(lugre)
    assert law.found and law.block == "carriage"
    assert law.closure.value > 0.8


def test_saturating_spring_is_a_force_over_place():
    law = discovered(saturating_spring)
    curve = law.curves[""]
    assert law.id == "carriage.learned_pushed" and law.words == "force over place"
    assert curve.value == pytest.approx(60.0 * np.tanh(curve.u / 0.015), abs=6.0)
    assert "tanh" in curve.formula
    assert law.closure.value > 0.9


def test_gain_that_depends_on_place_is_linear_in_it():
    law = discovered(gain_over_place)
    curve = law.curves[""]
    assert law.words == "gain over place"
    assert np.all((curve.low <= -6.0 * curve.u) & (-6.0 * curve.u <= curve.high)) and np.ptp(curve.value) > 0.5
    assert curve.formula.startswith("f(u) = - ") and curve.formula.endswith(" u")
    assert law.closure.value > 0.9


@cache
def gain_with(kernel):
    """The law of a gain over place as a process finds it whose linear algebra is that of a processor."""
    code = "import json, test_missing_law as t; c = t.discovered(t.gain_over_place).curves['']"
    code += "; print(json.dumps([list(c.value), list(c.low), list(c.high)]))"
    words = [sys.executable, "-c", code]
    run = subprocess.run(words, cwd=Path(__file__).parent, env=environment(kernel), capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-2000:]
    return np.array(json.loads(run.stdout))


def test_law_is_the_same_by_the_linear_algebra_of_two_processors():
    """A fit that ended early, or with quotients over too long a step, ended 1.7 half widths of the band apart."""
    skip_without("Haswell", "Sandybridge")
    (value, low, high), (other, *_) = gain_with("Haswell"), gain_with("Sandybridge")
    assert np.all(abs(other - value) < ALIKE * (high - low))


def test_law_is_sought_in_the_parts_that_are_named_alone():
    with one_blas_thread():
        problem, found = isolated(make_problem(case_of(saturating_spring), exo.load_robot("emps"), KNOWN))
        elsewhere, here = (discover(problem, found, blocks=(block,)) for block in ("scale", "carriage"))
    assert not elsewhere.found and not elsewhere.others
    assert here.id == "carriage.learned_pushed" and {other.id.split(".")[0] for other in here.others} == {"carriage"}


def test_log_evidence_is_that_of_a_normal_distribution():
    """The logs are N(0, v I + J P^-1 J' + F S F'), tolerances tighter by as much as samples are less independent."""
    rng, n = np.random.default_rng(2), 60
    machine = SimpleNamespace(frame=SAMPLE)
    likelihood = SimpleNamespace(weights=np.ones(n, np.float32), samples=n, robot=SimpleNamespace(machine=machine))
    jacobian, directions, prior = rng.normal(size=(3, n)), rng.normal(size=(4, n)), np.array([0.3, 2.0, 0.01])
    offset = 0.4 * rng.normal(size=n) + 1.5 * directions[0] + 0.3 * jacobian[0]
    model = Eliminated(likelihood, offset, jacobian, prior)
    scales, channel = np.array([1.0, 0.0, 0.7]), np.array([0, 1, 2, 2])
    found = weigh(model, model.columns(directions), channel, scales)
    j, f, y = (rows * model.weights for rows in (jacobian * (prior * TIGHTER)[:, None], directions, offset))
    law = (f.T * scales[channel] ** 2) @ f
    covariance = found.variance * np.eye(n) + j.T @ j + law
    wanted = multivariate_normal(np.zeros(n), covariance).logpdf(y) + 0.5 * n * np.log(2 * np.pi)
    assert found.log_evidence == pytest.approx(wanted, rel=1e-4)
    gain = law @ np.linalg.solve(covariance, y)  # posterior mean of the law's part
    assert found.modes @ f == pytest.approx(-gain, abs=1e-4 * np.max(np.abs(gain)))


def fit_in(block):
    """Of a fitted law, its block alone."""
    return SimpleNamespace(block=block)


@pytest.mark.parametrize(
    "shares, where, first",
    [
        ((0.8, 0.7), "", "tendon"),  # no free input: the better evidence
        ((0.8, 0.7), "finger", "finger"),  # takes up a third of what the finger's law leaves: not distinguished
        ((0.9, 0.7), "finger", "tendon"),  # two thirds: it rejects the finger
        ((0.3, -9.0), "finger", "finger"),
        ((0.6, -9.0), "bus", "tendon"),  # in the bus no law acts
    ],
)
def test_law_in_the_block_of_free_inputs_stands_first_unless_another_rejects_it(shares, where, first):
    fits = [fit_in("tendon"), fit_in("finger")]
    assert fits[ranked(fits, shares, where)[0]].block == first


def test_unknown_cause_is_where_its_law_is():
    problem = make_problem(case_of(saturating_spring), exo.load_robot("emps"), KNOWN)
    law = MissingLaw(True, "", "carriage.learned_pushed", channels=())
    for verdict, block in (("UNKNOWN", "carriage"), ("NAMED", "scale")):
        made = SimpleDiagnosis(verdict, Where("scale"))
        assert with_law(problem, made, law).where.block == block
    assert with_law(problem, SimpleDiagnosis("UNKNOWN", Where("scale")), MissingLaw(False, "")).where.block == "scale"


@dataclass(frozen=True)
class SimpleDiagnosis:
    """What of a diagnosis a missing law changes."""

    verdict: str
    where: Where
    missing_law: MissingLaw | None = None


@pytest.mark.parametrize("robots", [9, 24, 60])
def test_limit_of_the_lead_is_exceeded_as_often_as_stated(robots):
    """Exchangeable leads: the new one lies above the k-th of n with probability 1 - k / (n + 1)."""
    rng = np.random.default_rng(robots)
    above = sum(rng.exponential() > limit(rng.exponential(size=robots)) for _ in range(2000))
    rank = np.ceil((1.0 - ERROR) * (robots + 1))
    assert binomtest(above, 2000, 1.0 - rank / (robots + 1)).pvalue > 1e-3
    assert 1.0 - rank / (robots + 1) <= ERROR + 1e-12


def test_law_is_written_as_an_effect_that_both_engines_run(tmp_path):
    write_case(case_of(saturating_spring), tmp_path / "case")
    exodrake(
        tmp_path, "diagnose", "case", "--robot", "emps", "--effects", ",".join(sorted(KNOWN)), "--out-law", "law",
        "--json", "answer.json", "--report", "report.html",
    )  # fmt: skip
    law = json.loads((tmp_path / "answer.json").read_text())["missing_law"]
    assert law["id"] == "carriage.learned_pushed" and law["closure"]["value"] > 0.9
    assert "The missing law" in (tmp_path / "report.html").read_text()
    for engine in ("compiled", "drake"):
        exodrake(
            tmp_path, "--plugin", "law", "simulate", "--robot", "law/robot.yaml", "--reference", "case/2.csv",
            "--engine", engine, "--out", engine, "--no-noise", "--no-quantisation",
        )  # fmt: skip
    compiled, drake = (read_log(tmp_path / engine / "log.csv") for engine in ("compiled", "drake"))
    measured = case_of(saturating_spring).logs[2].log
    assert all(np.array_equal(compiled[c], drake[c]) for c in compiled.columns)
    error, motion_std = compiled["force_carriage"] - measured["force_carriage"], np.std(measured["force_carriage"])
    assert np.sqrt(np.mean(error**2)) < 0.05 * motion_std


def exodrake(folder, *arguments):
    """The command line in a folder; its standard output."""
    command = [sys.executable, "-m", "exodrake", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["emps", "tendon_sheath", "so101", "dvrk_wrist", "exo_index"])
def test_every_machine_has_points_where_a_law_may_be_missing(name):
    machine = exo.load_robot(name).machine
    laws = laws_of(machine)
    assert len(laws) >= 3
    assert {law.key for law in laws} <= {p for e in with_laws(machine).effects for p in e.at}


def test_absent_laws_leave_the_bits():
    robot = exo.load_robot("emps")
    reference = exo.Reference(np.column_stack([motion(0), np.zeros(4000), np.zeros(4000)]))
    plain = simulate(robot, reference, seed=1)
    other = simulate(MachineMap(robot.machine, with_laws(robot.machine)).robot(robot), reference, seed=1)
    assert all(np.array_equal(plain[c], other[c]) for c in plain.columns)


@pytest.mark.parametrize("name", ["emps", "exo_index"])
def test_states_of_an_effect_are_where_the_generated_code_has_them(name):
    machine = with_laws(exo.load_robot(name).machine)
    for part in machine.parts:
        start = sum(sum(machine.part_size(p)) for p in machine.parts[: machine.parts.index(part)])
        for effect in machine.effects_on(part):
            if effect.states and all(state.axis == effect.axis and state.width == 1 for state in effect.states):
                places = state_places(machine, effect.id)
                z = start + machine.part_size(part)[0]
                for j in range(machine.width(effect.axis)):
                    own = state_indices(machine, part, effect, str(j) if effect.axis else None)
                    assert [eval(text[2:-1]) + z for text in own] == [int(p[j]) for p in places.values()]


def test_curve_is_the_interpolant_of_numpy():
    rng = np.random.default_rng(1)
    k, w = np.sort(rng.normal(size=8)), rng.normal(size=8)
    u = rng.uniform(-3, 3, 200)
    assert [law_table.curve(x, *k, *w) for x in u] == pytest.approx(np.interp(u, k, w))
    inner = u[(u > k[0]) & (u < k[-1])]
    difference = [(law_table.curve(x + 1e-7, *k, *w) - law_table.curve(x - 1e-7, *k, *w)) / 2e-7 for x in inner]
    assert [law_table.slope(x, *k, *w) for x in inner] == pytest.approx(difference, rel=1e-4)


def test_stop_operator_closes_its_loop_and_maxwell_element_forgets():
    path = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, -1, 100), np.linspace(-1, 1, 100)])
    s, seen = 0.0, []
    for change in np.diff(path):
        s = law_table.stop_operator(s, change, 0.3)
        seen.append(s)
    assert seen[48] == 0.3 and seen[148] == -0.3 and seen[-1] == 0.3
    assert law_table.faded(1.0, 0.0, 2.0, 2.0) == pytest.approx(np.exp(-1.0))
