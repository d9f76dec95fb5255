"""The moment arm as printed in our copy of the paper's Eq. 2: half the arm, and its norm, which loses the sign.

For comparison only: T dl/dt = tau q' no longer holds (`physics.md` 1.1). The wire path keeps its true length.
"""


def applied_arm(arm):
    """|R| / 2 [m]; the sign that the text relies on is put back only for the extensor's pull (arm < 0 near q = 0)."""
    return 0.5 * abs(arm) if arm > 0.0 else -0.5 * abs(arm)
