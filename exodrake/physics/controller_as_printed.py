"""The damping term with the sign printed in the paper's Eq. 3, to compare: it undamps (`physics.md` 1.3)."""


def damping(rate, kd):
    """Damping part of the command [m/s] from dF/dt [N/s] as printed: hastens a rising tension."""
    return kd * rate
