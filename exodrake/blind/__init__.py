"""A second, independent reality for withheld tests: robots drawn from it, cases sealed, diagnoses scored.

It shares no equation code with the main model: continuous time, error-controlled integration, finger dynamics from
Drake's MultibodyPlant, other functional forms of every effect, and effects that are in no library at all.

reality.py simulates one robot; field.py, paths.py and joints.py hold its physics; catalogue.py says what can be
planted; mix.py plans a set; make.py, run.py and score.py are the three commands.
"""
