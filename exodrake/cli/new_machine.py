"""`exodrake new-machine`: a folder with a machine of one's own, which runs at once."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import AnyPath

if TYPE_CHECKING:
    from exodrake.core.mechanism import Chain


SCAFFOLD, MOTOR_SCAFFOLD = Path(__file__).parent / "scaffold", Path(__file__).parent / "scaffold_motor"
NAME = re.compile(r"[a-z][a-z0-9_]*")
CHANNEL = re.compile(r"[A-Za-z][A-Za-z0-9]*")
FRAME = 0.02  # s, of servos on a bus: assumed
TURN = 1.0  # rad either way that a protocol asks for until the owner says otherwise: assumed, a moderate motion
SLOWEST = 10.0  # s, as the longest frame of a case


@click.command()
@click.argument("folder", type=AnyPath())
@click.option("--joints", default="shoulder,elbow", show_default=True, metavar="A,B", help="Names of the joints.")
@click.option(
    "--servo", default=None, type=click.Choice(("ideal", "motor")), help="Of --joints: kind of servo. [ideal]"
)
@click.option("--frame", default=None, type=float, help="From one row to the next [s]. [0.02, of an arm 0.005]")
@click.option("--urdf", default="", metavar="FILE", help="An arm: its URDF, or cable_arm, linear_axis, rotary_axis.")
@click.option("--form", default=None, help="Of an arm: inverse, closed-loop or cable. [inverse]")
@click.option("--tip", default="", metavar="LINK", help="Of an arm whose joints branch: its last link.")
def command(
    folder: Path, joints: str, servo: str | None, frame: float | None, urdf: str, form: str | None, tip: str
) -> None:
    """Write FOLDER with a machine of position servos: machine.py, robot.yaml, mapping.yaml, a test and a README.

    With --servo ideal a joint stands where it is told at once. With --servo motor it moves by the equation of motion of
    firmware, supply, DC motor, gear and load.

    With --urdf it is a serial arm without code. Its form is `inverse`, efforts predicted from measured motion,
    `closed-loop`, references through PD controller, motors and forward dynamics, or `cable`, with cables between motors
    and joints.

    The folder's name is the machine's. It runs as it is, for instance `exodrake simulate chirp --machine FOLDER`; then
    make it yours. Nothing that exists is overwritten.
    """
    from exodrake.core.errors import InputError
    from exodrake.core.files import write_folder

    names = checked(folder, joints, FRAME if frame is None else frame, code=not urdf)
    if (form or tip) and not urdf:
        raise InputError("--form and --tip are of an arm, which --urdf describes")
    if servo and urdf:
        raise InputError("--servo is of a machine of position servos, --urdf of an arm; name one of them")
    if urdf:
        texts = arm_files(folder, urdf, form or "inverse", tip, frame)
    else:
        texts = {
            name: text.encode() for name, text in contents(folder, names, frame or FRAME, servo == "motor").items()
        }
    files = write_folder(folder, texts)
    click.echo(f"{folder}: {', '.join(file.name for file in files)}")
    click.echo(f"try it: exodrake simulate chirp --machine {folder}")


def checked(folder: Path, joints: str, frame: float, code: bool) -> tuple[str, ...]:
    """Names of the joints; code: whether the folder gets some. InputError for a name that is none or taken."""
    from exodrake import machines
    from exodrake.core.errors import InputError
    from exodrake.machines.library import machine_names

    name = folder.resolve().name
    if not NAME.fullmatch(name):
        raise InputError(f"{folder}: the folder's name is the machine's: small letters, digits and _, like my_arm")
    if name in machine_names():
        raise InputError(f"{folder}: there is a machine {name} already; name the folder otherwise")
    if code and Path(machines.__path__[0], f"{name}.py").is_file():
        raise InputError(f"{folder}: exodrake.machines has a module {name}; name the folder otherwise")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is there already, and not empty")
    found = tuple(joint.strip() for joint in joints.split(","))
    for joint in found:
        if not CHANNEL.fullmatch(joint) or found.count(joint) > 1:
            raise InputError(f"--joints: {joint!r} is no name of its own: letters and digits, like shoulder or J1")
    if not 0.0 < frame <= SLOWEST:
        raise InputError(f"--frame: {frame:g} s, wanted above 0 and up to {SLOWEST:g} s")
    return found


def contents(folder: Path, joints: tuple[str, ...], frame: float, motor: bool) -> dict[str, str]:
    """Texts of the folder's files by name; motor: whether files of servos with motors replace those of ideal ones."""
    from string import Template

    several = len(joints) > 1
    names = ", ".join(f'"{joint}"' for joint in joints) + ("" if several else ",")
    coupling = ["next", "previous"] if several else []
    values = {
        "name": folder.resolve().name, "folder": str(folder), "joints": names, "frame": f"{frame:g}",
        "coupling": "".join(f'    for_machine("joint.coupling_to_{n}", "servo.coupling_to_{n}"),\n' for n in coupling),
        "most": str(8 if several else 4),
        "lowest": ", ".join(f"{joint}: {-TURN}" for joint in joints),
        "highest": ", ".join(f"{joint}: {TURN}" for joint in joints),
        "columns": "\n".join(
            f"  {joint}_{mine}: {{name: {kind}_{joint}, unit: deg}}"
            for joint in joints for mine, kind in (("cmd", "angle_ref"), ("pos", "angle"))
        ),
        "derived": "\n".join(f"  angle_start_{joint}: {{of: angle_{joint}, take: first}}" for joint in joints),
    }  # fmt: skip
    files = [file for folder in (SCAFFOLD, *[MOTOR_SCAFFOLD] * motor) for file in sorted(folder.glob("*.txt"))]
    found = {file.name.removesuffix(".txt"): file.read_text() for file in files}
    return {name: Template(text).substitute(values) for name, text in found.items()}


