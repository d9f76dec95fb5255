"""Laws given by numbers: a curve through knots, and elements that remember how a quantity moved.

    f(u) = w_i + (w_i+1 - w_i) (u - k_i) / (k_i+1 - k_i)      between knots k_i <= u <= k_i+1, constant beyond the ends
    s'   = clip(s + du, -r, r)                                stop operator (elastic up to r, then sliding)
    h'   = (h + du) exp(-dt / tau)                            Maxwell element (a change that is forgotten)

A weighted sum of stop operators is the Prandtl-Ishlinskii model of hysteresis (Visintin, Differential Models of
Hysteresis, 1994), one of Maxwell elements linear viscoelasticity.
"""

from math import exp


def chord(u, k, l, v, w):  # noqa: E741  k and l: ends
    """Value at u on the straight line from (k, v) to (l, w)."""
    return v + (w - v) * (u - k) / (l - k)


def curve(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8):
    """Value of the curve at u."""
    if u < k4:
        if u < k2:
            return chord(max(u, k1), k1, k2, w1, w2)
        return chord(u, k2, k3, w2, w3) if u < k3 else chord(u, k3, k4, w3, w4)
    if u < k6:
        return chord(u, k4, k5, w4, w5) if u < k5 else chord(u, k5, k6, w5, w6)
    return chord(u, k6, k7, w6, w7) if u < k7 else chord(min(u, k8), k7, k8, w7, w8)


def slope(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8):
    """Slope of the curve at u, 0 beyond its ends."""
    if u < k1 or u > k8:
        return 0.0
    if u < k4:
        if u < k2:
            return (w2 - w1) / (k2 - k1)
        return (w3 - w2) / (k3 - k2) if u < k3 else (w4 - w3) / (k4 - k3)
    if u < k6:
        return (w5 - w4) / (k5 - k4) if u < k5 else (w6 - w5) / (k6 - k5)
    return (w7 - w6) / (k7 - k6) if u < k7 else (w8 - w7) / (k8 - k7)


def stop_operator(s, change, reach):
    """Stop operator after its input moved by `change`."""
    return min(max(s + change, -reach), reach)


def faded(h, change, dt, time_constant):
    """Maxwell element after its input moved by `change` in dt [s]."""
    return (h + change) * exp(-dt / time_constant)


def dragged(speed, loss):
    """Speed after it lost `loss`, never turned round by a positive one; a negative one drives it on."""
    if loss < 0.0:
        return speed - loss if speed > 0.0 else speed + loss if speed < 0.0 else 0.0
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0


def inside(u, low, high, bin_, bins):
    """1 if u lies in a bin of `bins` equal ones from low to high, else 0."""
    at = (u - low) / (high - low) * bins
    return 1.0 if bin_ <= at < bin_ + 1.0 else 0.0
