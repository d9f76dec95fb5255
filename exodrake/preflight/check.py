"""Everything that can be said of a case before its diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import short_repr
from exodrake.core.robot import Robot
from exodrake.data.case import Case, read_case
from exodrake.data.plot import STYLE, new_figure, png_of
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks import check_case, suspicions_of
from exodrake.diagnosis.checks.compare import compare
from exodrake.diagnosis.problem import columns_of, required_of
from exodrake.preflight.directions import SEEN, Direction
from exodrake.preflight.identifiability import Identifiability, identifiability
from exodrake.preflight.signals import Channel, Clock, Excitation, channels, clocks, excitations


@short_repr
@dataclass(frozen=True, eq=False)
class Preflight:
    """Checks of a case before its diagnosis: clocks, channels, excitation and identifiability.

    Attributes:
        case: as read.
        clocks: of its logs as recorded.
        channels: of the compared columns.
        excitations: of the references.
        identifiability: which effects it could show and distinguish.
        problems: sentences; none for a good case.
    """

    case: Case
    clocks: tuple[Clock, ...]
    channels: tuple[Channel, ...]
    excitations: tuple[Excitation, ...]
    identifiability: Identifiability
    problems: tuple[str, ...]


def preflight(
    path: str | Path,
    robot: Robot,
    tried: frozenset[str] | None = None,
    allow_outside: bool = False,
    progress: Callable[[str], object] = lambda text: None,
) -> Preflight:
    """Checks a case before its diagnosis.

    Args:
        path: case folder or log.
        robot: nominal robot.
        tried: ids of the effects that a diagnosis would try; its own choice by default.
        allow_outside: whether logs may lie outside the folder.
        progress: called with what is done.

    Raises:
        InputError: where a diagnosis has one.
    """
    case = read_case(path, required_of(robot.machine), robot.machine.frame, allow_outside)
    robot = robot.with_parameters(case.robot, source=case.name) if case.robot else robot
    check_case(case, robot.machine)
    columns_of(case, robot.machine)
    progress("comparing the logs with the nominal robot")
    comparison = compare(case, robot)
    parts = clocks(Path(path), robot.machine.frame), channels(comparison), excitations(case, robot)
    sentences = [sentence for part in parts for item in part for sentence in item.problems()]
    problems = (*case.notes, *sentences, *suspicions_of(comparison), *calibration_notes(robot.machine))
    return Preflight(case, *parts, identifiability(case, robot, tried, progress), tuple(dict.fromkeys(problems)))


LISTED = 2  # rivals that are named
CEILING = 1000.0  # standard deviations; what stands out further is as clear as can be
COLOURS = ("#009e73", "#e69f00", "#b0b7bf")  # distinguished, could be mistaken, not seen


def figure_of(found: Preflight) -> bytes:
    """The figure as PNG."""
    import matplotlib

    effects = list(dict.fromkeys(d.effect for d in found.identifiability.directions))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.0, 1.9 + 0.2 * max(len(effects), 8))
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 0.9), sharey=True)
        bars(left, found.identifiability, effects)
        rivals(right, found.identifiability, effects)
        figure.suptitle(f"{found.case.name}: what it could tell", fontsize=11, fontweight="bold", x=0.01, ha="left")
        return png_of(figure)


def state(direction: Direction) -> int:
    """0 distinguished, 1 could be mistaken, 2 not seen: index of its colour."""
    return 2 if direction.seen < SEEN else 1 if direction.taken_for else 0


def bars(axes: Any, found: Identifiability, effects: list[str]) -> None:
    """Draw the change of the logs by effects of typical size, a mark for each channel."""
    words = ("distinguished", "could be mistaken", "not seen")
    for kind, (colour, word) in enumerate(zip(COLOURS, words, strict=True)):
        own = [d for d in found.directions if state(d) == kind]
        seen = [min(max(d.seen, 0.1), CEILING) for d in own]
        axes.plot(seen, [effects.index(d.effect) for d in own], "o", color=colour, ms=5, label=word, alpha=0.85)
    axes.axvline(SEEN, color="#555", lw=0.9, ls=(0, (4, 2)))
    axes.set_xscale("log")
    axes.set_xlim(0.08, 1.4 * CEILING)
    axes.set_yticks(range(len(effects)), effects, fontsize=7.5)
    axes.set_ylim(len(effects) - 0.5, -0.5)
    axes.set_xlabel("change of the logs by an effect of typical size\n[noise standard deviations]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, handletextpad=0.2, columnspacing=1.0)


def rivals(axes: Any, found: Identifiability, effects: list[str]) -> None:
    """Write the effects that could be taken for each effect, and the share of its change that they would leave."""
    axes.set_axis_off()
    axes.set_title("could be taken for (share of the change left)", fontsize=9, loc="left")
    for row, effect in enumerate(effects):
        left: dict[str, float] = {}
        for direction in (d for d in found.directions if d.effect == effect):
            for other, share in direction.taken_for.items():
                left[other] = min(share, left.get(other, 1.0))
        words = [f"{other} ({share:.0%})" for other, share in sorted(left.items(), key=lambda item: item[1])]
        more = f" and {len(words) - LISTED} more" if len(words) > LISTED else ""
        axes.text(0.0, row, ", ".join(words[:LISTED]) + more, va="center", fontsize=7.5, color="#8a5a00")
