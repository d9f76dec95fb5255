"""Narrow pinch by both engines: the Drake Diagram and the compiled simulator give the same log, to the last bit.

Run: python examples/narrow_pinch.py [FOLDER]
"""

import sys
import time
from pathlib import Path

import exodrake as exo
from exodrake.data.plot import save_png

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
robot = exo.load_robot()
reference = exo.grasp("narrow-pinch", robot, hold=4.0)

logs = {}
for engine in ("compiled", "drake"):
    exo.simulate(robot, reference, engine=engine)  # once to load what is compiled
    start = time.perf_counter()
    logs[engine] = exo.simulate(robot, reference, engine=engine, seed=1)
    spent = time.perf_counter() - start
    print(f"{engine:9s} {logs[engine].duration / spent:8.0f} simulated seconds per second")

print("the same to the last bit:", logs["compiled"].equals(logs["drake"]))
save_png(logs["drake"].plot("Narrow pinch, by Drake", machine=robot.machine), folder / "narrow_pinch.png")
