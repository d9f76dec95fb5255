"""`exodrake new-machine`: a folder with a machine of one's own, which runs at once."""

import re
from math import hypot, sqrt
from pathlib import Path
from typing import Any

import click

from exodrake.cli import options
from exodrake.core.errors import InputError, nearest
from exodrake.core.files import is_file, read_bytes

SCAFFOLD, MOTOR_SCAFFOLD = Path(__file__).parent / "scaffold", Path(__file__).parent / "scaffold_motor"
NAME = re.compile(r"[a-z][a-z0-9_]*")
CHANNEL = re.compile(r"[A-Za-z][A-Za-z0-9]*")
FRAME = 0.02  # s, of servos on a bus: assumed
TURN = 1.0  # rad either way that a protocol asks for until the owner says otherwise: assumed, a moderate motion
SLOWEST = 10.0  # s, as the longest frame of a case


@options.command()
@click.argument("folder", type=options.AnyPath())
@options.option("--joints", default="shoulder,elbow", metavar="A,B", help="Names of the joints.")
@click.option("--servo", type=click.Choice(("ideal", "motor")), help="Of --joints: kind of servo. [ideal]")
@click.option("--frame", type=float, help="From one row to the next [s]. [0.02, of an arm 0.005]")
@click.option("--urdf", default="", metavar="FILE", help="An arm: its URDF, or cable_arm, linear_axis, rotary_axis.")
@click.option("--form", help="Of an arm: inverse, closed-loop or cable. [inverse]")
@click.option("--tip", default="", metavar="LINK", help="Of an arm whose joints branch: its last link.")
def command(folder, joints, servo, frame, urdf, form, tip) -> None:
    """Write FOLDER with a machine of position servos: machine.py, robot.yaml, mapping.yaml, a test and a README.

    With --servo ideal a joint takes its commanded position at once. With --servo motor it moves by the equation of
    motion of firmware, supply, DC motor, gear and load.

    With --urdf it is a serial arm without code. Its form is one of three. `inverse` predicts efforts from measured
    motion. `closed-loop` sends references through PD controller, motors and forward dynamics. `cable` has cables
    between motors and joints.

    The folder's name is the machine's. It runs as it is, for instance `exodrake simulate chirp --machine FOLDER`; then
    make it yours. Nothing that exists is overwritten.
    """
    from exodrake import machines
    from exodrake.machines.robot_file import machine_folders

    name, step = folder.resolve().name, FRAME if frame is None else frame
    if not NAME.fullmatch(name):
        raise InputError(f"{folder}: the folder's name is the machine's: small letters, digits and _, like my_arm")
    if name in machine_folders():
        raise InputError(f"{folder}: there is a machine {name} already; name the folder otherwise")
    if not urdf and Path(machines.__path__[0], f"{name}.py").is_file():
        raise InputError(f"{folder}: exodrake.machines has a module {name}; name the folder otherwise")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is there already, and not empty")
    names = tuple(joint.strip() for joint in joints.split(","))
    for joint in names:
        if not CHANNEL.fullmatch(joint) or names.count(joint) > 1:
            raise InputError(f"--joints: {joint!r} is no name of its own: letters and digits, like shoulder or J1")
    if not 0.0 < step <= SLOWEST:
        raise InputError(f"--frame: {step:g} s, wanted above 0 and up to {SLOWEST:g} s")
    if (form or tip) and not urdf:
        raise InputError("--form and --tip are of an arm, which --urdf describes")
    if servo and urdf:
        raise InputError("--servo is of a machine of position servos, --urdf of an arm; name one of them")
    values: dict[str, Any] = {"name": name, "folder": str(folder)}
    if urdf:
        texts = arm_files(values, urdf, form or "inverse", tip, frame)
    else:
        ends = {key: by_joint(names, [turn] * len(names)) for key, turn in (("lowest", -TURN), ("highest", TURN))}
        values |= {"joints": names, "frame": f"{step:g}", "servo": servo or "ideal", **ends}
        texts = fill_templates(values, *[MOTOR_SCAFFOLD] * (servo == "motor"), SCAFFOLD)
    files = options.write_together(folder, texts)
    click.echo(f"{folder}: {', '.join(file.name for file in files)}")
    if values.get("on_axis"):
        click.echo("its last link is the last joint: a payload sits on that axis until arm.tip_x, _y, _z place it")
    click.echo(f"try it: exodrake simulate chirp --machine {folder}")
    click.echo(f"your own logs: exodrake import RECORDING lists their columns, for {folder}/mapping.yaml")
    loop = ("analyse",) if form == "cable" else ("analyse", "tune") if not urdf or form == "closed-loop" else ()
    steps = ("import", "check", *["response"] * bool(loop), "fit", "diagnose", *loop, "export")
    click.echo(f"then {', '.join(steps)}: as {folder}/README.md has them")


