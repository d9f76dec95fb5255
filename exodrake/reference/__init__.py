"""The reference simulator for withheld tests: robots are drawn, labels committed, diagnoses scored.

It shares no equation with the main model: continuous time, error-controlled integration, recursive Newton-Euler for the
finger, other functional forms of every effect, and faults outside the library.

robot.py holds a robot, dynamics.py and simulator.py simulate it, faults.py says what can be injected.
cases.py plans a set and make.py writes it; answers.py and score.py judge its diagnoses.
"""
