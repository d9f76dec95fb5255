"""Sets of very short cases of the model itself: healthy ones, diagnosed at once, and one with a stiff sheath."""

import json
from functools import cache

import exodrake as exo
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.reference.answers import write_committed

FRAMES = 150  # 3 s
RUSTY = {"mu_phi": 0.3}


@cache
def short_case(name, seed, rusty):
    """A case with a log to fit and one held out."""
    robot = exo.load_robot()
    ill = robot.splice("tendon.capstan_friction", RUSTY, channels=["AF"]) if rusty else robot
    logs = []
    for place, role in enumerate(("fit", "holdout")):
        reference = exo.Reference(exo.random_motion(robot, seed=10 * seed + place).values[:FRAMES], role)
        logs.append(CaseLog(exo.simulate(ill, reference, seed=seed), role, role, None, f"{role}.csv"))
    return Case(name, {}, tuple(logs))


def write_set(folder, healthy, rusty=0):
    """Case folders, labels and commitment: the healthy first by name. The labels' path."""
    labels = {}
    for number in range(healthy + rusty):
        name, ill = f"case_{number:02d}", number >= healthy
        write_case(short_case(name, number, ill), folder / name)
        effect = {"id": "tendon.capstan_friction", "block": "tendon", "wires": ["AF"], "joints": []}
        effects = [effect | {"parameters": RUSTY, "exact": True, "gap": 9.0}] if ill else []
        labels[name] = {"kind": "single" if ill else "healthy", "effects": effects}
    path = folder.with_name(folder.name + "-labels.json")
    write_committed(labels, path, folder / "seal.txt")
    return path


RUN = ("seconds", "provenance")  # keys of an answer that differ from run to run


def answers(folder):
    """Case -> its answer, without what differs from run to run."""
    found = {path.parent.name: json.loads(path.read_text()) for path in folder.glob("*/diagnosis.json")}
    return {name: {key: value for key, value in answer.items() if key not in RUN} for name, answer in found.items()}