def fill_templates(values: dict[str, Any], *folders: Path) -> dict[str, bytes]:
    """Texts of the files by name, whose templates lie in some folders; the first that has a name wins."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    marks = {"variable_start_string": "${", "variable_end_string": "}", "block_start_string": "<%"}
    layout = {"block_end_string": "%>", "trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    templates = Environment(loader=FileSystemLoader(folders), undefined=StrictUndefined, **marks, **layout)
    files = sorted({file.name for folder in folders for file in folder.glob("*.txt")})
    return {name.removesuffix(".txt"): templates.get_template(name).render(values).encode() for name in files}


def by_joint(names: tuple[str, ...], values: Any) -> str:
    """Values by joint, as YAML."""
    return ", ".join(f"{name}: {float(value):.3g}" for name, value in zip(names, values, strict=True))


ARM_SCAFFOLD = Path(__file__).parent / "scaffold_arm"
WIDEST = 1.0  # rad, or half a range, either way of the middle that a protocol asks for: assumed, a moderate motion
NOISE = 0.01  # of a moderate motion's effort: assumed
SMALLEST = 0.002  # of the largest effort of all joints, for joints that hardly need any: assumed
CENTRE, FINEST, COARSEST = 0.005, 1e-4, 2e-3  # tolerance of centres, of the arm's length; from, to [m]: assumed
ANGLE_NOISE = 2e-5  # rad at the joint, of encoders at rest: assumed
WHAT = {
    "inverse": "its efforts predicted from measured motion (inverse dynamics)",
    "closed-loop": "moved by motors under a PD controller (forward dynamics)",
    "cable": "moved by motors through cables under a PD controller (forward dynamics)",
}


def arm_files(values: dict[str, Any], urdf: str, form: str, tip: str, frame: float | None) -> dict[str, bytes]:
    """Contents of an arm's folder by file name. InputError for an unknown form, and for a URDF of no serial arm."""
    from exodrake.machines.serial_arm import FRAME, RATIO, cable_defaults, middle, read_urdf, typical_efforts, units

    if form not in WHAT:
        raise InputError(f"--form: unknown form {form!r}{nearest(form, list(WHAT))}; there are {', '.join(WHAT)}")
    built_in = {file.stem: file for file in ARM_SCAFFOLD.glob("*.urdf")}
    path = Path(urdf) if is_file(urdf) else built_in.get(urdf)
    if path is None:
        raise InputError(f"--urdf: no file {urdf!r}; of its own exodrake has {', '.join(sorted(built_in))}")
    chain, cable = read_urdf(path, tip), form == "cable"
    unit, efforts, names, places = units(chain), typical_efforts(chain), chain.names, middle(chain)
    noise = NOISE * efforts.clip(SMALLEST / NOISE * efforts.max()) * (RATIO if cable else 1.0)
    last, spans = chain.bodies[-1], sum(hypot(*joint.origin) for joint in chain.joints[1:])
    gyration = sqrt(last.inertia.trace() / (2.0 * last.mass)) if last.mass else 0.0
    length = spans + max(hypot(*chain.tip), hypot(*last.centre) + gyration)
    centre = round(min(max(CENTRE * length, FINEST), COARSEST), 4)
    reach = [min(WIDEST, 0.45 * (j.upper - j.lower)) for j in chain.joints]
    values |= {
        "urdf": "arm.urdf", "form": form, "what": WHAT[form], "frame": f"{frame or FRAME:g}", "tip": tip,
        "joints": names, "friction": any(j.damping or j.friction for j in chain.joints),
        "units": unit | {"measured_effort": "N m" if cable else unit["effort"]},
        "prefix": "joint_" if unit["position"] == "-" and not cable else "", "part": "cable" if cable else "arm",
        "rotors": by_joint(names, [0.0] * len(names)), "noise": by_joint(names, noise),
        "on_axis": chain.joints[-1].kind != "prismatic" and not chain.tip.any(),
        "repeatability": f"{float(noise.min()) / 10:.2g}",
        "centre": f"{centre:g}", "farthest": f"{3.0 * centre:g}",
        "lowest": by_joint(names, places - reach), "highest": by_joint(names, places + reach),
        # 0.01 rad/s at the level of the largest effort: assumed
        "mobility": f"{float(f'{0.01 / efforts.max():.1g}'):g}",
    }  # fmt: skip
    if cable:
        defaults = cable_defaults(chain, efforts, 0.0)
        rows = {"stiffness": "stiffness", "pretension": "pretension", "motors": "inertia"}
        values |= {key: by_joint(names, [defaults[f"cable.{n}.{j}"] for j in names]) for key, n in rows.items()}
        values |= {"ratio": f"{RATIO:g}", "motor_noise": f"{ANGLE_NOISE / RATIO:.1g}"}
    return {"arm.urdf": read_bytes(path), **fill_templates(values, ARM_SCAFFOLD)}
