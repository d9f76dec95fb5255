"""Variants of functions of the Exo-Index's parts, which take their place by name (`with_part`)."""

PULLING = 0.1  # tension with which a finger does not rest in q0 [N], ten times the noise of the cells; assumed
RESTS = 100  # ticks: 2 s, 40 time constants B / kappa


def rests_before(tension):
    """Ticks of rest before the log begins, by the tension in the wires [N]: the finger is at rest at switch-on.

    The nominal log begins in q0 at once, as that of the reference simulator does: wires homed 1 mm too far in then pull
    at the finger with 2.7 N, and it moves before the controller does.
    """
    return RESTS if tension > PULLING else 0


def applied_arm(arm):
    """|R| / 2 [m] as printed in our copy of the paper's Eq. 2; only the extensor's arm (< 0 near q = 0) has a sign.

    For comparison: T dl/dt = tau q' no longer holds (`physics.md` 1.1). The wire path keeps its true length.
    """
    return 0.5 * abs(arm) if arm > 0.0 else -0.5 * abs(arm)


def damping(rate, kd):
    """Damping part of the command [m/s] from dF/dt [N/s] with the sign printed in the paper's Eq. 3: it undamps.

    For comparison (`physics.md` 1.3).
    """
    return kd * rate
