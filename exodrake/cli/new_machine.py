"""`exodrake new-machine`: a folder with a machine of one's own, which runs at once."""

from __future__ import annotations

import re
from pathlib import Path

import click

from exodrake.cli.options import AnyPath

SCAFFOLD = Path(__file__).parent / "scaffold"
NAME = re.compile(r"[a-z][a-z0-9_]*")
CHANNEL = re.compile(r"[A-Za-z][A-Za-z0-9]*")
FRAME = 0.02  # s, of servos on a bus: assumed
TURN = 1.0  # rad either way that a protocol asks for until the owner says otherwise: assumed, a moderate motion
SLOWEST = 10.0  # s, as the longest frame of a case


@click.command()
@click.argument("folder", type=AnyPath())
@click.option("--joints", default="shoulder,elbow", show_default=True, metavar="A,B", help="Names of the joints.")
@click.option("--frame", default=None, type=float, help="From one row to the next [s]. [0.02, of an arm 0.005]")
@click.option("--urdf", default="", metavar="FILE", help="An arm: its URDF, or cable_arm, linear_axis, rotary_axis.")
@click.option("--form", default=None, help="Of an arm: inverse, closed-loop or cable. [inverse]")
@click.option("--tip", default="", metavar="LINK", help="Of an arm whose joints branch: its last link.")
def command(folder: Path, joints: str, frame: float | None, urdf: str, form: str | None, tip: str) -> None:
    """Write FOLDER with a machine of position servos: machine.py, robot.yaml, mapping.yaml, a test and a README.

    With --urdf it is a serial arm without code. Its form is `inverse`, efforts predicted from measured motion,
    `closed-loop`, references through PD controller, motors and forward dynamics, or `cable`, with cables between motors
    and joints.

    The folder's name is the machine's. It runs as it is, for instance `exodrake simulate chirp --machine FOLDER`; then
    make it yours. Nothing that exists is overwritten.
    """
    from exodrake.cli.new_arm import arm_files
    from exodrake.core.errors import InputError
    from exodrake.core.files import write_folder

    names = checked(folder, joints, FRAME if frame is None else frame, code=not urdf)
    if (form or tip) and not urdf:
        raise InputError("--form and --tip are of an arm, which --urdf describes")
    if urdf:
        texts = arm_files(folder, urdf, form or "inverse", tip, frame)
    else:
        texts = {name: text.encode() for name, text in contents(folder, names, frame or FRAME).items()}
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


def contents(folder: Path, joints: tuple[str, ...], frame: float) -> dict[str, str]:
    """Texts of the folder's files by name."""
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
    found = {file.name.removesuffix(".txt"): file.read_text() for file in sorted(SCAFFOLD.glob("*.txt"))}
    return {name: Template(text).substitute(values) for name, text in found.items()}
