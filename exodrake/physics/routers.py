"""Wire path over a joint: a router on each phalanx, at axial distances a, b from it and heights n, m above the bone.

Distal router A = Rot(-q) (a, -+n), proximal one B = (-b, -+m), upper sign for the flexor (palmar). With L(q) = |A - B|:

    L(q)^2 = a^2 + b^2 + m^2 + n^2 - 2 (D cos q + sigma E sin q)     D = m n - a b    E = m a + n b
    l = L(0) - L(q)     R = dl/dq = (sigma E cos q - D sin q) / L     dR/dq = (R^2 - sigma E sin q - D cos q) / L

with sigma = +1 for a flexor, -1 for the extensor. l is the wire taken in by the finger and R the signed moment arm
(R > 0 flexes): the paper's Eq. 1 and 2 with the sign kept and without the factor 0.5, which breaks T dl = tau dq
(`physics.md` 1.1). For a = b, m = n = h this is rho sin(alpha +- q/2) of `model.md`.
"""

from math import sqrt

FLEXOR, EXTENSOR = 1.0, -1.0


def path(cos_q, sin_q, a, b, m, n, side):
    """Wire taken in l [m], moment arm R [m] and dR/dq [m/rad] at one joint.

    Args: cos_q, sin_q of the joint angle; a, b, m, n [m]; side `FLEXOR` or `EXTENSOR`.
    """
    d = m * n - a * b
    e = side * (m * a + n * b)
    squares = a * a + b * b + m * m + n * n
    length = sqrt(squares - 2.0 * (d * cos_q + e * sin_q))
    arm = (e * cos_q - d * sin_q) / length
    return sqrt(squares - 2.0 * d) - length, arm, (arm * arm - e * sin_q - d * cos_q) / length


def applied_arm(arm):
    """Moment arm that turns tension into torque [m]: the same one, by virtual work."""
    return arm
