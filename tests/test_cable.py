"""Cable-driven transmission: closed forms of stretch, coupling, reflected inertia and frequency; injected faults."""

from types import SimpleNamespace

import numpy as np
import pytest
from arm_folders import made

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.physics import cable

A = np.array([[0.05, 0.01, 0.0], [-0.02, 0.04, 0.03], [0.0, 0.015, -0.06]])  # as of a wrist: neighbours are coupled
K, PRETENSION, INERTIA = 300.0, 4.0, 2e-4
TWO = (
    '<robot name="two"><link name="base"/>'
    '<link name="u"><inertial><origin xyz="0 0 -0.22"/><mass value="2.0"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>'
    '<link name="v"><inertial><origin xyz="0 0 -0.17"/><mass value="1.3"/>'
    '<inertia ixx="0.012" ixy="0" ixz="0" iyy="0.012" iyz="0" izz="0.006"/></inertial></link>'
    '<joint name="A" type="revolute"><parent link="base"/><child link="u"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="40" velocity="5"/></joint>'
    '<joint name="B" type="revolute"><parent link="u"/><child link="v"/><origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="15" velocity="5"/></joint></robot>'
)


def transmission(matrix, **given):
    """Parameters of the part for a matrix A, as its equations take them."""
    count = len(matrix)
    pad = np.zeros((count + 2, count + 2))
    pad[1:-1, 1:-1] = matrix
    bands = {"by_previous": -1, "ratio": 0, "by_next": 1}
    found = {name: [pad[j, j + k] for j in range(1, count + 1)] for name, k in bands.items()}
    rest = {"stiffness": K, "pretension": PRETENSION, "loss": 0.0, "inertia": INERTIA, "damping": 0.0}
    rest = rest | {"dry_friction": 0.0} | given
    return SimpleNamespace(**found, **{name: [value] * count for name, value in rest.items()})


def run(matrix, q, drive, ticks, dt=1e-4, links=None, **given):
    """Angles of motors and joints (ticks, 2, joints) under motor efforts from rest at q.

    links: (joints,) inertias of links that move; held if None. drive: (joints,) [N m].
    """
    n, count = transmission(matrix, **given), len(q)
    x, position, speed = np.zeros(cable.STATES * count + 2), np.array(q, dtype=float), np.zeros(count)
    motor, effort, rows = np.zeros(count), np.zeros(count), []
    cable.stand(x, None, n, None, np.linalg.solve(matrix, q))
    cable.output(x, None, n, None, position, motor, effort)
    for _ in range(ticks):
        pull = effort.copy()
        cable.update(x, None, n, None, dt, drive, effort, position)
        if links is not None:
            speed += dt * pull / links
            position += dt * speed
        cable.output(x, None, n, None, position, motor, effort)
        rows.append((motor.copy(), position.copy()))
    return np.array(rows)


def test_coupling_is_the_matrix_of_joints_by_motors_and_its_transpose_of_efforts():
    n, rng = transmission(A), np.random.default_rng(0)
    theta, efforts, found = rng.standard_normal(3), rng.standard_normal(3), np.zeros(3)
    cable.read_positions(None, None, n, None, theta, found)
    assert found == pytest.approx(A @ theta)
    assert [cable.couple_motors(theta, None, n, None, 0, j, 3) for j in range(3)] == pytest.approx(A @ theta)
    cable.share_efforts(None, None, n, None, efforts, found)
    assert found == pytest.approx(A.T @ efforts)
    assert [cable.load(efforts, None, n, None, j, 3) for j in range(3)] == pytest.approx(A.T @ efforts)


def test_motors_begin_where_the_software_saw_the_joints():
    start, motors, links = np.array([0.3, -0.2, 0.5]), np.zeros(3), np.zeros(3)
    cable.begin(None, None, transmission(A), None, start, motors, links)
    assert motors == pytest.approx(np.linalg.solve(A, start)) and links == pytest.approx(start)


@pytest.mark.parametrize("effort", [1.0, -3.0, 6.0, -9.0])
def test_static_stretch_is_that_of_two_strands_and_then_of_one(effort):
    """Strands carry (pretension +- K d) / 2; at |d| = pretension / K one is slack, the other carries all."""
    taut = abs(effort) <= PRETENSION
    stretch = effort / K if taut else np.sign(effort) * (2.0 * abs(effort) - PRETENSION) / K
    assert cable.pull_loop(stretch, K, PRETENSION) == pytest.approx(effort)
    motors = run(A[:1, :1], [0.1], np.array([A[0, 0] * effort]), 20_000, damping=2e-3)[-1, 0]
    assert A[0, 0] * motors[0] - 0.1 == pytest.approx(stretch, rel=1e-3)