ARM_SCAFFOLD = Path(__file__).parent / "scaffold_arm"
WIDEST = 1.0  # rad, or half a range, either way of the middle that a protocol asks for: assumed, a moderate motion
NOISE = 0.01  # of a moderate motion's effort: assumed
SMALLEST = 0.002  # of the largest effort of all joints, for joints that hardly need any: assumed
ANGLE_NOISE = 2e-5  # rad at the joint, of encoders at rest: assumed
FILTER = 10.0  # Hz, of a derivative: assumed
WHAT = {
    "inverse": "its efforts predicted from measured motion (inverse dynamics)",
    "closed-loop": "moved by motors under a PD controller (forward dynamics)",
    "cable": "moved by motors through cables under a PD controller (forward dynamics)",
}


def arm_files(folder: Path, urdf: str, form: str, tip: str, frame: float | None) -> dict[str, bytes]:
    """Contents of the folder's files by name.

    Raises:
        InputError: for an unknown form, and a URDF file that is absent or no serial arm.
    """
    from string import Template

    from exodrake.core.errors import InputError, nearest
    from exodrake.core.files import is_file, read_bytes
    from exodrake.machines.serial_arm import FRAME
    from exodrake.machines.urdf import read_urdf

    if form not in WHAT:
        raise InputError(f"--form: unknown form {form!r}{nearest(form, list(WHAT))}; there are {', '.join(WHAT)}")
    built_in = {file.stem: file for file in ARM_SCAFFOLD.glob("*.urdf")}
    path = Path(urdf) if is_file(urdf) else built_in.get(urdf)
    if path is None:
        raise InputError(f"--urdf: no file {urdf!r}; of its own exodrake has {', '.join(sorted(built_in))}")
    values = texts_of(read_urdf(path, tip), form)
    values |= {
        "name": folder.resolve().name, "folder": str(folder), "urdf": "arm.urdf", "form": form,
        "what": WHAT[form], "frame": f"{frame or FRAME:g}", "tip": f", tip: {tip}" if tip else "",
    }  # fmt: skip
    values["own"] = Template((ARM_SCAFFOLD / "own" / f"{form}.txt").read_text()).substitute(values)
    found = {file.name.removesuffix(".txt"): file.read_text() for file in sorted(ARM_SCAFFOLD.glob("*.txt"))}
    texts = {name: Template(text).substitute(values).encode() for name, text in found.items()}
    return {"arm.urdf": read_bytes(path), **texts}


