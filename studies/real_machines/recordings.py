"""The four sets: folders of their recordings, and the models that papers compare on them."""

from __future__ import annotations

from pathlib import Path

FOLDERS = {"emps": "emps", "tendon_sheath": "tendon_sheath", "so101": "sage_so101", "dvrk_wrist": "dvrk_wrist"}
MODELS: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "emps": [
        ("frictionless inertia", ()),
        ("viscous friction", ("carriage.viscous_friction",)),
        ("viscous and Coulomb friction", ("carriage.coulomb_friction",)),
        ("viscous and Coulomb friction, offset", ("carriage.offset",)),
        ("the same, part of the friction builds up after a reversal", ("carriage.presliding_friction",)),
        ("that, viscous friction by direction", ("carriage.direction",)),
    ],
    "tendon_sheath": [
        ("rigid", ()),
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("gain, offset and play", ("sheath.play",)),
    ],
    "sheath_alone": [
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("gain, offset and play with round corners", ("sheath.capstan_play",)),
    ],
    "sheath_law": [
        ("gain and offset", ("sheath.gain", "sheath.offset")),
        ("with capstan play and bend loss", ("sheath.capstan_play", "sheath.bend_loss")),
    ],
    "so101": [
        ("ideal servo", ()),
        ("latency", ("servo.latency",)),
        ("latency, sag", ("servo.gravity_sag",)),
        ("latency, sag, dead band", ("servo.dead_band",)),
        ("latency, sag, dead band, lag", ("servo.lag",)),
    ],
    "dvrk_wrist": [
        ("rigid cables", ()),
        ("gain and offset", ("cable.offset",)),
        ("gain, offset and play", ("cable.play",)),
        ("with drag by neighbours", ("cable.drag_by_next", "cable.drag_by_previous")),
        ("with drag and coupling", ("cable.coupling_to_next", "cable.coupling_to_previous")),
    ],
}  # fmt: skip


def available(data: Path) -> list[str]:
    """Names of the sets whose folders are there."""
    return [name for name, folder in FOLDERS.items() if (data / folder).is_dir()]
