"""Four machines beside the Exo-Index: laws, both engines, injected parameters found again, importers of recordings."""

from dataclasses import replace

import numpy as np
import pytest
from effects_motion import motion_of
from shared_data import data_folder, needs_data
from small_recordings import SETS, made

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.case import Case, CaseLog, read_case, write_case
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import list_required, make_problem
from exodrake.diagnosis.result import CAUSE
from exodrake.effects import LIBRARY, friction, servo
from exodrake.engine.inputs import Reference
from exodrake.machines.position_servos import servo_machine
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.simulate import record, simulate
from studies.real_machines.growing_models import growing_models
from studies.real_machines.recordings import READERS
from studies.real_machines.study import FOLDERS, MODELS, decimated, emps_numbers, relative_error, rms_degrees

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


@pytest.mark.parametrize("late", [0.0, 3.0, 4.5])
def test_a_late_servo_goes_on_with_what_was_sent_before_the_log_began(late):
    """One joint is behind a ramp by what is late, another steps from where it stands, a third is held off its command.

    In the first row each stands where the log says.
    """
    robot, n, rows = load_robot("so101").splice("servo.latency", {"frames": late}), 6, np.arange(60.0)
    command, start = np.zeros((60, n)), np.zeros(n)
    command[:, 0], start[0] = 0.02 * rows, -0.02 * late
    command[:, 1], command[:, 2], start[2] = 0.4, 0.3, 0.28
    reference = Reference(np.hstack([command, np.tile(start, (60, 1))]), "begun")
    angle = record(robot, reference, seed=None).signals["angle"]
    assert angle[:, 0] == pytest.approx(0.02 * (rows - late), abs=1e-12)
    assert angle[:, 1] == pytest.approx(
        np.where(rows > 0.0, 0.4 * np.clip(rows - late + 1.0, 0.0, 1.0), 0.0), abs=1e-12
    )
    assert angle[0, 2] == 0.28 and angle[1:, 2] == pytest.approx(0.3, abs=1e-12)


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


@pytest.mark.parametrize("name", SETS)
def test_a_case_survives_its_folder_and_suits_its_robot(name, tmp_path):
    (tmp_path / "in").mkdir()
    case = READERS[name](made(name, tmp_path / "in"))
    write_case(case, tmp_path / "out")
    machine = load_robot(name).machine
    again = read_case(tmp_path / "out", list_required(machine), machine.frame)
    assert [i.role for i in again.logs] == [i.role for i in case.logs] and again.period == machine.frame
    assert all(a.log.equals(b.log) for a, b in zip(again.logs, case.logs, strict=True))


def test_values_units_and_dropped_rows(tmp_path):
    folders = {name: tmp_path / name for name in SETS}
    for folder in folders.values():
        folder.mkdir()
    emps, sheath, so101, wrist = (READERS[name](made(name, folders[name])).logs for name in SETS)
    assert emps[0].log["force_carriage"][3] == pytest.approx(35.0 * 0.3) and len(emps[0].log) == 20
    held = next(i for i in sheath if i.role == "holdout")
    assert held.protocol == "bend_60" and len(held.log) == 10  # four rows share each time
    assert held.log["bend_bending"][0] == pytest.approx(np.pi / 3)
    assert np.allclose(np.degrees(held.log["angle_bending"]), 60 + 0.5 * 4 * np.arange(10))
    assert so101[1].log["angle_WristPitch"][0] == pytest.approx(5.0) == so101[1].log["angle_start_WristPitch"][5]
    assert sum(len(i.log) for i in wrist) == 39  # the camera missed one
    assert wrist[0].log["angle_ref_q5"][7] == 8.0


@pytest.mark.parametrize(
    ("name", "file", "text", "says"),
    [
        ("emps", "DATA_EMPS.mat", "no", "not a whole MAT"),
        ("tendon_sheath", "straight.txt", "1, 2", "no bend in degrees"),
        ("tendon_sheath", "60.txt", "1, 2\n3, x", "60.txt"),
        ("so101", "control.csv", "timestamp,positions\n0,[1]\n", "joint_list.txt"),
        ("dvrk_wrist", "exp3_q_des_raw.npy", "no", "not a whole NumPy file"),
    ],
)
def test_bad_recordings_are_refused_by_name(name, file, text, says, tmp_path):
    (tmp_path / file).write_text(text)
    if name == "dvrk_wrist":
        np.save(tmp_path / "exp3_q_act_raw.npy", np.ones((3, 6)))
    with pytest.raises(InputError, match=says):
        READERS[name](tmp_path)
    with pytest.raises(InputError):
        READERS[name](tmp_path / "absent")


@needs_data("real")
def test_emps_force_errors_are_the_published_ones():
    case, robot = READERS["emps"](data_folder("real") / FOLDERS["emps"]), load_robot("emps")
    problem = make_problem(case, robot)
    inertia, viscous, _, _, full, asymmetric = growing_models(problem, MODELS["emps"])
    force = problem.columns.index("force_carriage")
    measured = problem.holdout[0].measured[:, force]
    errors = [
        relative_error(decimated(measured), decimated(r.held[0][:, force]))
        for r in (inertia, viscous, full, asymmetric)
    ]
    assert errors[0] == pytest.approx(0.69, abs=0.03) and errors[1] < 0.2
    assert errors[2] == pytest.approx(0.0408, abs=0.0005) and errors[3] <= 0.0311


@needs_data("real")
def test_emps_numbers_are_the_published_ones():
    """To 2 %, in closed loop, from all cycles as published."""
    problem = make_problem(READERS["emps"](data_folder("real") / FOLDERS["emps"]), load_robot("emps"))
    full = growing_models(replace(problem, fit=(*problem.fit, *problem.holdout)), MODELS["emps"][:5])[-1]
    found = [float(number) for number in emps_numbers(full.robot)]
    assert found == pytest.approx([95.11, 203.5, 20.39, -3.16], rel=0.02)


@needs_data("real")
@pytest.mark.parametrize("bend", ["0", "60", "120", "180"])
def test_play_brings_each_sheath_near_a_degree(bend):
    case = READERS["tendon_sheath"](data_folder("real") / FOLDERS["tendon_sheath"] / f"{bend}.txt")
    problem = make_problem(case, load_robot("tendon_sheath"))
    rigid, loose, play = growing_models(problem, MODELS["tendon_sheath"])
    rounded = growing_models(problem, MODELS["sheath_alone"])[-1]
    errors = [rms_degrees(r.held[0]) for r in (rigid, loose, play, rounded)]
    assert 19 < errors[0] < 40 and 4 < errors[1] < 14 and errors[2] < 1.3
    assert errors[3] < min(errors[2], 1.25)


@needs_data("real")
def test_play_of_the_wrist_joints_own_cable():
    case = READERS["dvrk_wrist"](data_folder("real") / FOLDERS["dvrk_wrist"] / "exp3_q_des_raw.npy")
    _, loose, play = growing_models(make_problem(case, load_robot("dvrk_wrist")), MODELS["dvrk_wrist"][:3])
    assert np.degrees(loose.rms[0]) > 1.2 and np.degrees(play.rms[0]) < 0.5
