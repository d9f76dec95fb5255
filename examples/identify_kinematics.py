"""Identify the kinematics of a finger from a synthetic marker recording, and compare them with the truth.

Run: python examples/identify_kinematics.py
"""

import numpy as np

from exodrake.identification.kinematics.identify import identify
from exodrake.identification.kinematics.markers import Faults, Hand, synthesise
from exodrake.identification.workspace import Ranges, monte_carlo, reach

# 20 s of a moving hand at 100 Hz, fourteen markers with 0.3 mm of noise and now and then a gap
recording, truth = synthesise(Hand(), Faults(noise=0.3e-3, dropouts=6), duration=20.0, rate=100.0, seed=1)
found = identify(recording)

print("joint  centre = gradient x angle + intercept [mm/rad, mm]      true gradient [mm/rad]")
for joint, true in zip(found.joints, truth.axes[1:]):
    gradient, intercept = 1e3 * joint.axis.slope, 1e3 * joint.axis.point
    line = f"{np.round(gradient, 2)} x angle + {np.round(intercept, 2)}"
    print(f"{joint.name}   {line:55s} {np.round(1e3 * true.slope, 2)}")

print("\nphalanx lengths [mm]")
for joint, length, half, true in zip(found.joints, found.lengths, found.intervals, truth.lengths):
    print(f"{joint.name}   {1e3 * length:.2f} +- {1e3 * half:.2f}   true {1e3 * true:.2f}")

ranges = Ranges(*(joint.range for joint in found.joints))
area, (drawn, error) = reach(found.lengths, ranges).area, monte_carlo(found.lengths, ranges, samples=5000)
print(f"\nfingertip workspace {1e6 * area:.0f} mm2, by Monte Carlo {1e6 * drawn:.0f} +- {1e6 * error:.0f} mm2")
