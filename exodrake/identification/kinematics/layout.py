"""Assignment of markers to segments (paper Fig. 8-9: hand 3, phalanges 9, thumb 2)."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_yaml

SEGMENTS = ("base", "proximal", "middle", "distal")
JOINTS = ("MCP", "PIP", "DIP")


@dataclass(frozen=True)
class Layout:
    """Marker names per segment, from the hand to the fingertip; `tip` is the distal marker at the fingertip."""

    base: tuple[str, str, str] = ("B1", "B2", "B3")
    proximal: tuple[str, str, str] = ("P1", "P2", "P3")
    middle: tuple[str, str, str] = ("M1", "M2", "M3")
    distal: tuple[str, str, str] = ("D1", "D2", "D3")
    thumb: tuple[str, ...] = ("T1", "T2")
    tip: str = "D2"

    @property
    def segments(self) -> tuple[tuple[str, str, str], ...]:
        """The four triads, in the order of SEGMENTS."""
        return self.base, self.proximal, self.middle, self.distal

    @property
    def finger(self) -> tuple[str, ...]:
        """The twelve markers of the identification, without those of the thumb."""
        return tuple(name for triad in self.segments for name in triad)


def read_layout(path: str | Path) -> Layout:
    """Read a layout from YAML such as `proximal: [RP1, RP2, RP3]`; absent keys keep their defaults.

    Raises:
        InputError: Naming file and key, for an unknown key, not three names in a triad, or a marker named twice.
    """
    content = read_yaml(path)
    known = {field.name for field in fields(Layout)}
    if not isinstance(content, dict) or set(content) - known:
        odd = ", ".join(sorted(map(str, set(content) - known))) if isinstance(content, dict) else "no keys"
        raise InputError(f"{path}: {odd}; the keys are {', '.join(sorted(known))}")
    for key in SEGMENTS:
        if key in content and not (isinstance(content[key], list) and len(content[key]) == 3):
            raise InputError(f"{path}: {key} wants three marker names")
    for key, value in content.items():
        if key != "tip" and not isinstance(value, list | None):
            raise InputError(f"{path}: {key} wants a list of marker names")
    names: dict[str, Any] = {k: str(v) if k == "tip" else tuple(map(str, v or ())) for k, v in content.items()}
    layout = Layout(**names)
    twice = {name for name in layout.finger if layout.finger.count(name) > 1}
    if twice:
        raise InputError(f"{path}: marker {', '.join(sorted(twice))} is named twice")
    if layout.tip not in layout.distal:
        raise InputError(f"{path}: tip {layout.tip} is not one of the distal markers {', '.join(layout.distal)}")
    return layout
