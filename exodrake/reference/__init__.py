"""The reference simulator for withheld tests: robots are drawn, labels committed, diagnoses scored.

It shares no equation with the main model: continuous time, error-controlled integration, recursive Newton-Euler for the
finger, other functional forms of every effect, and faults outside the library.
"""
