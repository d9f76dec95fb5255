"""Every command with every built-in machine: it works, or says in one sentence why it does not."""

import json
import os

import click
import pytest
from arm_folders import MIXED
from command_line import run
from report_synthetic import diagnosis

import exodrake as exo
from exodrake.cli.main import cli
from exodrake.cli.options import OTHERS
from exodrake.core import plugins
from exodrake.core.errors import MAX_MESSAGE
from exodrake.diagnosis import pipeline
from exodrake.machines.robot_file import machine_folders

SHORT = "steps:dwell=2"
# command -> its arguments besides --robot; {} is a folder with a log of the machine
ALL = {
    "simulate": [SHORT, "--out", "{}/run"],
    "compare": ["{}/log.csv", "{}/log.csv", "--out", "{}"],
    "robot": [],
    "effects": [],
    "draw": ["--out", "{}/wiring.svg"],
    "watch": ["{}/log.csv", "--until-idle", "0"],
    "export": ["{}/log.csv", "--out", "{}/log.npz"],
    "check": ["{}/log.csv", "--effects", "{effect}"],
    "diagnose": ["{}/log.csv"],  # up to the diagnosis itself, which takes minutes
    "experiment": ["{}/log.csv", "--out", "{}/e.csv"],  # up to the diagnosis
    "calibrate": ["--case", "{}/absent", "--out", "{}"],  # a refusal: with robots it takes minutes
    "response": ["{}/log.csv"],
    "fit": ["{}/log.csv", "--free", "absent"],  # a refusal: no parameter is free in all machines
    "sweep": ["--reference", "{}/log.csv", "--robots", "2"],
    "alarm-limits": ["--robots", "2", "--minutes", "0.5", "--jobs", "1"],
}
SOME = {
    "analyse": [],
    "tune": [],
    "show": ["{}/log.csv", "--out", "{}/base.html"],
    "workspace": ["--samples", "300", "--steps", "3", "--out", "{}/areas"],
    "grasp": ["caging", "--size", "1 m", "--out", "{}/grasp"],
    "train": ["{}/log.csv", "--out", "{}/e.npz"],
    "estimate": ["{}/log.csv", "--estimator", "{}/absent.npz"],
}
# of one machine, or none, by their nature
NONE = ("demo", "identify", "blind", "import", "new-machine", "feedforward", "warm-up", "fleet")
REFUSED = {"calibrate", "fit", "grasp", "train", "estimate"}  # what this test asks of these is wrong for any machine
LONG = {"analyse", "tune", "workspace"}  # for the machine that they are made for, tested elsewhere
MADE_FOR = "exo_index"
LOOPS = {"dvrk_wrist", "emps", "mixed_loop", "motor_servos", "so101", "tendon_sheath"}  # with a loop
ARMS = {
    "cable_arm": ["--urdf", "cable_arm"],
    "mixed_loop": ["--urdf", "{}", "--form", "closed-loop"],
    "motor_servos": ["--servo", "motor"],
}  # from `new-machine`
EVERY = (*machine_folders(), *ARMS)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A folder with a short log of each machine; that of an arm is made first."""
    found, machines = {}, tmp_path_factory.mktemp("machines")
    (machines / "mixed.urdf").write_text(MIXED)
    before = os.environ.get(plugins.VARIABLE)
    for name, options in ARMS.items():
        words = [word.replace("{}", str(machines / "mixed.urdf")) for word in options]
        assert run("new-machine", machines / name, *words).exit_code == 0
        exo.add_plugin(machines / name)
    for name in EVERY:
        found[name] = tmp_path_factory.mktemp(name)
        robot = exo.load_robot(name)
        motion = f"steps:dwell={max(1.0, 40 * robot.machine.frame):g}"  # 100 frames at least
        exo.write_log(exo.simulate(robot, motion), found[name] / "log.csv")
    yield found
    os.environ.pop(plugins.VARIABLE) if before is None else os.environ.update({plugins.VARIABLE: before})


def assert_one_sentence(result, name):
    """Status 2, one red line of bearable length, no traceback."""
    assert result.exit_code == 2, result.output
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1 and len(lines[0]) <= MAX_MESSAGE + len("error: "), result.stderr
    assert "Traceback" not in result.output, name


def test_no_command_is_left_out():
    assert {*ALL, *SOME, *NONE} == set(cli.list_commands(click.Context(cli)))
    assert not (set(ALL) & set(SOME)) and set(ALL) <= {*ALL, "export"}


@pytest.mark.parametrize("machine", EVERY)
@pytest.mark.parametrize("name", ALL)
def test_a_command_for_any_machine_works_with_each(name, machine, folders, monkeypatch):
    def ended(*_, **__):
        raise exo.InputError("the diagnosis began")

    monkeypatch.setattr(pipeline, "diagnose", ended)
    effect = exo.load_robot(machine).machine.effects[0].id  # one, since many take minutes
    words = [word.replace("{}", str(folders[machine])).replace("{effect}", effect) for word in ALL[name]]
    result = run(name, *words, *([] if name == "export" else ["--robot", machine]))
    if name in ("diagnose", "experiment"):
        assert_one_sentence(result, name)
        assert "the diagnosis began" in result.stderr or "frames" in result.stderr, result.stderr
    elif name in REFUSED:
        assert_one_sentence(result, name)
        assert "absent" in result.stderr
    else:
        assert result.exit_code in (0, 1 if name == "watch" else 0), result.output


# every command that takes seconds, with arguments that let it answer; {} is a folder with a log of a machine
ANSWERS = {
    "simulate": [SHORT, "--out", "{}/run", "--robot", "emps"],
    "sweep": ["--reference", "{}/log.csv", "--robots", "2", "--robot", "emps"],
    "compare": ["{}/log.csv", "{}/log.csv", "--robot", "emps"],
    "show": ["{}/log.csv", "--out", "{}/base.html", "--robot", "exo_index"],
    "robot": ["emps"],
    "effects": ["--robot", "emps"],
    "draw": ["--out", "{}/wiring.svg"],
    "check": ["{}/log.csv", "--effects", "{effect}", "--robot", "emps"],
    "fleet": ["{}/answers"],
    "watch": ["{}/log.csv", "--until-idle", "0", "--robot", "emps"],
    "blind make": ["--seed", "1", "--cases", "1", "--out", "{}/cases"],
    "import": ["{}/log.csv"],
    "export": ["{}/log.csv", "--out", "{}/log.npz"],
    "new-machine": ["{}/my_arm"],
    "alarm-limits": ["--robots", "2", "--minutes", "0.5", "--jobs", "1", "--robot", "emps"],
    "response": ["{}/log.csv", "--robot", "emps"],
    "identify synthesise": ["{}/markers.csv", "--duration", "12"],
    "identify kinematics": ["{}/markers.csv", "--out", "{}/kinematics"],
}


@pytest.mark.parametrize("name", ANSWERS)
def test_json_is_printed_alone_and_nothing_is_written_unasked(name, folders, tmp_path, monkeypatch):
    """Of each command that takes seconds; the current folder stays empty."""
    folder = folders["exo_index" if name == "show" else "emps"]
    answer = folder / "answers" / "one"
    answer.mkdir(parents=True, exist_ok=True)
    (answer / "diagnosis.json").write_text(json.dumps(diagnosis().to_json()))
    monkeypatch.chdir(tmp_path)
    effect = exo.load_robot("emps").machine.effects[0].id
    words = [word.replace("{}", str(folder)).replace("{effect}", effect) for word in ANSWERS[name]]
    result = run(*name.split(), *words, "--json")
    assert result.exit_code == 0 and json.loads(result.stdout), result.output
    assert not list(tmp_path.iterdir())


def test_every_command_takes_json_and_an_output_is_named_out():
    """A command that writes files has --out; those of `blind` and `identify` too."""
    for name in cli.list_commands(click.Context(cli)):
        command = cli.get_command(click.Context(cli), name)
        for one in command.commands.values() if isinstance(command, click.Group) else [command]:
            taken = {word for parameter in one.params for word in parameter.opts}
            assert "--json" in taken, (name, one.name)
            assert "--out" in taken or not taken & {"--figure", "--out-robot", "--report", "--table"}, name


@pytest.mark.parametrize("machine", EVERY)
@pytest.mark.parametrize("name", SOME)
def test_a_command_for_one_machine_says_why_it_takes_no_other(name, machine, folders):
    if name in LONG and (machine == MADE_FOR or (machine in LOOPS and name != "workspace")):
        return
    words = [word.replace("{}", str(folders[machine])) for word in SOME[name]]
    result = run(name, *words, "--robot", machine)
    if (machine == MADE_FOR or (name == "show")) and name not in REFUSED:
        assert result.exit_code == 0, result.output
        return
    assert_one_sentence(result, name)
    if machine != MADE_FOR and name not in ("train", "estimate"):
        assert machine in result.stderr


@pytest.mark.parametrize("name", OTHERS)
def test_a_command_without_machines_of_ones_own_says_why(name):
    command = cli.get_command(click.Context(cli), name)
    part = list(command.commands) if isinstance(command, click.Group) else []
    if "--machine" in {word for p in command.params if not getattr(p, "hidden", False) for word in p.opts}:
        return
    result = run(name, *part[:1], "--machine", machine_folders()["emps"])
    assert_one_sentence(result, name)
    assert OTHERS[name][:40] in result.stderr


def test_import_points_from_a_robot_to_a_mapping():
    result = run("import", "log.mat", "--robot", "emps")
    assert_one_sentence(result, "import")
    assert "takes no --robot: --map FILE" in result.stderr


@pytest.mark.parametrize("name", [name for name in [*ALL, *SOME] if name != "export"])
def test_an_unknown_robot_is_refused_with_those_that_there_are(name, folders):
    words = [word.replace("{}", str(folders[MADE_FOR])) for word in {**ALL, **SOME}[name]]
    result = run(name, *words, "--robot", "foo")
    assert_one_sentence(result, name)
    assert name == "estimate" or ("foo" in result.stderr and (name == "train" or "tendon_sheath" in result.stderr))
    assert not os.path.exists("foo")
