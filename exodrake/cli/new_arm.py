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
FILTER = 10.0  # Hz, of a derivative: assumed
WHAT = {
    "inverse": "its efforts predicted from measured motion (inverse dynamics)",
    "closed-loop": "moved by motors under a PD controller (forward dynamics)",
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
    """What the files say of the joints."""
    from exodrake.machines.arm_defaults import middle, typical_efforts, units

    unit, efforts, names = units(chain), typical_efforts(chain), chain.names
    noise = NOISE * efforts.clip(SMALLEST / NOISE * efforts.max())
    reach = [min(WIDEST, 0.45 * (j.upper - j.lower)) for j in chain.joints]
    places = middle(chain)
    before = "joint_" if unit["position"] == "-" else ""
    inverse = form == "inverse"
    given = ("position", "effort") if inverse else ("position_ref", "position", "effort")
    foreign = {"position_ref": "cmd", "position": "pos", "effort": "effort"}
    shown = {"position": unit["position"], "effort": unit["effort"]}
    columns = [
        f'  {joint}_{foreign[kind]}: {{name: {before}{kind}_{joint}, unit: "{shown[kind.split("_")[0]]}"}}'
        for joint in names for kind in given
    ]  # fmt: skip
    derived = [line for joint in names for line in derived_of(before, joint, unit, inverse)]
    mobility = float(f"{0.01 / efforts.max():.1g}")  # 0.01 rad/s at the level of the largest effort: assumed
    return {
        "rotors": joined(names, [0.0] * len(names)), "noise": joined(names, noise),
        "repeatability": f"{float(noise.min()) / 10:.2g}",
        "force": f'"{unit["effort"]}"', "angle": f'"{unit["position"]}"',
        "inertia": f'"{unit["inertia"]}"',
        "lowest": joined(names, places - reach), "highest": joined(names, places + reach),
        "limited": "assumed: a moderate motion about the middle of the URDF's limits",
        "mobility": f"{mobility:g}", "columns": "\n".join(columns),
        "derived": "\n".join(derived),
        "derived_note": "rates of the motion, through a filter whose cut-off you choose" if inverse
        else "where each joint stands at first",
    }  # fmt: skip


def derived_of(before: str, joint: str, unit: dict[str, str], inverse: bool) -> list[str]:
    """Lines of the columns that are made of others."""
    place = f"{before}position_{joint}"
    if not inverse:
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
