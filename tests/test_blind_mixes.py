"""Case mixes: the cases are what the name of the mix says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run

from exodrake.data.case import read_case
from exodrake.reference.answers import read_committed
from exodrake.reference.cases import MASKED, MIXES, CasePlan, draw_case, plan
from exodrake.reference.faults import ENTRIES, LIBRARY, WITHOUT_STRENGTH, find_blocks, weaken
from exodrake.reference.make import WEAKEST, case_and_label, gap_in_noise
from exodrake.reference.robot import InjectedFault
from exodrake.reference.score import score
from exodrake.reference.simulator import simulate


def test_the_standard_set_of_a_seed_stays_as_published():
    plans = plan(611221, 200, MIXES["standard"])
    assert [(plans[k].kind, plans[k].ids) for k in (0, 20, 60, 180)] == [
        ("pair", ("tendon.coulomb_friction", "tendon.creep")),
        ("single", ("timing.mocap_delay",)),
        ("unknown", ("outside.posture_friction",)),
        ("pair", ("finger.gravity", "mocap.offset")),
    ]
    drawn = draw_case(plans[0]).spec
    assert drawn.effects[0].channels == ("MF",) and drawn.effects[0].parameters["force"] == 0.31990629345935506
    assert drawn.parameters["torque_constant"][0] == 0.011930148684987495
    assert plan(611221, 200, *MIXES.values())[:200] == [replace(item, name=f"case_0{item.name[5:]}") for item in plans]


@pytest.mark.parametrize(("name", "size"), [("healthy", 0), ("small", 1), ("same-block", 2), ("three", 3)])
def test_cases_of_a_mix_hold_so_many_effects(name, size):
    plans = plan(4, 60, MIXES[name])
    assert all(len(set(item.ids)) == size and set(item.ids) <= set(LIBRARY) for item in plans)
    assert not any(masked <= set(item.ids) for masked in MASKED for item in plans)
    if name == "same-block":
        assert all(len({find_blocks(effect) for effect in item.ids}) == 1 for item in plans)


@pytest.mark.parametrize("name", ["half", "no-mocap", "no-load-cells", "encoders-alone"])
def test_shorter_and_poorer_logs_hold_the_standard_kinds(name):
    plans = plan(4, 200, MIXES[name])
    kinds = [item.kind for item in plans]
    assert [kinds.count(kind) for kind in ("healthy", "single", "pair", "unknown")] == [40, 100, 30, 30]
    seen = {effect for item in plans for effect in item.ids}
    markers = {effect for effect in ENTRIES if "mocap" in effect or "marker" in effect}
    assert len(markers) == 5 and (seen & markers == set() if "angle" in MIXES[name].hidden else seen >= markers)


@pytest.mark.parametrize("unseen", [True, False])
def test_half_logs_last_half_as_long_and_move_every_wire(unseen):
    standard, half = (
        draw_case(CasePlan("case", (3, 1), "healthy", (), unseen, MIXES[name])).protocols
        for name in ("standard", "half")
    )
    assert standard.keys() == half.keys()
    for log, protocol in half.items():
        assert 2 * len(protocol.values) == len(standard[log].values)
        assert np.all(np.ptp(protocol.values, axis=0) > 1.0), log
    assert half["sweeps_1"].values.max(axis=0) == pytest.approx([12.0, 8.0, 8.0], rel=0.02)


@pytest.mark.parametrize("effect", ["sensor.offset", "tendon.compliance", "motor.slow_velocity_loop"])
def test_small_effects_leave_a_gap_of_two_to_four_noise_standard_deviations(short_cases, effect):
    planned = CasePlan("case", (3, 1), "single", (effect,), False, MIXES["small"])
    _, label = case_and_label(planned)
    (line,) = label["effects"]
    fault = InjectedFault(effect, (*line["wires"], *line["joints"]), line["parameters"])
    drawn = draw_case(planned)
    robots = (replace(drawn.spec, effects=effects, noisy=False) for effects in ((fault,), ()))
    gap = max(gap_in_noise(*(simulate(robot, drawn.protocols["grasps"], 0) for robot in robots)).values())
    assert 2.0 <= gap <= 4.0 and line["gap"] == pytest.approx(gap) and label["gap"] == pytest.approx(gap)


@pytest.mark.parametrize("effect", [name for name in LIBRARY if name not in WITHOUT_STRENGTH])
def test_an_effect_of_no_strength_leaves_no_visible_gap(short_cases, effect):
    drawn = draw_case(CasePlan("case", (3, 3), "single", (effect,), False))
    absent = replace(drawn.spec, effects=(weaken(drawn.spec.effects[0], WEAKEST),))
    robots = (replace(robot, noisy=False) for robot in (drawn.spec, absent, replace(drawn.spec, effects=())))
    present, without, healthy = (simulate(robot, drawn.protocols["grasps"], 0) for robot in robots)
    gap = max(gap_in_noise(without, healthy).values())
    assert gap < 2.0 and gap < max(gap_in_noise(present, healthy).values())


def test_a_set_of_several_mixes_is_made_and_scored_mix_by_mix(short_cases, tmp_path):
    folder = tmp_path / "set"
    words = ("--seed", 8, "--cases", 1, "--out", folder, "--mix", "no-mocap", "--mix", "healthy")
    result = run("blind", "make", *words)
    assert result.exit_code == 0 and ": 2; labels in" in result.output, result.output
    labels = read_committed(folder.with_name("set-labels.json"), folder / "seal.txt")
    assert [label["mix"] for label in labels.values()] == ["no-mocap", "healthy"]
    kinds = [{column.split("_")[0] for column in read_case(folder / name).logs[0].log.columns} for name in labels]
    assert "angle" not in kinds[0] and kinds[1] - kinds[0] == {"angle"}
    assert labels["case_00"]["gaps"] and not any(name.startswith("angle") for name in labels["case_00"]["gaps"])
    for name in labels:
        (folder / name / "diagnosis.json").write_text(json.dumps({"verdict": "RETUNE"}))
    assert list(score(folder, folder.with_name("set-labels.json")).mixes) == ["no-mocap", "healthy"]


def test_labels_say_where_outside_faults_act(short_cases):
    for effect, block, wires, joints in (
        ("outside.wire_snag", "tendon", ["AF"], []),
        ("outside.marker_jump", "mocap", [], ["PIP"]),
        ("outside.wire_rub", "tendon", ["AF", "MF"], []),
    ):
        _, label = case_and_label(CasePlan("case", (3, 1), "unknown", (effect,), False))
        (line,) = label["effects"]
        assert (line["block"], line["wires"], line["joints"]) == (block, wires, joints)


def test_weaker_effects_lie_on_the_way_to_the_null_value_and_an_unknown_mix_is_refused(tmp_path):
    garment = InjectedFault("tendon.compliance", parameters={"stiffness": 1000.0})
    loop = InjectedFault("motor.slow_velocity_loop", parameters={"factor": 0.2})
    sheath = InjectedFault("tendon.viscous_friction", ("AF",), parameters={"coefficient": 8.0})
    assert [weaken(fault, 0.25).parameters for fault in (garment, loop, sheath)] == [
        {"stiffness": 4000.0}, {"factor": pytest.approx(0.8)}, {"coefficient": 2.0},
    ]  # fmt: skip
    assert weaken(sheath, 0.25).channels == ("AF",) and weaken(sheath, 1.0) == sheath
    result = run("blind", "make", "--seed", 8, "--cases", 1, "--out", tmp_path / "set", "--mix", "smal")
    assert result.exit_code == 2 and "no case mix 'smal'; did you mean small?" in result.output
    assert not list(tmp_path.iterdir())