def texts_of(chain: Chain, form: str) -> dict[str, str]:
    """Texts of the joints for the generated files."""
    from exodrake.machines.serial_arm import RATIO, middle, typical_efforts, units

    unit, efforts, names = units(chain), typical_efforts(chain), chain.names
    cable, inverse = form == "cable", form == "inverse"
    noise = NOISE * efforts.clip(SMALLEST / NOISE * efforts.max()) * (RATIO if cable else 1.0)
    reach = [min(WIDEST, 0.45 * (j.upper - j.lower)) for j in chain.joints]
    places = middle(chain)
    before = "joint_" if unit["position"] == "-" and not cable else ""
    columns = [
        f'  {joint}_{column}: {{name: {kind}_{joint}, unit: "{u}"}}'
        for joint in names for column, kind, u in given(form, before, unit["position"], unit["effort"])
    ]  # fmt: skip
    derived = [line for joint in names for line in derived_of(before, joint, unit, form)]
    mobility = float(f"{0.01 / efforts.max():.1g}")  # 0.01 rad/s at the level of the largest effort: assumed
    found = {
        "rotors": joined(names, [0.0] * len(names)), "noise": joined(names, noise),
        "repeatability": f"{float(noise.min()) / 10:.2g}",
        "force": '"N m"' if cable else f'"{unit["effort"]}"',
        "angle": f'"{unit["position"]}"', "inertia": f'"{unit["inertia"]}"',
        "lowest": joined(names, places - reach), "highest": joined(names, places + reach),
        "limited": "assumed: a moderate motion about the middle of the URDF's limits",
        "mobility": f"{mobility:g}", "columns": "\n".join(columns), "derived": "\n".join(derived),
        "derived_note": "rates of the motion, through a filter whose cut-off you choose" if inverse
        else "where each joint stands at first", "part": "cable" if cable else "arm",
    }  # fmt: skip
    return found | cable_texts(chain, unit) if cable else found


def cable_texts(chain: Chain, unit: dict[str, str]) -> dict[str, str]:
    """Texts of motors and cables for the robot file."""
    from exodrake.machines.serial_arm import RATIO, cable_defaults, typical_efforts

    values = cable_defaults(chain, typical_efforts(chain), 0.0)
    rows = {"stiffness": "stiffness", "pretension": "pretension", "motors": "inertia"}
    found = {key: joined(chain.names, [values[f"cable.{name}.{j}"] for j in chain.names]) for key, name in rows.items()}
    return found | {
        "ratio": f"{RATIO:g}", "motor_noise": f"{ANGLE_NOISE / RATIO:.1g}", "effort": f'"{unit["effort"]}"',
        "stiffness_unit": f'"{unit["effort/position"]}"',
    }  # fmt: skip


def given(form: str, before: str, angle: str, force: str) -> list[tuple[str, str, str]]:
    """Columns of a recording: foreign name behind the joint's, kind, unit."""
    reference, own = ("cmd", f"{before}position_ref", angle), [("pos", f"{before}position", angle)]
    if form == "cable":
        motors = [("motor_pos", "motor_position", "rad"), ("motor_effort", "motor_effort", "N m")]
        return [("cmd", "position_ref", angle), *motors, ("pos", "position", angle)]
    return [*([] if form == "inverse" else [reference]), *own, ("effort", f"{before}effort", force)]


def derived_of(before: str, joint: str, unit: dict[str, str], form: str) -> list[str]:
    """Lines of the columns that are made of others."""
    place = f"{before}position_{joint}"
    if form == "cable":
        return [f"  position_start_{joint}: {{of: position_ref_{joint}, take: first}}"]
    if form != "inverse":
        return [f"  {before}position_start_{joint}: {{of: {place}, take: first}}"]
    speed = f"{before}velocity_{joint}"
    tail = [f', unit: "{unit[kind]}"' if before else "" for kind in ("velocity", "acceleration")]
    return [
        f"  {speed}: {{of: {place}, take: rate, filter: {FILTER:g}{tail[0]}}}",
        f"  {before}acceleration_{joint}: {{of: {speed}, take: rate{tail[1]}}}",
    ]


def joined(names: tuple[str, ...], values) -> str:
    """Values by joint, as YAML."""
    return ", ".join(f"{name}: {float(value):.3g}" for name, value in zip(names, values, strict=True))
