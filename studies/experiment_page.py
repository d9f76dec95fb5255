"""The page of `studies.experiment`: how many ambiguous cases a further log resolves, and why not the others."""

from __future__ import annotations

from typing import Any

import numpy as np

DESIGNED, RANDOM = "designed", "random"


TEXT = """Cases of the reference simulator whose stored answer is ambiguous, diagnosed with the effects of its class
(the logs reject all others before). Those that still are ambiguous get one further log, of the motion that `exodrake
experiment` designs or of a random one as long, and are diagnosed again with it in full length. Resolved: one
explanation is left, and it is the true one. T is what the rival that is distinguished worst would leave of the new log
once it is refitted, in variances of noise; promised is the probability that follows from it. Where T is below that of
chance for every motion the two laws write the same log, and no experiment is run: a slack tendon that never loses its
tension is an offset of an encoder. A case can be resolved in principle if after one of the motions the true law takes
up more of what each rival leaves than an absent effect takes up of what a true law leaves (`taken` of the
calibration). Else the simulator's robot follows neither law more closely than the other: its garment yields and
stiffens a little, so that the library's stiffening wire fits it better than the library's yielding garment.

    {command}"""
FOUND = """What kept designed motions from resolving cases, and what was done:

- The fit of a richer law stuck. With the designed log of u5/case_04 dry friction that falls with speed left a reduced
  chi-square of 7.1, and Coulomb friction, which it contains, 1.5. It now goes on from the simpler law, and leaves 1.2.
- T came from snaps. Where the finger snaps over, the least difference of two robots moves the snap in time, which a
  linear refit cannot follow. Of a motion for u5/case_04 (T = 9,349) half of the difference lay in 15 of 1,500 frames;
  one for u3/case_28 promised T = 506,615 of a clock's skew against a delay, and left both. T now must exceed what
  plausible changes of the parameters miss the linearisation by. Two drawn changes do not find every snap: the motion of
  u5/case_04 in the table promises T = 39,227 and ends with the wrong law. A T of thousands is not to be trusted.
- What the true law leaves counted as if it did not grow with the motion. It now is in proportion to what the effects
  contribute, so that a strong motion alone gains nothing.
- Pieces of 6 s held no slow reversals, and the search kept few directions of the refit. There are pieces of 7 and 15 s
  and triangles now, and the directions of each motion that was found are kept.
- A better law was not held against one that used its tolerances less, or had fewer parameters: `levels.py`."""


def is_true(row: dict[str, Any], name: str) -> bool:
    """Whether an explanation is the true one."""
    return sorted(name.split(" + ")) == sorted(row["truth"])


def resolved(row: dict[str, Any], motion: str) -> bool:
    """Whether one explanation is left after a motion, and it is the true one."""
    after = row["after"][motion]
    return after["verdict"] == "NAMED" and is_true(row, after["class"][0])


def in_principle(row: dict[str, Any]) -> bool:
    """Whether after one of the motions the true law takes up most of what each other law of the class leaves."""
    from exodrake.diagnosis.calibration import calibration_of
    from exodrake.machines.robot_file import load_robot

    limit, class_ = calibration_of(load_robot().machine).taken, row["before"]["class"]
    taken = [
        [after["taken"].get(name, 0.0) for name in class_ if not is_true(row, name)] for after in row["after"].values()
    ]
    return any(is_true(row, name) for name in class_) and any(shares and min(shares) > limit for shares in taken)


def page(rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page, from what was measured by case."""
    used = {name: row for name, row in rows.items() if "after" in row}
    possible = [row for row in used.values() if in_principle(row)]
    lines = ["# The next experiment, measured", "", TEXT.format(command=command), ""]
    lines += ["| motion | resolved, of all | of those that can be | one left, but not the true one | promised |"]
    lines += ["|---|---|---|---|---|"]
    for motion in (DESIGNED, RANDOM):
        named = sum(row["after"][motion]["verdict"] == "NAMED" for row in used.values())
        right = sum(resolved(row, motion) for row in used.values())
        mean = f"{np.mean([row['promised'][motion][0] for row in used.values()]):.0%}" if used else "-"
        shares = " | ".join(share(list(some), motion) for some in (used.values(), possible))
        lines.append(f"| {motion} | {shares} | {named - right} | {mean} |")
    lines += [
        "",
        "| case | true | class before | T designed, random | after the designed | after a random one | can be |",
    ]
    lines += ["|---|---|---|---|---|---|---|"]
    for name, row in used.items():
        left = ", ".join(f"{row['promised'][motion][1]:.0f}" for motion in (DESIGNED, RANDOM))
        after = "the same log | the same log" if row.get("same") else " | ".join(map(said, row["after"].values()))
        start = f"{', '.join(row['truth']) or 'none'} | {', '.join(row['before']['class'])}"
        lines.append(f"| {name} | {start} | {left} | {after} | {'yes' if in_principle(row) else 'no'} |")
    if decided := {name: row for name, row in rows.items() if name not in used}:
        lines += ["", "No longer ambiguous, without a further log:", ""]
        lines += [
            f"- {name}, {', '.join(row['truth']) or 'healthy'}: {said(row['before'])}" for name, row in decided.items()
        ]
    return "\n".join([*lines, "", FOUND]) + "\n"


def share(rows: list[dict[str, Any]], motion: str) -> str:
    """How many of some cases a motion resolved, with the 95 % interval."""
    from scipy.stats import binomtest

    if not rows:
        return "0 of 0"
    right = sum(resolved(row, motion) for row in rows)
    low, high = binomtest(right, len(rows)).proportion_ci(method="wilson")
    return f"{right} of {len(rows)} ({low:.0%} to {high:.0%})"


def said(after: dict[str, Any]) -> str:
    """A verdict with what is left."""
    return f"{after['verdict']} {', '.join(after['class'])}".strip()
