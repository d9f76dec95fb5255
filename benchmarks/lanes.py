"""How much faster one Newton step of the finger is for eight robots at once: `python -m benchmarks.lanes`.

An experiment, of which the package uses nothing (`docs/explain/diagnosis.md`, What it costs). Left out of the step:
effects, the ends of the joints' range, sine and cosine, all of which branch or call the mathematical library.
"""

from __future__ import annotations

import math
from time import process_time
from typing import Any

import numpy as np

from benchmarks.wide_numbers import WIDTH, dual, load, register, store
from exodrake.engine.compose import generate_module
from exodrake.engine.inputs import prepare_values
from exodrake.machines.robot_file import load_robot

REPEATS, STEPS = 15, 20_000
STEP = """
@njit(_nrt=False, forceinline=True, error_model="numpy")
def step(p, q, w, c, s, ends, lag):
    diagonal, coupling, _ = finger__inertia(p[49:52], p[52:55], p[55:58])
    flexor = (p[10], p[13]), (p[11], p[14]), (p[12], p[15])
    extensor = (p[22], p[25]), (p[23], p[26]), (p[24], p[27])
    taken, arms, bends = wire_paths__paths(p, c, s, (flexor, flexor[0], extensor))
    t0, t1, t2 = max(0.0, ends[0] - taken[0]), max(0.0, ends[1] - taken[1]), max(0.0, ends[2] - taken[2])
    pull = (p[0] * t0, p[1] * t1, p[2] * t2)
    m = finger__mass_matrix(diagonal, coupling, c[1], c[2], c[1] * c[2] - s[1] * s[2])
    spin = finger__coriolis(coupling, s[1], s[2], s[1] * c[2] + c[1] * s[2], w)
    rows, none = ((m[0], m[1], m[2]), (m[1], m[3], m[4]), (m[2], m[4], m[5])), (0.0, 0.0, 0.0)
    speed_up = (w[0] / lag, w[1] / lag, w[2] / lag)
    r0 = arithmetic__dot(rows[0], speed_up) + spin[0] + p[34] * w[0] + p[28] * (q[0] - p[31])
    r1 = arithmetic__dot(rows[1], speed_up) + spin[1] + p[35] * w[1] + p[29] * (q[1] - p[32])
    r2 = arithmetic__dot(rows[2], speed_up) + spin[2] + p[36] * w[2] + p[30] * (q[2] - p[33])
    r0 -= tendon_finger__torque(arms, 0, pull)
    r1 -= tendon_finger__torque(arms, 1, pull)
    r2 -= tendon_finger__torque(arms, 2, pull)
    known, still = (arms, arms, bends, p[0:3], pull), (none, none, none)
    first = tendon_finger__newton_row(0, rows[0], p[34], lag, known, p[28], still)
    second = tendon_finger__newton_row(1, rows[1], p[35], lag, known, p[29], still)
    third = tendon_finger__newton_row(2, rows[2], p[36], lag, known, p[30], still)
    return arithmetic__solve((first, second, third), (-r0, -r1, -r2))
"""


def loop(name: str, read: str, body: str) -> str:
    """Source of a function that repeats the step; read: of row {i} of the array {a}."""
    rows = {"p": 58, "q": 3, "w": 3, "c": 3, "s": 3, "ends": 3}
    given = [f"({', '.join(read.format(a=a, i=i) for i in range(n))})" for a, n in rows.items()]
    head = (
        f"@njit(error_model='numpy')\ndef {name}({', '.join(rows)}, {', '.join('d' + a for a in rows)}, out, lag, n):\n"
    )
    call = f"found = step({', '.join(given)}, lag)"
    # the next step needs this one, as in a simulation, by a number that changes nothing
    return head + "    for k in range(n):\n" + body.format(call=call) + "        w[0, 0] += 1e-18 * out[0, k % 8]\n"


ONE = "        for l in range(8):\n            {call}\n"
ONE += "".join(f"            out[{i}, l] = found[{i}]\n" for i in range(3))
ALL = "        {call}\n" + "".join(f"        store(out, {i}, found[{i}])\n" for i in range(3))


def measured(function: Any, given: tuple[Any, ...]) -> float:
    """Least processor time of a step of eight [ns]."""
    function(*given, 10)
    least = math.inf
    for _ in range(REPEATS):
        start = process_time()
        function(*given, STEPS)
        least = min(least, process_time() - start)
    return 1e9 * least / STEPS


def main() -> None:
    """Print the times and how well the results agree."""
    register()
    robot, rng = load_robot(), np.random.default_rng(0)
    text = generate_module(robot.machine).split("def run(")[0].rpartition("@njit")[0].replace("cache=True", "")
    space = {"load": load, "store": store, "dual": dual}
    text = text.replace("forceinline=True)", 'forceinline=True, error_model="numpy")') + STEP
    text += loop("apart", "{a}[{i}, l]", ONE) + loop("together", "load({a}, {i})", ALL)
    text += loop("derived", "dual({a}[{i}, 0], load(d{a}, {i}))", ALL)
    exec(compile(text, "generated", "exec"), space)
    n = prepare_values(robot)[:58, None] * (1.0 + 0.01 * rng.standard_normal((58, WIDTH)))
    q, w = 0.4 + 0.05 * rng.standard_normal((3, WIDTH)), 0.1 * rng.standard_normal((3, WIDTH))
    here = [n, q, w, np.cos(q), np.sin(q), 4e-3 + 1e-3 * rng.random((3, WIDTH))]
    ways = [0.01 * x * rng.standard_normal(x.shape) for x in here]
    ways[3], ways[4] = -here[4][:, :1] * ways[1], here[3][:, :1] * ways[1]
    lag, found, times = 2.0 * robot.machine.slot / 3.0, {}, {}
    for name in ("apart", "together", "derived"):
        found[name] = np.zeros((3, WIDTH))
        times[name] = measured(space[name], (*here, *ways, found[name], lag))
        space[name](*here, *ways, found[name], lag, 1)
    ends = [np.zeros((3, WIDTH)) for _ in range(2)]
    for sign, out in zip((1e-5, -1e-5), ends, strict=True):
        space["together"](*(x[:, :1] + sign * way for x, way in zip(here, ways, strict=True)), *ways, out, lag, 1)
    quotient = (ends[0] - ends[1]) / 2e-5
    apart, together, derived = times.values()
    difference = np.abs(found["apart"] - found["together"]).max()
    error = np.abs(quotient / found["derived"] - 1.0).max()
    print(f"eight robots one after another {apart:6.0f} ns")
    print(f"eight robots in one vector {together:10.0f} ns: {apart / together:.1f} times as fast, {difference:g} off")
    print(f"eight derivatives of one robot {derived:6.0f} ns: {apart / derived:.1f} times as fast, {error:.0e} off")


if __name__ == "__main__":
    main()
