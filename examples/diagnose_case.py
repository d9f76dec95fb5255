"""Diagnose a robot from its logs, step by step, and use the improved simulator at once.

Run: python examples/diagnose_case.py [FOLDER [CASE]]
"""

import sys
from pathlib import Path

import numpy as np

import exodrake as exo
from exodrake.core.files import write_text
from exodrake.diagnosis.problem import make_problem
from exodrake.report.diagnosis_html import report_html
from exodrake.report.terminal import print_summary

MADE = Path(sys.argv[1] if len(sys.argv) > 1 else "diagnosed")


def some_case() -> Path:
    """The case named, else one of the reference simulator, a robot with friction in its sheaths."""
    if len(sys.argv) > 2:
        return Path(sys.argv[2])
    from exodrake.reference.cases import CasePlan
    from exodrake.reference.make import make_case

    make_case(CasePlan("case", (1, 1), "single", ("tendon.viscous_friction",), False), MADE)
    return MADE / "case"


MADE.mkdir(parents=True, exist_ok=True)
case, nominal = exo.read_case(some_case()), exo.load_robot()
print(f"{case.name}: {', '.join(item.file for item in case.logs)}")

# 1. the gap: what the nominal robot would have logged, beside what was measured, in noise standard deviations
problem = make_problem(case, nominal)
rows = problem.silent()[None]
gap = np.sqrt(np.mean(problem.residual(rows, problem.holdout) ** 2))
print(f"gap of the nominal robot on held-out motion: {gap:.1f} noise standard deviations")

# 2. the diagnosis: where, which, how far (about half a minute)
found = exo.diagnose(case, nominal, progress=lambda stage, detail: print("  ", stage.text, detail))
print_summary(found)

# 3. the report, and the robot file with the effect in it
write_text(MADE / "report.html", report_html(found, problem))
improved = found.robots["improved"]
exo.write_robot(improved, MADE / "robot.yaml")

# 4. the improved simulator at work: the same grasp with and without what was found
for name, robot in (("nominal", nominal), ("improved", improved)):
    log = exo.simulate(robot, exo.grasp("caging", robot), seed=None)
    print(f"{name:9s} caging closes the joints to", np.round(log.array("angle").max(axis=0), 3), "rad")
print(f"see {MADE / 'report.html'} and {MADE / 'robot.yaml'}")
