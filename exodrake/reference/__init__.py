"""The reference simulator for withheld tests: robots are drawn, labels committed, diagnoses scored.

It shares no equation with the main model: continuous time, error-controlled integration, recursive Newton-Euler for the
finger, other functional forms of every effect, and faults outside the library.

simulator.py simulates one robot; dynamics.py, chain.py, tendons.py, joint_torques.py and control_loop.py hold its
physics; catalogue.py says what can be injected; case_mix.py plans a set and gap.py sizes its effects; make.py, run.py
and score.py are the commands, of which the last rests on answers.py, matching.py, measures.py, shares.py and
parameter_intervals.py.
"""
