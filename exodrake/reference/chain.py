"""Rigid-body dynamics of a planar chain of three phalanges by recursive Newton-Euler (Luh, Walker, Paul 1980).

x is distal, y dorsal; a joint angle > 0 flexes, i.e. turns about -z. A phalanx at absolute angle phi points along
(cos phi, -sin phi). Lengths, masses, centres of mass and unit inertias about the proximal ends are those of the record.
"""

from numba import njit


@njit(cache=True)
def swing(sine, cosine, turn, spin):
    """Second derivative of a phalanx's direction [1/s2]; turn [rad/s] and spin [rad/s2] are absolute."""
    return -spin * sine - turn * turn * cosine, -spin * cosine + turn * turn * sine


@njit(cache=True)
def inverse_dynamics(p, sine, cosine, turn, spin, base_x, base_y):
    """Joint torques [N m] of a motion.

    Args:
        p: Record of the robot.
        sine: Sines of the absolute angles (3,).
        cosine: Cosines of the absolute angles (3,).
        turn: Absolute angular rates (3,) [rad/s].
        spin: Absolute angular accelerations (3,) [rad/s2].
        base_x: Distal acceleration of the first joint [m/s2]; minus gravity for a finger with weight.
        base_y: Dorsal acceleration of the first joint [m/s2]; minus gravity for a finger with weight.
    """
    mass, centre, length, unit = p.mass, p.centre, p.length, p.unit_inertia
    x0, y0 = swing(sine[0], cosine[0], turn[0], spin[0])
    x1, y1 = swing(sine[1], cosine[1], turn[1], spin[1])
    x2, y2 = swing(sine[2], cosine[2], turn[2], spin[2])
    second_x, second_y = base_x + length[0] * x0, base_y + length[0] * y0
    third_x, third_y = second_x + length[1] * x1, second_y + length[1] * y1
    force_x0, force_y0 = mass[0] * (base_x + centre[0] * x0), mass[0] * (base_y + centre[0] * y0)
    force_x1, force_y1 = mass[1] * (second_x + centre[1] * x1), mass[1] * (second_y + centre[1] * y1)
    force_x2, force_y2 = mass[2] * (third_x + centre[2] * x2), mass[2] * (third_y + centre[2] * y2)
    third = mass[2] * (unit[2] - centre[2] * centre[2]) * spin[2] - centre[2] * (
        sine[2] * force_x2 + cosine[2] * force_y2
    )
    second = third + mass[1] * (unit[1] - centre[1] * centre[1]) * spin[1]
    second -= centre[1] * (sine[1] * force_x1 + cosine[1] * force_y1) + length[1] * (
        sine[1] * force_x2 + cosine[1] * force_y2
    )
    beyond_x, beyond_y = force_x1 + force_x2, force_y1 + force_y2
    first = second + mass[0] * (unit[0] - centre[0] * centre[0]) * spin[0]
    first -= centre[0] * (sine[0] * force_x0 + cosine[0] * force_y0) + length[0] * (
        sine[0] * beyond_x + cosine[0] * beyond_y
    )
    return first, second, third


@njit(cache=True)
def mass_matrix(p, sine, cosine):
    """Columns of the mass matrix [kg m2]: torques of unit accelerations of one joint each, from rest."""
    still = (0.0, 0.0, 0.0)
    first = inverse_dynamics(p, sine, cosine, still, (1.0, 1.0, 1.0), 0.0, 0.0)
    second = inverse_dynamics(p, sine, cosine, still, (0.0, 1.0, 1.0), 0.0, 0.0)
    return first, second, inverse_dynamics(p, sine, cosine, still, (0.0, 0.0, 1.0), 0.0, 0.0)
