"""The Stribeck curve: dry friction in steady sliding falls from its static level with speed.

    g(v) = F_c + (F_s - F_c) exp(-(v / v_s)^2)

Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, with the exponent 2.
"""

from math import exp


def level(speed, coulomb, ratio, stribeck_speed):
    """g(v): friction in steady sliding at this speed [unit of coulomb]; coulomb: F_c; ratio: F_s / F_c."""
    return coulomb * (1.0 + (ratio - 1.0) * exp(-(speed / stribeck_speed) * (speed / stribeck_speed)))
