"""Faults planted in joints of many sizes and rates, by closed forms and Euler's method, not by the models.

    python -m studies.sizes --work DIR --jobs 2 --out sizes.md

Each case is made and answered as an owner would: `new-machine`, its nominal numbers, three recordings in CSV, `import`,
`diagnose`. Two are fitted, one is held out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import click
import numpy as np

from exodrake.cli.main import OneLineErrors, cli
from exodrake.core import schema
from exodrake.core.errors import markdown_table
from exodrake.core.files import write_text
from exodrake.core.parallel import each
from studies.page_text import keep, share


class Size(NamedTuple):
    """A joint and how it moves."""

    frame: float  # s
    reach: float  # rad
    pace: float  # rad/s of its motion, per rad
    time: float  # s
    noise: float  # rad, of a measured angle
    joint: dict[str, float]  # numbers of its motor or load


class Sort(NamedTuple):
    """A kind of machine."""

    options: tuple[str, ...]  # of `new-machine`
    sizes: dict[str, Size]
    # fault -> its amount in a size, and the kinds of effects, or ids, that name it: one set for each cause
    faults: dict[str, tuple[Callable[[Size], float], tuple[set[str], ...]]]
    record: Callable[[np.ndarray, Size, str, float], np.ndarray]  # what is measured of a motion, with a fault
    columns: dict[str, str]  # kind -> unit, of the motion and of what is measured
    derived: dict[str, dict[str, str]]  # further columns, as a mapping file has them
    stated: Callable[[Size], dict[str, float]] = lambda size: {}  # of the robot file


def move(kind: str, size: Size, random: np.random.Generator) -> np.ndarray:
    """A motion (rows,) [rad]: five sines, or moves at one speed between random places with rests."""
    time = size.frame * np.arange(round(size.time / size.frame))
    if kind == "sines":
        rates, phases = size.pace * np.array([0.4, 0.7, 1.1, 1.6, 2.3]), random.uniform(0.0, 2.0 * np.pi, 5)
        sines = (np.sin(rate * time + phase) / (k + 1) for k, (rate, phase) in enumerate(zip(rates, phases)))
        motion = np.sum(list(sines), axis=0)
        return size.reach * (motion - motion[0]) / 1.6
    place, aim, rest, motion = 0.0, 0.0, 0.5 / size.pace, []
    for _ in time:
        rest -= size.frame if place == aim else 0.0
        if rest < 0.0:
            aim, rest = float(random.uniform(-size.reach, size.reach)), 0.5 / size.pace
        step = size.reach * size.pace * size.frame
        place += min(max(aim - place, -step), step)
        motion.append(place)
    return np.array(motion)


def follow(step: Callable[[float, float], float], motion: np.ndarray) -> np.ndarray:
    """What goes on from its last value to the next one of a motion."""
    values = [float(motion[0])]
    for aim in motion[1:]:
        values.append(step(values[-1], float(aim)))
    return np.array(values)


def late(motion: np.ndarray, rows: float) -> np.ndarray:
    """A motion some rows ago."""
    return np.interp(np.arange(len(motion)) - rows, np.arange(len(motion)), motion)


def servo(motion: np.ndarray, size: Size, fault: str, amount: float) -> np.ndarray:
    """The angle of an ideal servo with a fault."""
    dt = size.frame
    laws = {
        "delay": lambda: late(motion, amount / dt),
        "lag": lambda: follow(lambda x, aim: x + (aim - x) * (1.0 - np.exp(-dt / amount)), motion),
        "speed limit": lambda: follow(lambda x, aim: x + np.clip(aim - x, -amount * dt, amount * dt), motion),
        "play": lambda: follow(lambda x, aim: min(max(x, aim - amount), aim + amount), motion),
        "gain": lambda: motion * (1.0 + amount), "offset": lambda: motion + amount,
        "saturation": lambda: np.clip(motion, -amount, amount), "none": lambda: motion,
        "lag and gain": lambda: (1.0 + amount) * servo(motion, size, "lag", 0.08),
        "delay and play": lambda: servo(late(motion, 0.05 / dt), size, "play", amount),
        "delay and speed limit": lambda: servo(late(motion, 0.05 / dt), size, "speed limit", amount),
    }  # fmt: skip
    return laws[fault]()


TICK, READ = 2.5e-4, 6  # s of Euler's method; ticks after a command at which the angle is read, as the model states


def motor(motion: np.ndarray, size: Size, fault: str, amount: float) -> np.ndarray:
    """The angle of a servo of motor and gear under a proportional loop: J q'' = kt (u V - kt q') / R - d q' - m sin q.

    Dry friction stops the joint or takes so much off its speed.
    """
    p = size.joint | {"damping": 0.0, "friction": 0.0}
    if fault in p:
        p[fault] = amount if fault in ("damping", "friction") else p[fault] * (1.0 + amount)
    aims = late(motion, amount / size.frame) if fault == "delay" else motion
    inertia, angle, speed, read = p["inertia"] + p["armature"], float(motion[0]), 0.0, []
    for aim in aims:
        for tick in range(round(size.frame / TICK)):
            if tick == READ:
                read.append(angle)
            error = float(aim) - angle
            error = 0.0 if fault == "dead band" and abs(error) < amount else error
            duty = min(max(p["kp"] * error, -1.0), 1.0)
            torque = p["kt"] / p["R"] * (duty * p["supply"] - p["kt"] * speed) - p["damping"] * speed
            speed += TICK * (torque - p["moment"] * np.sin(angle)) / inertia
            speed = float(np.sign(speed)) * max(abs(speed) - TICK * p["friction"] / inertia, 0.0)
            angle += TICK * speed
    return np.array(read) + (amount if fault == "offset" else 0.0)


def usual(size: Size) -> tuple[float, float]:
    """Usual speed [rad/s] and effort [N m] of a pendulum."""
    most = size.joint["inertia"] * size.reach * size.pace**2 + size.joint["moment"] * np.sin(min(size.reach, 1.5))
    return 0.5 * size.reach * size.pace, 0.5 * float(most)


def smooth(motion: np.ndarray, size: Size) -> np.ndarray:
    """A motion without corners."""
    width = max(3, round(0.15 / size.pace / size.frame))
    window = np.hanning(width + 2)[1:-1] / np.hanning(width + 2).sum()
    for _ in range(2):
        motion = np.convolve(np.pad(motion, width, mode="edge"), window, "same")[width:-width]
    return motion


def pendulum(motion: np.ndarray, size: Size, fault: str, amount: float) -> np.ndarray:
    """The effort that moves a pendulum: J q'' + m sin q."""
    dt, joint, (speed, effort) = size.frame, size.joint, usual(size)
    rate = np.gradient(motion, dt)
    plain = joint["inertia"] * np.gradient(rate, dt) + joint["moment"] * np.sin(motion)
    dry, viscous = effort * np.tanh(rate / (0.01 * speed)), effort / speed * rate
    laws = {
        "dry friction": lambda: plain + amount * dry, "viscous friction": lambda: plain + amount * viscous,
        "inertia": lambda: plain + amount * joint["inertia"] * np.gradient(rate, dt),
        "gain": lambda: plain * (1.0 + amount), "offset": lambda: plain + amount * effort,
        "delay": lambda: late(plain, amount / dt), "none": lambda: plain,
        "dry and viscous friction": lambda: plain + amount * (dry + viscous),
        "dry friction and offset": lambda: plain + amount * (dry + 0.5 * effort),
        "light link and viscous friction": lambda: (1.0 - amount) * plain + amount * viscous,
    }  # fmt: skip
    return laws[fault]()


CONTROL = 10  # ticks of a quarter after the row at which a controller computes, those after READ; as the model states


def driven(motion: np.ndarray, size: Size, fault: str, amount: float) -> np.ndarray:
    """Angle and effort (rows, 2) of a pendulum under a PD controller: J q'' = tau - d q' - m sin q.

    Critically damped, with a derivative over a row. Dry friction stops the joint or takes so much off its speed.
    """
    joint, tick = size.joint, 0.5 * TICK
    faults = "inertia", "gain", "loop gain", "friction", "damping", "torque", "offset"
    p = dict.fromkeys(faults, 0.0) | {fault: amount}
    inertia, stiffness, viscosity = joint["inertia"] * (1.0 + p["inertia"]), *gains(size)
    angle, speed, effort, seen, before, read = float(motion[0]), 0.0, 0.0, 0.0, None, []
    for aim in late(motion, amount) if fault == "delay" else motion:
        for k in range(round(size.frame / tick)):
            seen = angle + p["offset"] if k == READ else seen
            if k == CONTROL:
                error = float(aim) - seen
                rate = 0.0 if before is None else (error - before) / size.frame
                effort, before = (1.0 + p["loop gain"]) * stiffness * error + viscosity * rate, error
                read.append((seen, (1.0 + p["gain"]) * effort))
            torque = (1.0 + p["torque"]) * effort - p["damping"] * speed - joint["moment"] * np.sin(angle)
            speed += tick * torque / inertia
            speed = float(np.sign(speed)) * max(abs(speed) - tick * p["friction"] / inertia, 0.0)
            angle += tick * speed
    return np.array(read)


def gains(size: Size) -> tuple[float, float]:
    """Gains of a critically damped PD controller [N m/rad, N m s/rad]."""
    inertia, rate = size.joint["inertia"], size.joint["rate"]
    return inertia * rate**2, 2.0 * inertia * rate


def stall(size: Size) -> float:
    """Stall torque of a motor [N m]."""
    return size.joint["kt"] * size.joint["supply"] / size.joint["R"]


USUAL = {"kt": 1.3, "R": 2.75, "supply": 7.4, "kp": 5.3, "inertia": 0.03, "armature": 0.02, "moment": 0.5}
LARGE = {"kt": 8.0, "R": 2.0, "supply": 24.0, "kp": 4.0, "inertia": 2.0, "armature": 1.0, "moment": 8.0}
SMALL = {"kt": 0.25, "R": 4.0, "supply": 6.0, "kp": 6.0, "inertia": 5e-4, "armature": 3e-4, "moment": 0.02}
VOLTAGE = {"servo.supply", "servo.loop_gain"}
COUNTS = 4e-4  # rad, of an encoder of 12 bits
SERVO, START = {"angle_ref": "rad", "angle": "rad"}, {"angle_start_axis": {"of": "angle_axis", "take": "first"}}
RATES = {
    "velocity_axis": {"of": "position_axis", "take": "rate"},
    "acceleration_axis": {"of": "velocity_axis", "take": "rate"},
}
SORTS = {
    "servo": Sort(("--joints", "axis"), {
        "1 kHz": Size(0.001, 0.4, 6.0, 6.0, 2e-4, {}), "500 Hz": Size(0.002, 0.6, 4.0, 10.0, 1e-3, {}),
        "100 Hz": Size(0.01, 0.8, 1.5, 20.0, 1e-3, {}), "50 Hz": Size(0.02, 1.0, 2.0, 20.0, 4e-3, {}),
        "10 Hz": Size(0.1, 1.5, 0.4, 120.0, 5e-3, {}), "turns": Size(0.01, 20.0, 1.0, 20.0, 2e-2, {}),
        "2 degrees": Size(0.02, 0.03, 2.0, 20.0, 1e-4, {}),
    }, {
        "none": (lambda size: 0.0, ()), "delay": (lambda size: 0.05 if size.frame < 0.1 else 0.15, ({"delay"},)),
        "lag": (lambda size: 0.08 if size.frame < 0.1 else 0.3, ({"lag"},)),
        "speed limit": (lambda size: 0.5 * size.reach * size.pace, ({"speed limit"},)),
        "play": (lambda size: 0.04 * size.reach, ({"backlash"},)), "gain": (lambda size: -0.12, ({"gain"},)),
        "offset": (lambda size: 0.15 * size.reach, ({"offset"},)),
        "saturation": (lambda size: 0.6 * size.reach, ({"saturation"},)),
        "lag and gain": (lambda size: -0.1, ({"lag"}, {"gain"})),
        "delay and play": (lambda size: 0.05 * size.reach, ({"delay"}, {"backlash"})),
        "delay and speed limit": (lambda size: 0.6 * size.reach * size.pace, ({"delay"}, {"speed limit"})),
    }, servo, SERVO, START),
    "motor": Sort(("--joints", "axis", "--servo", "motor"), {
        "3.5 N m": Size(0.02, 1.0, 1.5, 15.0, 1e-3, USUAL), "96 N m": Size(0.01, 0.8, 0.8, 15.0, 5e-4, LARGE),
        "0.4 N m": Size(0.005, 0.8, 3.0, 8.0, 1e-3, SMALL),
    }, {
        "none": (lambda size: 0.0, ()), "kt": (lambda size: -0.2, ({"servo.torque_constant"},)),
        "supply": (lambda size: -0.2, (VOLTAGE,)), "kp": (lambda size: -0.3, (VOLTAGE,)),
        "moment": (lambda size: 0.6, ({"servo.gravity_moment"},)),
        "inertia": (lambda size: 1.0, ({"servo.load_inertia"},)),
        "friction": (lambda size: 0.08 * stall(size), ({"dry friction"},)),
        "damping": (lambda size: 0.3 * size.joint["kt"] ** 2 / size.joint["R"], ({"viscous friction"},)),
        "delay": (lambda size: 0.04, ({"delay"},)), "dead band": (lambda size: 0.02, ({"servo.dead_band"},)),
        "offset": (lambda size: 0.08, ({"offset"},)),
    }, motor, SERVO, START, lambda size: {f"servo.{key}": value for key, value in size.joint.items()}),
    "arm": Sort(("--urdf", "arm.urdf"), {
        "0.01 N m": Size(0.005, 1.0, 3.0, 10.0, COUNTS, {"inertia": 1e-4, "moment": 1e-2}),
        "400 N m": Size(0.01, 0.8, 1.0, 20.0, COUNTS, {"inertia": 50.0, "moment": 400.0}),
        "1 kHz": Size(0.001, 0.8, 3.0, 6.0, COUNTS, {"inertia": 0.5, "moment": 8.0}),
        "voltage": Size(0.02, 6.0, 2.0, 20.0, COUNTS, {"inertia": 0.02, "moment": 1e-6}),
        "500 Hz": Size(0.002, 0.8, 3.0, 8.0, COUNTS, {"inertia": 0.05, "moment": 0.5}),
    }, {
        "none": (lambda size: 0.0, ()), "dry friction": (lambda size: 0.3, ({"dry friction"},)),
        "viscous friction": (lambda size: 0.3, ({"viscous friction"},)),
        "inertia": (lambda size: 0.6, ({"inertia"},)), "gain": (lambda size: 0.25, ({"gain"},)),
        "offset": (lambda size: 0.3, ({"offset"},)),
        "delay": (lambda size: min(max(2.0 * size.frame, 0.008), 0.02), ({"delay"},)),
        "dry and viscous friction": (lambda size: 0.25, ({"dry friction"}, {"viscous friction"})),
        "dry friction and offset": (lambda size: 0.3, ({"dry friction"}, {"offset"})),
        "light link and viscous friction": (lambda size: 0.55, ({"inertia", "gain"}, {"viscous friction"})),
    }, pendulum, {"position": "rad", "effort": "N m"}, RATES),
    "loop": Sort(("--urdf", "arm.urdf", "--form", "closed-loop"), {
        "500 Hz": Size(0.002, 0.8, 3.0, 8.0, 2e-5, {"inertia": 0.05, "moment": 0.5, "rate": 20.0}),
        "100 Hz": Size(0.01, 0.8, 1.0, 20.0, 2e-5, {"inertia": 0.05, "moment": 0.5, "rate": 8.0}),
        "200 N m": Size(0.005, 0.8, 1.0, 15.0, 2e-5, {"inertia": 20.0, "moment": 150.0, "rate": 15.0}),
        "wrist": Size(0.005, 0.6, 3.0, 8.0, 2e-5, {"inertia": 1e-3, "moment": 1e-2, "rate": 25.0}),
    }, {
        "none": (lambda size: 0.0, ()), "friction": (lambda size: 0.3 * usual(size)[1], ({"dry friction"},)),
        "damping": (lambda size: 0.3 * usual(size)[1] / usual(size)[0], ({"viscous friction"},)),
        "inertia": (lambda size: 0.6, ({"inertia"},)), "gain": (lambda size: 0.2, ({"torque.gain"},)),
        "loop gain": (lambda size: -0.3, ({"arm_drive.position_gain"},)),
        "torque": (lambda size: -0.2, ({"gear_motor.torque_gain", "arm.link_mass"},)),  # or 1.25 of the mass
        "delay": (lambda size: 4.0, ({"delay"},)), "offset": (lambda size: 0.06, ({"arm.encoder_offset"},)),
    }, driven, {"position_ref": "rad", "position": "rad", "effort": "N m"}, {
        "position_start_axis": {"of": "position_axis", "take": "first"},
    }, lambda size: dict(zip(("drive.stiffness", "drive.viscosity", "drive.feedforward"), (*gains(size), 0.0)))),
}  # fmt: skip
URDF = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial>
<origin xyz="0 0 {0}"/><mass value="{1}"/><inertia ixx="{2}" ixy="0" ixz="0" iyy="{2}" iyz="0" izz="{2}"/>
</inertial></link>
<joint name="axis" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-100" upper="100" effort="{3}" velocity="100"/></joint></robot>"""


def kept(name: str, sort: str, size: str, fault: str, work: Path) -> tuple[str, dict[str, Any]]:
    """The name and the answer of a case, which is kept."""
    return name, keep(work / f"{name}.json", lambda: answer(name, sort, SORTS[sort].sizes[size], fault, work))


def answer(name: str, sort: str, size: Size, fault: str, work: Path) -> dict[str, Any]:
    """The answer to a case, which is made in a folder of its own."""
    from click.testing import CliRunner

    def run(*words: object) -> str:
        result = CliRunner().invoke(cli, [str(word) for word in words])
        if result.exit_code:
            raise RuntimeError(f"{name}: {words[0]}: {result.output}")
        return result.stdout

    machine, folder, slug = SORTS[sort], work / name, re.sub(r"\W", "_", f"m_{name}").lower()
    folder.mkdir(parents=True)
    options = [str(folder / word) if word == "arm.urdf" else word for word in machine.options]
    columns: dict[str, Any] = {kind: {"name": f"{kind}_axis", "unit": unit} for kind, unit in machine.columns.items()}
    if size.joint and "kt" not in size.joint:  # an arm
        inertia, moment = size.joint["inertia"], size.joint["moment"]
        lever = min(0.5 * inertia / max(moment / 9.81, 1e-12), 0.3)  # half of the inertia or more is about the centre
        mass = moment / 9.81 / lever
        write_text(folder / "arm.urdf", URDF.format(-lever, mass, inertia - mass * lever**2, 100.0 * usual(size)[1]))
    run("new-machine", folder / slug, *options, "--frame", size.frame)
    robot = schema.read_yaml(folder / slug / "robot.yaml")
    for parameter, value in machine.stated(size).items():
        part, key = parameter.split(".")
        robot["parameters"][part].setdefault(key, {"source": "set"})["value"] = value
    write_text(folder / slug / "robot.yaml", schema.dump_yaml(robot))
    if sort == "arm":
        cut = min(0.2 / size.frame, max(3.0, 3.0 * size.pace))
        columns = {kind: column | {"filter": cut} for kind, column in columns.items()}
    clock = {"column": "time", "unit": "s", "start": 0}
    mapping = {"time": clock, "columns": columns, "derived": machine.derived, "period": size.frame}
    write_text(folder / slug / "mapping.yaml", schema.dump_yaml(mapping))
    random, files = np.random.default_rng(crc32(name.encode())), []
    for number, motion in enumerate(("sines", "moves", "sines")):
        sent = move(motion, size, random)
        sent = smooth(sent, size) if "effort" in columns else sent
        shown = machine.record(sent, size, fault, machine.faults[fault][0](size)).reshape(len(sent), -1)
        noise = [0.01 * usual(size)[1] if kind == "effort" else size.noise for kind in list(columns)[1:]]
        shown = shown + noise * random.standard_normal(shown.shape)
        sent = sent + size.noise * random.standard_normal(len(sent)) if sort == "arm" else sent
        ends = slice(len(sent) // 20, len(sent) - len(sent) // 20) if sort == "arm" else slice(None)
        files.append(folder / f"{motion}{number}.csv")
        rows = np.column_stack([size.frame * np.arange(len(sent)), sent, shown])[ends]
        np.savetxt(files[-1], rows, delimiter=",", header=",".join(("time", *columns)), comments="", fmt="%.9g")
    run("import", *files, "--machine", folder / slug, "--out", folder / "case")
    return json.loads(run("diagnose", folder / "case", "--machine", folder / slug, "--json"))


def is_right(found: dict[str, Any], wanted: tuple[set[str], ...]) -> bool:
    """Whether an answer has the wanted causes and no others; none where no fault was planted."""
    causes = [{effect["id"], effect["kind"]} for effect in found["effects"] if effect["role"] == "cause"]
    if not wanted:
        return found["verdict"] in ("NO_GAP", "RETUNE")
    return len(causes) == len(wanted) and all(any(cause & one for cause in causes) for one in wanted)


def list_cases() -> Iterator[tuple[str, str, str, str]]:
    """Name, sort, size and fault of each case."""
    for sort, kind in SORTS.items():
        for size in kind.sizes:
            for fault in kind.faults:
                yield re.sub(r"\W+", "_", f"{sort}_{size}_{fault}"), sort, size, fault


def page(found: dict[str, dict[str, Any]], command: str) -> str:
    """The page: right answers of each sort and size, and the wrong ones."""
    rows, wrong = [], []
    for sort, kind in SORTS.items():
        for size in kind.sizes:
            own = [(name, fault) for name, s, z, fault in list_cases() if (s, z) == (sort, size) and name in found]
            right = [is_right(found[name], kind.faults[fault][1]) for name, fault in own]
            rows.append((sort, size, share(sum(right), len(right))))
            for (name, fault), good in zip(own, right):
                causes = [e["id"] for e in found[name]["effects"] if e["role"] == "cause"]
                if not good:
                    wrong.append((sort, size, fault, " + ".join([found[name]["verdict"], *causes])))
    tables = (
        markdown_table(("machine", "size", "right"), rows),
        markdown_table(("machine", "size", "planted", "answer"), wrong),
    )
    return "\n\n".join([TEXT.format(command=command), *tables]) + "\n"


TEXT = """Faults planted in single joints by closed forms and Euler's method. Right: the planted causes, alone or with
rivals, and no others; no gap where nothing was planted. Development cases: what they showed wrong was mended. `loop` is
a pendulum under a PD controller, `arm` one whose efforts are predicted from the counts of an encoder of 12 bits.

    {command}"""


@click.command(cls=OneLineErrors)
@click.option(
    "--work", required=True, type=click.Path(path_type=Path), help="Folder of cases and answers; kept ones stay."
)
@click.option("--only", default="", help="Part of the names of cases.")
@click.option("--jobs", default=1, show_default=True, type=int, help="Processes.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(work: Path, only: str, jobs: int, out: Path | None) -> None:
    """Plant faults, diagnose them, and count the right answers."""
    answers, tasks = {}, [(name, *rest, work) for name, *rest in list_cases() if only in name]
    for outcome in each(kept, tasks, jobs):
        if outcome.reason:
            raise RuntimeError(outcome.reason)
        name, answers[name] = outcome.value
        click.echo(f"{name}: {answers[name]['verdict']} {' + '.join(e['id'] for e in answers[name]['effects'])}")
    if out:
        write_text(out, page(answers, f"python -m studies.sizes --work {work} --out {out}"))


if __name__ == "__main__":
    command()
