"""What a controller gains from a diagnosis: cost, tuned controllers, robots built from labels, and measures."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.machines.robot_file import write_robot
from exodrake.reference.answers import write_committed
from exodrake.reference.cases import CasePlan, DrawnCase
from exodrake.reference.faults import ENTRIES, draw_effect
from exodrake.reference.make import make_label
from exodrake.reference.robot import TENSION_MAX, InjectedFault, RobotSpec, draw_parameters
from exodrake.reference.simulator import assemble
from studies.transfer import control_task, study as transferring
from studies.transfer.__main__ import command
from studies.transfer.control_task import by_cost, cost, motion, own_gains, predicted
from studies.transfer.study import (
    MODELS,
    Prediction,
    Transfer,
    Transferred,
    as_json,
    measures,
    real_cost,
    tables,
    transfer,
    withheld,
)  # fmt: skip

LATE = {"frames": 3.0}  # latency of the commands


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Motions of 8 s."""
    monkeypatch.setattr(control_task, "SHARES", (0.1, 0.1))


@pytest.fixture(scope="module")
def late():
    return exo.load_robot().splice("timing.command_latency", LATE)


def a_set(folder, robot, labels=True):
    """A diagnosed set of two cases, both with a late robot whose diagnosis is `robot`. Returns the labels' path."""
    nominal = exo.load_robot()
    for name in ("case_00", "case_01"):
        (folder / name).mkdir(parents=True)
        (folder / name / "case.yaml").write_text("logs: []\n")
        (folder / name / "diagnosis.json").write_text('{"verdict": "NAMED"}')
        write_robot(nominal, folder / name / "retuned.yaml")
        write_robot(robot, folder / name / "improved.yaml")
    path = folder.with_name("labels.json")
    if labels:
        write_labels(folder, path)
    return path


def write_labels(folder, path):
    plan = CasePlan("case_00", (1,), "single", ("timing.command_latency",), False)
    drawn = DrawnCase(RobotSpec(effects=(InjectedFault(plan.ids[0], parameters=LATE),)), RobotSpec())
    label = json.loads(json.dumps(make_label(plan, drawn, [9.0], {"tension_AF": 9.0})))
    write_committed({"case_00": label, "case_01": label}, path, folder / "seal.txt")


def kp_only(robot, task, seed):
    """A tuner that needs no search: less gain for a late robot."""
    return own_gains(robot) | {"controller.kp": 4e-3 if "timing.command_latency" in robot.effects() else 9e-3}


def test_cost_of_a_constant_error_and_of_a_chattering_command():
    reference = np.ones((101, 3))
    still = {f"speed_cmd_{w}": np.full(101, 0.02) for w in ("AF", "MF", "AE")}
    off = {f"tension_{w}": 1.0 - 0.1 * most for w, most in zip(("AF", "MF", "AE"), TENSION_MAX)}
    off = {name: np.full(101, value) for name, value in off.items()}
    assert cost(off | still, reference) == pytest.approx(0.1)
    exact = {name: np.ones(101) for name in off}
    chatter = {name: 0.01 * (-1.0) ** np.arange(101) for name in still}  # changes of 0.02 of 0.1 m/s
    assert cost(exact | chatter, reference) == pytest.approx(0.2)
    assert cost(off | chatter, reference) == pytest.approx(np.hypot(0.1, 0.2))
    assert cost(exact | still | {"tension_AF": np.full(101, np.nan)}, reference) == np.inf
    task = exo.Reference(motion(0, 0).values[:100])  # the model that diverges is not refused either
    assert predicted(exo.load_robot(), {"controller.compliance_1": np.inf}, task, 0) == np.inf
    assert np.mean(np.abs(motion(3, 0).values - motion(3, 1).values)) > 0.5  # N, of tuning and judging


def test_controller_tuned_on_the_late_robot_is_really_better_there(late):
    """High gain suits a prompt robot and shakes a late one, in both simulators."""
    tuning, judging = motion(0, 0), motion(0, 1)
    prompt = by_cost(exo.load_robot(), tuning, 0)
    careful = by_cost(late, tuning, 0)
    assert careful["controller.kp"] < 0.8 * prompt["controller.kp"]
    spec = RobotSpec(effects=(InjectedFault("timing.command_latency", parameters=LATE),))
    assert real_cost(spec, careful, judging, 0) < real_cost(spec, prompt, judging, 0)
    assert real_cost(RobotSpec(), prompt, judging, 0) < real_cost(RobotSpec(), careful, judging, 0)


