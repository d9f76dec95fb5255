"""Suspicious properties of a case that can still be diagnosed."""

from __future__ import annotations

from collections.abc import Callable
from textwrap import shorten

from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.checks import channels, logs, noise, others, robots, scale
from exodrake.diagnosis.checks.compare import Comparison, compare

CHECKS: tuple[Callable[[Comparison], list[str]], ...] = (
    logs.nothing_held_out,
    logs.copied_logs,
    scale.another_unit,
    scale.references_beyond_limits,
    scale.exchanged_columns,
    channels.gaps,
    channels.frozen_channels,
    channels.clipped_channels,
    channels.nothing_moves,
    channels.bursts,
    noise.noise_as_large_as_motion,
    noise.noise_unlike_robot_file,
    robots.changed_between_repeats,
    robots.logs_of_other_robots,
    others.unlike_other_logs,
    others.drifting_clocks,
)
LONGEST = 300  # characters of a sentence


def suspicions(case: Case, robot: Robot) -> tuple[str, ...]:
    """Sentences on what is suspicious about a case, none for a good one, whatever effects its robot has.

    Args:
        case: a case that `check_case` lets pass.
        robot: the nominal robot with the case's overrides.
    """
    return suspicions_of(compare(case, robot))


def suspicions_of(comparison: Comparison) -> tuple[str, ...]:
    """The same of a comparison that is there already."""
    return tuple(shorten(sentence, LONGEST) for check in CHECKS for sentence in check(comparison))
