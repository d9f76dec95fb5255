"""Four machines beside the Exo-Index: laws against closed forms, both engines, injected parameters found again."""

import numpy as np
import pytest
from effects_motion import motion_of

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import CAUSE
from exodrake.effects import LIBRARY, friction, servo
from exodrake.engine.inputs import Reference
from exodrake.machines.position_servos import servo_machine
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.simulate import record, simulate
from studies.real_machines.growing_models import growing_models

MACHINES = ("emps", "tendon_sheath", "so101", "dvrk_wrist")
TWO_MOTIONS = 2


def case_of(robot, name: str, seeds: range) -> Case:
    """Logs of a robot, the last one held out."""
    logs = [simulate(robot, Reference(motion_of(name, seed), f"motion {seed}"), seed=seed) for seed in seeds]
    roles = ["fit"] * (len(logs) - 1) + ["holdout"]
    items = [
        CaseLog(log, f"motion {i}", role, None, f"{i}.csv")
        for i, (log, role) in enumerate(zip(logs, roles, strict=True))
    ]
    return Case(name, {}, tuple(items), robot.machine.frame)


@pytest.mark.parametrize("name", MACHINES)
def test_both_engines_give_the_same_bits_with_every_effect(name):
    robot = load_robot(name)
    for effect in robot.machine.effects:
        robot = robot.splice(effect.id)
    reference = Reference(motion_of(name, 1)[:120])
    simulator, drake = (record(robot, reference, seed=3, engine=engine).signals for engine in ("compiled", "drake"))
    assert all(np.array_equal(simulator[wire], drake[wire]) for wire in simulator)
    plain = record(load_robot(name), reference, seed=3).signals
    assert not np.array_equal(plain[robot.machine.columns[-1].signal], simulator[robot.machine.columns[-1].signal])