@pytest.mark.parametrize("identity", ENTRIES)
def test_withheld_robot_is_built_anew_from_its_label(identity):
    effect = draw_effect(identity, np.random.default_rng(3))
    spec = RobotSpec(draw_parameters(np.random.default_rng(4)), (effect,))
    plan = CasePlan("case_00", (1,), "single", (identity,), False)
    label = json.loads(json.dumps(make_label(plan, DrawnCase(spec), [9.0], {"tension_AF": 9.0})))
    one, two = (assemble(robot, 60, np.random.default_rng(5)) for robot in (spec, withheld("case", label)))
    assert one.record == two.record and np.array_equal(one.time, two.time)
    assert np.array_equal(one.inputs, two.inputs) and np.array_equal(one.dropped, two.dropped)
    with pytest.raises(InputError, match="knows no fault 'motor"):
        withheld("case_7", {"effects": [{"id": "motor.rust"}], "numbers": {}})


def test_prediction_is_reality_where_the_withheld_robot_is_the_model(tmp_path, late, monkeypatch):
    def model(spec, task, seed):
        gains = {f"controller.{name}": float(spec.parameters[name]) for name in ("kp", "kd")}
        return exo.simulate(late.with_parameters(gains), task, seed[0]).signals

    labels = a_set(tmp_path / "set", late)
    monkeypatch.setattr(transferring, "simulate", model)
    found = transfer(tmp_path / "set", labels, tuner=kp_only)
    for case in found.cases:
        assert case.real == case.prediction.costs["improved"] != case.prediction.costs["nominal"]
    of = {(m.name.split(" ")[0], m.model): m for m in measures(found)}
    assert of["rank", "improved"].value == pytest.approx(1.0) and of["error", "improved"].value == 0.0
    assert of["error", "nominal"].value > 0.0


def test_labels_are_read_after_the_last_controller_is_tuned(tmp_path, late):
    """The labels do not even exist before."""
    folder, calls = tmp_path / "set", []
    labels = a_set(folder, late, labels=False)

    def tuner(robot, task, seed):
        calls.append(robot)
        if len(calls) == 5:  # the nominal robot once, two robots of each of two cases
            write_labels(folder, labels)
        return kp_only(robot, task, seed)

    found = transfer(folder, labels, tuner=tuner)
    assert len(calls) == 5 and [case.truths for case in found.cases] == [("timing.command_latency",)] * 2


def test_set_without_robots_or_with_changed_labels_is_refused(tmp_path, late):
    folder = tmp_path / "set"
    labels = a_set(folder, late)
    labels.write_text(labels.read_text().replace("single", "healthy"))
    with pytest.raises(InputError, match="not those committed"):
        transfer(folder, labels, cases=1, tuner=kp_only)
    (folder / "case_01" / "improved.yaml").unlink()
    result = CliRunner().invoke(command, [str(folder), "--labels", str(labels)])
    assert result.exit_code == 2 and "case_01: no improved.yaml" in result.output
    assert len(result.output.strip().splitlines()) == 1


def transferred(name, real, wrong=1.0):
    """A case whose nominal model predicts the real costs times `wrong`, the others exactly."""
    costs = {model: {k: v * (wrong if model == "nominal" else 1.0) for k, v in real.items()} for model in MODELS}
    gains = {controller: {"controller.kp": 6e-3} for controller in real}
    return Transferred(Prediction(name, "NAMED", gains, costs), "single", ("motor.dead_zone",), real)


def test_measures_of_costs_by_hand():
    cuts = (0.1, 0.2, 0.3, 0.4, 0.5, -0.2)  # by which the improved robot's controller really costs less
    real = [{"default": 0.05, "nominal": 0.06, "retuned": 0.05, "improved": 0.05 * (1.0 - cut)} for cut in cuts]
    found = Transfer(tuple(transferred(f"case_{i}", costs, 1.5) for i, costs in enumerate(real)), {}, 0)
    of = {(m.name, m.model): m for m in measures(found)}
    saved = of["real change of cost, median", "improved"]
    assert saved.ends == pytest.approx((-0.25, -0.5, 0.2))  # of six values, all lie in the interval: 1 - 2/64 > 95 %
    assert of["real change of cost, worst", "improved"].value == pytest.approx(0.2)
    error = of["error of prediction, median", "nominal"]
    assert error.value == pytest.approx(0.5) and of[error.name, "improved"].value == pytest.approx(0.0)
    better = of["really better than default", "improved"]
    assert better.of == "5/6" and better.ends == pytest.approx((5 / 6, 0.3588, 0.9958), abs=1e-4)  # Clopper-Pearson
    assert of["really better than default", "nominal"].of == "0/6"
    one = Transfer(found.cases[:1], {}, 0)
    assert not any("nan" in cell for _, _, rows in tables(one) for row in rows for cell in row)
    json.dumps(as_json(one), allow_nan=False)
    rank = of["rank correlation", "retuned"]
    assert rank.ends == pytest.approx((1.0, 1.0, 1.0))
