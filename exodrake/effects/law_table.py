"""Laws given by numbers: a curve through knots, and elements that remember how a quantity moved.

    f(u) = w_i + (w_i+1 - w_i) (u - k_i) / (k_i+1 - k_i)      between knots k_i <= u <= k_i+1, constant beyond the ends
    s'   = clip(s + du, -r, r)                                stop operator (elastic up to r, then sliding)
    h'   = (h + du) exp(-dt / tau)                            Maxwell element (a change that is forgotten)

A weighted sum of stop operators is the Prandtl-Ishlinskii model of hysteresis (Visintin, Differential Models of
Hysteresis, 1994), one of Maxwell elements linear viscoelasticity.
"""

from math import exp


def find_piece(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8):
    """Straight piece at u, from (k, v) to (l, w), as k, l, v, w."""
    if u < k4:
        if u < k2:
            return k1, k2, w1, w2
        return (k2, k3, w2, w3) if u < k3 else (k3, k4, w3, w4)
    if u < k6:
        return (k4, k5, w4, w5) if u < k5 else (k5, k6, w5, w6)
    return (k6, k7, w6, w7) if u < k7 else (k7, k8, w7, w8)


def curve(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8):
    """Value of the curve at u."""
    start, end, v, w = find_piece(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8)
    at = k1 if u < k1 else k8 if u > k8 else u
    return v + (w - v) * (at - start) / (end - start)


def slope(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8):
    """Slope of the curve at u, 0 beyond its ends."""
    start, end, v, w = find_piece(u, k1, k2, k3, k4, k5, k6, k7, k8, w1, w2, w3, w4, w5, w6, w7, w8)
    return 0.0 if u < k1 or u > k8 else (w - v) / (end - start)


def stop_operator(s, change, reach):
    """Stop operator after its input moved by `change`."""
    return min(max(s + change, -reach), reach)


def maxwell_element(h, change, dt, time_constant):
    """Maxwell element after its input moved by `change` in dt [s]."""
    return (h + change) * exp(-dt / time_constant)


def lose_speed(speed, loss):
    """Speed after it lost `loss`, never turned round by a positive one; a negative one drives it on."""
    if loss < 0.0:
        return speed - loss if speed > 0.0 else speed + loss if speed < 0.0 else 0.0
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0


def inside(u, low, high, bin_, bins):
    """1 if u lies in a bin of `bins` equal ones from low to high, else 0."""
    at = (u - low) / (high - low) * bins
    return 1.0 if bin_ <= at < bin_ + 1.0 else 0.0


faded, dragged = maxwell_element, lose_speed  # as files of laws that earlier versions found import them
