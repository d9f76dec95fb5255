"""The files of a machine that is a serial arm: a URDF file and a robot file, without code."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from exodrake.machines.urdf import Chain

SCAFFOLD = Path(__file__).parent / "scaffold_arm"
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
    built_in = {file.stem: file for file in SCAFFOLD.glob("*.urdf")}
    path = Path(urdf) if is_file(urdf) else built_in.get(urdf)
    if path is None:
        raise InputError(f"--urdf: no file {urdf!r}; of its own exodrake has {', '.join(sorted(built_in))}")
    values = texts_of(read_urdf(path, tip), form)
    values |= {
        "name": folder.resolve().name, "folder": str(folder), "urdf": "arm.urdf", "form": form,
        "what": WHAT[form], "frame": f"{frame or FRAME:g}", "tip": f", tip: {tip}" if tip else "",
    }  # fmt: skip
    values["own"] = Template((SCAFFOLD / "own" / f"{form}.txt").read_text()).substitute(values)
    found = {file.name.removesuffix(".txt"): file.read_text() for file in sorted(SCAFFOLD.glob("*.txt"))}
    texts = {name: Template(text).substitute(values).encode() for name, text in found.items()}
    return {"arm.urdf": read_bytes(path), **texts}


def texts_of(chain: Chain, form: str) -> dict[str, str]:
    """Texts of the joints for the generated files."""
    from exodrake.machines.arm_defaults import middle, typical_efforts, units
    from exodrake.machines.cable_arm import RATIO

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
    from exodrake.machines.arm_defaults import typical_efforts
    from exodrake.machines.cable_arm import RATIO, defaults_of

    values = defaults_of(chain, typical_efforts(chain), 0.0)
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
