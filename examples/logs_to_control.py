"""From logs of a servo machine of one's own to control: response, fit, diagnosis, loop, gains and a model for MuJoCo.

Run: python examples/logs_to_control.py [FOLDER]
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.cli.main import cli

MADE = Path(sys.argv[1] if len(sys.argv) > 1 else "controlled")

# a machine of one's own, and a stand-in for the real one: both drives act late, and the elbow bears a weight
cli(["new-machine", str(MADE / "two_servos"), "--joints", "shoulder,elbow", "--servo", "motor"], standalone_mode=False)
nominal = exo.load_robot(str(MADE / "two_servos"))
real = nominal.splice("servo.latency", {"frames": 3.0})
real = real.splice("servo.gravity_moment", {"moment": 1.0, "lever": 0.1}, ["elbow"])
first, second, held = (exo.simulate(real, f"random-motion:duration=12,seed={k}", seed=k) for k in (1, 2, 3))

# 1. where the gap is over frequency, 2. a guess, fitted: both joints late, 3. a diagnosis, which tries all effects
for joint in nominal.machine.axes.joints:
    print(exo.frequency_response([first, second], f"angle_ref_{joint}", f"angle_{joint}", nominal))
print(exo.fit(nominal.splice("servo.latency"), [first, second], ["servo.latency.frames"], held_out=[held]))
answer = exo.diagnose([first, second, held], nominal)
print(answer)

# 4. a loop around the improved servos, 5. its best gains, 6. these servos for MuJoCo
improved = answer.robots["improved"]
print(exo.analyse(improved))
print(exo.tune(improved, draws=1, judges=4))
exo.export_robot(improved, MADE / "improved.xml", "mjcf")
