"""Assignment of markers to segments (paper Fig. 8-9: hand 3, phalanges 9, thumb 2)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.schema import listing, mapping, optional, text
from exodrake.core.yaml_file import read_yaml

SEGMENTS = ("base", "proximal", "middle", "distal")
JOINTS = ("MCP", "PIP", "DIP")


def marker(value: Any, where: str) -> str:
    """A marker's name; systems that number their markers give numbers."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else text()(value, where)


TRIAD = listing(marker, length=3, wanted="three marker names")
THUMB = optional(listing(marker, wanted="a list of marker names"))
SCHEMA = mapping({**dict.fromkeys(SEGMENTS, TRIAD), "thumb": THUMB, "tip": marker})


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
    content: dict[str, Any] = SCHEMA(read_yaml(path), str(path))
    names: dict[str, Any] = {key: v if key == "tip" else tuple(v or ()) for key, v in content.items()}
    layout = Layout(**names)
    twice = {name for name in layout.finger if layout.finger.count(name) > 1}
    if twice:
        raise InputError(f"{path}: marker {', '.join(sorted(twice))} is named twice")
    if layout.tip not in layout.distal:
        raise InputError(f"{path}: tip {layout.tip} is not one of the distal markers {', '.join(layout.distal)}")
    return layout