INJECTED = {
    "emps": {
        "carriage.viscous_friction": {"coefficient": 150.0},
        "carriage.coulomb_friction": {"force": 15.0},
        "carriage.offset": {"force": -4.0},
    },
    "tendon_sheath": {"sheath.capstan_play": {"width": 0.3, "mu": 0.15}, "sheath.offset": {"offset": -0.04}},
    "so101": {
        "servo.latency": {"frames": {"Rotation": 2.5, "Pitch": 4.0, "Elbow": 3.0, "WristPitch": 2.0}},
        "servo.dead_band": {"half_width": {"Pitch": 0.03, "Elbow": 0.04}},
    },
    "dvrk_wrist": {
        "cable.play": {"half_width": {"q4": 0.03, "q5": 0.08, "q6": 0.15}},
        "cable.coupling_to_previous": {"share": {"q6": 0.2}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", MACHINES)
def test_injected_effects_are_named_and_their_numbers_found(name):
    robot = load_robot(name)
    injected = robot
    for identity, parameters in INJECTED[name].items():
        channels = {channel for v in parameters.values() if isinstance(v, dict) for channel in v}
        injected = injected.splice(identity, parameters, sorted(channels))
    found = diagnose(case_of(injected, name, range(4) if name == "tendon_sheath" else range(TWO_MOTIONS)), robot)
    assert found.verdict == "NAMED", found.reasons
    assert {e.id for e in found.effects if e.role == CAUSE} <= set(INJECTED[name]) <= {e.id for e in found.effects}
    improved = found.robots["improved"]
    for identity, parameters in INJECTED[name].items():
        for number, value in parameters.items():
            for channel, wanted in (value if isinstance(value, dict) else {"": value}).items():
                full = ".".join(part for part in (identity, number, channel) if part)
                got = improved.channels(full)[0]
                assert got == pytest.approx(wanted, rel=0.1, abs=0.004), full
    assert found.closure.overall.value > 0.98


def test_a_ladder_falls_with_the_effects_that_are_there_and_stands_without_them():
    robot = load_robot("tendon_sheath")
    injected = robot.splice("sheath.play", {"half_width": 0.2})
    steps = [("rigid", ()), ("play", ("sheath.play",)), ("lag", ("sheath.lag",))]
    rigid, play, lag = (
        r.rms[0] for r in growing_models(make_problem(case_of(injected, "tendon_sheath", range(2)), robot), steps)
    )
    assert play < 0.05 * rigid and play == pytest.approx(load_robot("tendon_sheath")["reading.repeatability"], rel=0.2)
    assert lag == pytest.approx(play, rel=0.1)


def test_nothing_is_found_on_a_nominal_machine():
    robot = load_robot("tendon_sheath")
    assert diagnose(case_of(robot, "tendon_sheath", range(2)), robot).verdict == "NO_GAP"


def test_a_braked_carriage_stops_after_the_way_that_energy_allows_and_stays():
    mass, force, speed, dt = 95.0, 20.0, 0.2, 1e-4
    way, v = 0.0, speed
    for _ in range(20_000):
        before = v
        v = friction.coulomb(v, dt / mass, force)
        way += 0.5 * dt * (before + v)
    assert v == 0.0 and way == pytest.approx(0.5 * mass * speed**2 / force, rel=1e-3)


@pytest.mark.parametrize("spread", [0.0, 0.4])
def test_play_in_a_sheath_is_the_mean_of_three_plays(spread):
    """Play keeps an angle, a stop what is left of the way: two forms of one operator (Brokate, Sprekels 1996)."""
    rng, bend, width, mu = np.random.default_rng(4), 1.2, 0.3, 0.15
    aims = np.cumsum(rng.normal(0.0, 0.1, 400))
    middle = servo.half_width(bend, width, mu)
    plays, stops, before = np.zeros(3), (0.0, 0.0, 0.0), 0.0
    for aim in aims:
        stops = servo.settle_strands(0.01, aim - before, bend, width, mu, spread, *stops)
        angle = servo.follow_sheath(aim, bend, width, mu, spread, *stops)
        half = middle * np.array([1.0 - spread, 1.0, 1.0 + spread])
        plays, before = np.clip(plays, aim - half, aim + half), aim
        assert angle == pytest.approx(np.mean(plays), abs=1e-12)


def test_presliding_friction_encloses_the_area_of_its_parallelogram():
    """Each way the force turns over the first 2 presliding without work, then dry friction acts."""
    force, presliding, way, steps = 5.0, 1.5e-4, 2e-3, 4000
    slide, work = -1.0, 0.0
    for step in np.concatenate([np.full(steps, way / steps), np.full(steps, -way / steps)]):
        work -= friction.presliding_force(0.0, force, presliding, slide) * step
        slide = friction.settle_presliding(1e-3, step, force, presliding, slide)
    assert slide == -1.0
    assert work == pytest.approx(2.0 * force * (way - 2.0 * presliding), rel=1e-3)


def test_friction_that_builds_up_is_distinguished_from_friction_that_does_not():
    robot = load_robot("emps")
    injected = {
        "carriage.viscous_friction": {"coefficient": 150.0},
        "carriage.coulomb_friction": {"force": 15.0},
        "carriage.presliding_friction": {"force": 6.0, "presliding": 2e-4},
    }
    made = robot
    for identity, parameters in injected.items():
        made = made.splice(identity, parameters)
    problem = make_problem(case_of(made, "emps", range(TWO_MOTIONS)), robot)
    fitted = growing_models(problem, [(identity, (identity,)) for identity in injected])[-1].robot
    for identity, parameters in injected.items():
        for name, value in parameters.items():
            assert fitted[f"{identity}.{name}"] == pytest.approx(value, rel=0.05), name


def test_a_dragged_joint_goes_from_one_stop_to_the_other():
    robot = load_robot("dvrk_wrist").splice("cable.drag_by_next", {"share": 0.5, "reach": 0.1}, ["q5"])
    rows = np.zeros((60, 6))
    rows[:, 2] = np.concatenate([np.linspace(0, 0.8, 30), np.linspace(0.8, -0.8, 30)])
    log = simulate(robot, Reference(rows), seed=None)
    assert log["angle_q5"][29] == pytest.approx(0.1) and log["angle_q5"][59] == pytest.approx(-0.1)
    assert np.all(log["angle_q4"] == 0.0)


def test_servos_of_a_robot_file_are_refused_by_name():
    section = {"part": "servo", "joints": ["knee"], "frame": 0.02, "max_effects": 1}
    machine = servo_machine("leg", section | {"effects": {"servo.dead_band": "joint.play"}}, "leg/robot.yaml")
    assert machine.effect("servo.dead_band").at.keys() == LIBRARY["joint.play"].at.keys()
    with pytest.raises(exo.InputError, match=r"did you mean joint\.play"):
        servo_machine("leg", section | {"effects": {"servo.dead_band": "joint.plays"}}, "leg/robot.yaml")
    with pytest.raises(exo.InputError, match=r"leg/robot\.yaml, 'servos': unknown key 'frames'"):
        servo_machine("leg", section | {"effects": {}, "frames": 0.02}, "leg/robot.yaml")


def test_a_robot_file_names_a_known_machine_and_never_a_module(tmp_path):
    file = tmp_path / "mine.yaml"
    parameters = "parameters: {sheath: {ratio: 1.0}, reading: {sigma: 0.001, step: 0.0, repeatability: 0.001}}\n"
    file.write_text("machine: exodrake.machines.tendon_sheath.machine\n" + parameters)
    with pytest.raises(exo.InputError, match="did you mean tendon_sheath"):
        load_robot(file)
    file.write_text("machine: no.such.page\n" + parameters)
    with pytest.raises(exo.InputError, match=r"no\.such\.page"):
        load_robot(file)
    file.write_text(
        "machine: tendon_sheath\n"
        "tolerances: [{parameters: [sheath.x], transform: often, prior_std: 1, max_deviation: 1}]\n" + parameters
    )
    with pytest.raises(exo.InputError, match="often"):
        load_robot(file)
