"""A robot that is switched on with its finger at rest under the wires, where they are homed too far in.

The nominal log begins in q0 at once, as that of the reference simulator does: wires homed 1 mm too far in then pull at
the finger with 2.7 N, and it moves before the controller does.
"""

PULLING = 0.1  # tension with which a finger does not rest in q0 [N], ten times the noise of the cells; assumed
RESTS = 100  # ticks: 2 s, 40 time constants B / kappa


def rests_before(tension):
    """Ticks of rest before the log begins, by the tension in the wires [N]."""
    return RESTS if tension > PULLING else 0