def test_motor_and_link_oscillate_at_the_frequency_of_two_masses():
    """omega^2 = K (A^2 / B + 1 / m) of the stretch after a push."""
    link, dt, ticks = 0.05, 1e-4, 4000
    rows = run(A[:1, :1], [0.0], np.array([0.02]), ticks, dt, links=np.array([link]), pretension=1e3)
    stretch = (A[0, 0] * rows[:, 0] - rows[:, 1])[:, 0]
    stretch = stretch - stretch.mean()
    crossings = np.flatnonzero((stretch[:-1] < 0.0) & (stretch[1:] >= 0.0))
    crossings = crossings - stretch[crossings] / (stretch[crossings + 1] - stretch[crossings])
    omega = 2.0 * np.pi / (np.diff(crossings).mean() * dt)
    assert omega == pytest.approx(np.sqrt(K * (A[0, 0] ** 2 / INERTIA + 1.0 / link)), rel=2e-3)


def test_coupled_links_feel_the_reflected_inertia_of_the_motors():
    """Momentum on stiff cables: (M + A^-T B A^-1) q'' = A^-T tau; the mean over many periods of the cables."""
    links, tau, dt, ticks = np.array([0.05, 0.03, 0.02]), np.array([0.01, -0.02, 0.015]), 2e-5, 20_000
    rows = run(A, np.zeros(3), tau, ticks, dt, links=links, pretension=1e3, stiffness=3e3)
    back = np.linalg.inv(A)
    wanted = np.linalg.solve(np.diag(links) + INERTIA * back.T @ back, back.T @ tau)
    found = rows[-1, 1] / (0.5 * (ticks * dt) ** 2)
    assert found == pytest.approx(wanted, rel=0.02)


def test_losses_of_a_cable_damp_the_oscillation_as_those_of_a_spring_and_a_damper():
    """Amplitude exp(-loss omega^2 t / 2)."""
    link, dt, loss = 0.05, 1e-4, 1e-3
    rows = run(A[:1, :1], [0.0], np.array([0.02]), 3000, dt, links=np.array([link]), pretension=1e3, loss=loss)
    stretch = (A[0, 0] * rows[:, 0] - rows[:, 1])[:, 0]
    period = round(2.0 * np.pi / np.sqrt(square := K * (A[0, 0] ** 2 / INERTIA + 1.0 / link)) / dt)
    first, last = (np.ptp(stretch[k : k + period]) for k in (0, 3 * period))
    assert np.log(first / last) / (3 * period * dt) == pytest.approx(loss * square / 2.0, rel=0.05)


@pytest.fixture(scope="module")
def arm(arm_folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("urdf") / "two.urdf"
    path.write_text(TWO)
    return made(arm_folder, "cable_two", "--urdf", path, "--form", "cable")


def test_both_engines_agree_to_the_last_bit_on_a_cable_arm(arm):
    logs = [exo.simulate(arm, "steps:dwell=0.2", engine=engine) for engine in ("compiled", "drake")]
    assert all(np.array_equal(logs[0][c], logs[1][c]) for c in logs[0].columns)


def test_a_cable_arm_follows_its_references(arm):
    log = exo.simulate(arm, "random-motion:duration=4,fastest=0.3", seed=None)
    for joint in arm.machine.axes.joints:
        error = log[f"position_{joint}"] - log[f"position_ref_{joint}"]
        assert np.std(error) < 0.05 * np.std(log[f"position_ref_{joint}"])


def diagnosed(worn, arm):
    """The answer on two motions of a robot, the second one held out, and its causes: effect -> joints, value."""
    logs = [exo.simulate(worn, exo.protocol(f"random-motion:duration=4,seed={k}", worn), seed=k) for k in range(2)]
    items = tuple(CaseLog(log, "motion", role, None, f"{role}.csv") for log, role in zip(logs, ("fit", "holdout")))
    found = exo.diagnose(Case("injected", {}, items, arm.machine.frame), arm)
    assert found.verdict == "NAMED", found.reasons
    causes = [effect for effect in found.effects if effect.role == "cause"]
    return {e.id: (tuple(e.joints), next(iter(e.parameters.values())).value) for e in causes}


def test_coupling_error_and_play_of_two_joints_are_named(arm):
    worn = arm.splice("cable.coupling_to_previous", {"share": 0.1}, ["B"])
    found = diagnosed(worn.splice("cable.backlash", {"half_width": 0.02}, ["A"]), arm)
    assert {name: joints for name, (joints, _) in found.items()} == {
        "cable.coupling_to_previous": ("B",), "cable.backlash": ("A",),
    }  # fmt: skip
    sizes = {name: value for name, (_, value) in found.items()}
    assert sizes == pytest.approx({"cable.coupling_to_previous": 0.1, "cable.backlash": 0.02}, rel=0.05)


@pytest.mark.parametrize("effect, force", [("arm.coulomb_friction", 0.3), ("cable.coulomb_friction", 0.015)])
def test_friction_of_a_joint_is_told_from_that_of_its_motor(arm, effect, force):
    """Both brake alike, but the cable stretches by the friction of the joint alone."""
    found = diagnosed(arm.splice(effect, {"force": force}, ["B"]), arm)
    assert found == {effect: (("B",), pytest.approx(force, rel=0.1))}
