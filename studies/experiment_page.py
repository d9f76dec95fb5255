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

- The search found where the linear refit is wrong. A motion for u5/case_04 promised T = 315,515; on it the robot left
  a reduced chi-square of 452 under either law, since the finger snaps over. Of another one, smooth but for some
  frames, T = 898 would be a difference of 2.2 between the two reduced chi-squares of the new log: 0.29 was measured,
  and the true law left 0.47, a fifth of it in 2 % of the frames. Of a random motion T = 171 promises 0.42: 0.43 was
  measured. So frames where robots drawn from what the present logs leave uncertain miss the linearisation count
  little; refits are carried to their end on the motions that tell most; and eight random motions are held against
  what the search finds. For u5/case_04 the best of these is kept then, with T = 214: it promises 0.53, and 0.50 was
  measured.
- A motion for u6/case_34 promised T = 35 of a finger that snaps over (B = 5,139): the true law was rejected like the
  wrong one. T must exceed what those robots miss the linearisation by in all, whichever other limit holds; the motion
  that is found then promises T = 25 with B = 3.
- The first choice of pieces preferred snaps, which differ most. It counts frames by the logarithm of their
  difference.
- Robots drawn with effects as much stronger or weaker as their law is wrong were tried, too: beside a contact
  (u6/case_31) every motion that moves the finger is nonlinear to such changes, although refits follow most of them,
  and the design became worse than a random motion. They are not used.

The cases are too few for a share of 80 %, and no gain of designed motions over random ones is shown: of the seven cases
with both, random ones resolve five. Designed motions promise more (u6/case_34: 89 % against 51 %), and the random
motions resolve these cases, too. Designs of u5/case_04, u3/case_28, u4/case_04 and u6/case_49 were made before B was a
limit, which none of them comes near, that of u2/case_16 before refits were carried to their end. The other
cases have a random motion alone.

What keeps a motion from resolving more:

- Dry friction that falls with speed against Coulomb friction. The latter counts as true as long as it leaves no more
  than an error of its law of 40 % would, and then a law of more parameters does not beat it, however much it takes up
  (`levels.py`). With random logs the true law takes up 66 % and 70 % of what Coulomb friction leaves of u6/case_01
  and u2/case_30, and both stay. Forces that fall by a ratio of 1.6 to 1.7 lie within 26 % of a constant one, so that
  no motion rejects it. Where Coulomb friction was true the other law took up 1 % at most, in seven cases of these
  sets; random errors of the law let it take up 15 % (the 98 % quantile of 99 draws for u6/case_01). A test against
  that quantile would decide these cases from their logs alone, without an experiment; it would also name a stiffening
  wire where the simulator's compliant garment stiffens. Other laws of Coulomb friction tell more than random errors
  of it: of 58 robots of the model's own library with Coulomb friction, Dahl's law or a Prandtl-Ishlinskii law of it,
  the falling friction took up 93 % at most of what Coulomb friction leaves (98 % quantile; measured by commit
  `205abcb`, whose rule decided no case and was taken out again): friction that builds up over a longer way after each
  reversal looks like one that falls with speed. Seven robots with falling friction show 14 to 73 %. So no such limit
  decides, and both laws stay.
- u5/case_04 is resolved by the random motion since Coulomb friction then uses its tolerances a little more than they
  allow, 1.50 against 1.50; with the designed motion 1.49, and it stays.
- A gain of a sensor within the tolerances of other gains (u2/case_16; after a random motion of u3/case_47, too, all
  laws leave a reduced chi-square of 1.01): the laws write the same log.
- A slack tendon against an offset of an encoder (u1/case_49, u4/case_26, u5/case_40, u5/case_48): the same, not run.
- u1/case_14 and u3/case_01: the class holds larger or smaller sets of effects than the true one; u5/case_27: the
  garment that stiffens. Not run."""


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
    return (
        not row.get("same")
        and any(is_true(row, name) for name in class_)
        and any(shares and min(shares) > limit for shares in taken)
    )


def page(rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page, from what was measured by case."""
    used = {name: row for name, row in rows.items() if "after" in row}
    possible = [row for row in used.values() if in_principle(row)]
    lines = ["# The next experiment, measured", "", TEXT.format(command=command), ""]
    lines += ["| motion | resolved, of all | of those that can be | one left, but not the true one | promised |"]
    lines += ["|---|---|---|---|---|"]
    for motion in (DESIGNED, RANDOM):
        run = [row for row in used.values() if motion in row["after"]]
        named = sum(row["after"][motion]["verdict"] == "NAMED" for row in run)
        right = sum(resolved(row, motion) for row in run)
        told = [row["promised"][motion][0] for row in run if motion in row["promised"]]
        mean = f"{np.mean(told):.0%}" if told else "-"
        shares = " | ".join(share([row for row in some if motion in row["after"]], motion) for some in (run, possible))
        lines.append(f"| {motion} | {shares} | {named - right} | {mean} |")
    lines += [
        "",
        "| case | true | class before | T designed, random | after the designed | after a random one | can be |",
    ]
    lines += ["|---|---|---|---|---|---|---|"]
    for name, row in used.items():
        motions = (DESIGNED, RANDOM)
        left = ", ".join(f"{row['promised'][m][1]:.0f}" if m in row["promised"] else "-" for m in motions)
        after = [said(row["after"][m]) if m in row["after"] else "not measured" for m in motions]
        after = "the same log | the same log" if row.get("same") else " | ".join(after)
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
