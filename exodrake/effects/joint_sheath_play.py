"""Play of a cable in a sheath: friction holds the cable until it has stretched, the more the more the sheath is bent.

half_width(bend) = width exp(mu bend)          capstan: the tension that friction can hold grows by exp(mu bend)
"""

from math import exp

from exodrake.block import JOINTS, Effect, Number
from exodrake.effects.joint_play import followed as play


def half_width(bend, width, mu):
    """Half the play [rad] of a sheath with this total bend [rad]."""
    return width * exp(mu * bend)


def followed(aim, before, dt, bend, width, mu):
    """Angle after a tick [rad]."""
    return play(aim, before, dt, bend, half_width(bend, width, mu))


EFFECT = Effect(
    id="joint.sheath_play",
    summary="play of a cable in a sheath, which grows with the bend as friction round a capstan does",
    signature="as play; over configurations the width grows exponentially with the total bend",
    source="physics.md 4.B capstan; Nho et al., RA-L 2021",
    at={"joint.followed": followed},
    numbers=(
        Number("width", "rad", neutral=0.0, low=0.02, high=1.0, over=JOINTS, usual=0.3),
        Number("mu", "1/rad", neutral=0.0, low=0.0, high=0.5, over=JOINTS, usual=0.1),
    ),
)
