"""The page of `studies.experiment`: how many ambiguous cases a further log resolves, and why not the others."""

from __future__ import annotations

from typing import Any

MOTIONS = DESIGNED, RANDOM = "designed", "random"


TEXT = """Cases of the reference simulator whose stored answer is ambiguous, diagnosed with the effects of its causes
and their rivals. Those that still are ambiguous get one further log of a minute, of the motion that
`exodrake experiment` designs or of a random one as long, and are diagnosed again with it. Resolved: one explanation is
left, and it is the true one. T is what the rival that is distinguished worst would leave of the new log once it is
refitted, in variances of noise. The same log: T of a random motion is
below 1, less than noise, and no experiment is run.

    {command}"""
FOUND = """What the cases show, with the diagnosis of commit `3f796af`, the version before this one:

- All that a further motion can tell apart the designed one of a minute does: friction that grows with speed against one
  that grows with load, stiffness against a gain of the load cell, a gain against a nonlinearity, crosstalk, or a spool
  that grows, relaxation of a finger against its hysteresis. The random motion leaves the spool in one class, and dry
  friction that falls with speed beside Coulomb friction in another.
- Dry friction that falls with speed stays beside Coulomb friction in two of three cases. The latter counts as true as
  long as it leaves no more than an error of its law of 40 % would (`levels.py`); the injected forces fall by ratios of
  1.5 to 1.7, within 26 % of a constant one.
- A tendon that stiffens against one that yields: the simulator's garment does both a little, and both stay. A slack
  tendon against an offset of an encoder: the two write the same log.
- Promises are rough: of the cases that the designed motion resolved 0 to 100 % were promised.

An earlier sample of 14 cases (commit `361ada6`, motions by the search of commit `3db9614`): the designed motion
resolved 7 of 10 (7 of the 9 that can be), a random one 6 of 14 (6 of 9); of the 10 with both motions 5 by either, 2 by
the designed one alone, 1 by the random one alone. There designed motions were run mostly where a random one had
resolved a case or could have. Half a minute tells less: the true law took up 0.59 of what the wrong one leaves of a
case that a minute resolves. The search for a motion of a minute takes about 50 s of one core for two explanations."""


def resolved(row: dict[str, Any], motion: str) -> bool:
    """Whether one explanation is left after a motion, and it is the true one."""
    after = row["after"][motion]
    return after["verdict"] == "NAMED" and sorted(after["causes"]) == sorted(row["truth"])


def page(rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page, from what was measured by case."""
    used = {name: row for name, row in rows.items() if row.get("after")}
    lines = ["# The next experiment, measured", "", TEXT.format(command=command), "", *shares_of(used), ""]
    lines += [paired(list(used.values())), "", *kinds(used), "", *cases(used)]
    if decided := {name: row for name, row in rows.items() if len(row["before"]["class"]) < 2}:
        lines += ["", "No longer ambiguous, without a further log:", ""]
        lines += [f"- {name}, {truth_of(row)}: {said(row['before'])}" for name, row in decided.items()]
    return "\n".join([*lines, "", FOUND]).rstrip() + "\n"


def shares_of(used: dict[str, dict[str, Any]]) -> list[str]:
    """The table of motions."""
    lines = ["| motion | resolved | one left, but not the true one |", "|---|---|---|"]
    for motion in MOTIONS:
        run = [row for row in used.values() if motion in row["after"]]
        wrong = sum(row["after"][motion]["verdict"] == "NAMED" for row in run) - right_of(run, motion)
        lines.append(f"| {motion} | {share(run, motion)} | {wrong} |")
    return lines


def paired(rows: list[dict[str, Any]]) -> str:
    """Cases that either motion alone resolves, of those that have both, with McNemar's exact test."""
    from scipy.stats import binomtest

    both = [tuple(resolved(row, motion) for motion in MOTIONS) for row in rows if set(MOTIONS) <= set(row["after"])]
    if not both:
        return "No case has both motions yet."
    designed, random = both.count((True, False)), both.count((False, True))
    p = binomtest(designed, designed + random).pvalue if designed + random else 1.0
    return (
        f"Of {len(both)} cases with both motions {both.count((True, True))} are resolved by either one, {designed} by "
        f"the designed one alone, {random} by the random one alone (McNemar's exact test: p = {p:.2g})."
    )


def kinds(used: dict[str, dict[str, Any]]) -> list[str]:
    """The table of kinds of class."""
    lines = ["| effects that are to be told apart | cases | by the designed | by the random motion |"]
    lines += ["|---|---|---|---|"]
    for kind in sorted({kind_of(row) for row in used.values()}):
        some = [row for row in used.values() if kind_of(row) == kind]
        run = [[row for row in some if motion in row["after"]] for motion in MOTIONS]
        counts = [f"{right_of(part, motion)} of {len(part)}" for part, motion in zip(run, MOTIONS, strict=True)]
        lines.append(f"| {kind} | {len(some)} | {' | '.join(counts)} |")
    return lines


def cases(used: dict[str, dict[str, Any]]) -> list[str]:
    """The table of cases."""
    lines = ["| case | true | class before | T designed, random | after the designed | after a random one |"]
    lines += ["|---|---|---|---|---|---|"]
    for name, row in used.items():
        left = ", ".join(f"{row['promised'][m]['left']:.0f}" if m in row["promised"] else "-" for m in MOTIONS)
        after = [outcome(row, motion) for motion in MOTIONS]
        start = f"{truth_of(row)} | {', '.join(row['before']['class'])}"
        lines.append(f"| {name} | {start} | {left} | {' | '.join(after)} |")
    return lines


def outcome(row: dict[str, Any], motion: str) -> str:
    """Result of a case after a motion, in words."""
    after = row["after"].get(motion)
    return "not measured" if after is None else "the same log" if after.get("same") else said(after)


def truth_of(row: dict[str, Any]) -> str:
    """The true effects of a case, in words."""
    return ", ".join(row["truth"]) or "healthy"


def kind_of(row: dict[str, Any]) -> str:
    """The causes and rivals that are to be told apart."""
    return ", ".join(sorted(row["before"]["class"]))


def right_of(rows: list[dict[str, Any]], motion: str) -> int:
    """Number of cases that a motion resolved."""
    return sum(resolved(row, motion) for row in rows)


def share(rows: list[dict[str, Any]], motion: str) -> str:
    """Share of cases that a motion resolved, with the 95 % interval."""
    from scipy.stats import binomtest

    if not rows:
        return "0 of 0"
    right = right_of(rows, motion)
    low, high = binomtest(right, len(rows)).proportion_ci(method="wilson")
    return f"{right} of {len(rows)} ({low:.0%} to {high:.0%})"


def said(after: dict[str, Any]) -> str:
    """A verdict with what is left."""
    return f"{after['verdict']} {', '.join(after['class'])}".strip()
