"""Importers of the four sets, on files made here in their form, and on the recordings where they are."""

from dataclasses import replace

import numpy as np
import pytest
from shared_data import data_folder, needs_data
from small_recordings import SETS, made

from exodrake.core.errors import InputError
from exodrake.data.case import read_case, write_case
from exodrake.diagnosis.problem import list_required, make_problem
from exodrake.machines.robot_file import load_robot
from studies.real_machines.growing_models import growing_models
from studies.real_machines.recordings import READERS
from studies.real_machines.study import FOLDERS, MODELS, decimated, emps_numbers, relative_error, rms_degrees


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
