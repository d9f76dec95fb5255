"""The Exo-Index robot between its measured signals: segments, regime, command link."""

from exodrake.core.segment import CommandLink, Imposed, Regime, Segment

# A tendon is stiff: a micrometre turns into millinewtons. So a measured tension acts on the finger as a force, through
# tendons so soft that a stroke is one, and a measured angle as a hold.
SOFT = 1e-3  # N/m
READ = 0.005  # s after the start of a frame: middle of the three bus reads
STILL = 2e-4  # m/s: slower tendons count as at rest; a few encoder counts a second
SLACK = 0.15  # N: a tendon below half the anti-slack tension of 0.3 N counts as slack
SEGMENTS = (
    Segment("controller", "speed_cmd", ("tension",), exact=True),
    Segment(
        "motor",
        "stroke",
        ("tension",),
        (Imposed("stroke"), Imposed("wire_speed", rate=True)),
        sampled=READ,
        contents="bus, drive, encoder",
    ),
    Segment(
        "tendon",
        "tension",
        ("stroke", "angle"),
        (
            Imposed("tension", low=0.0),
            Imposed("tension_spool", low=0.0),
            Imposed("stroke", gain=1.0 / SOFT, low=0.0, part="finger"),
            Imposed("wire_speed", rate=True, gain=1.0 / SOFT, part="finger"),
        ),
        parameters={"tendon.k": SOFT},
        sampled=READ,
        contents="cable, load cell",
    ),
    Segment(
        "finger",
        "angle",
        ("tension",),
        (Imposed("angle"),),
        hold=("finger", "hold"),
        sampled=READ,
        contents="sheath, joints, motion capture",
    ),
)
REGIME = Regime("stroke", "tension", "angle", STILL, SLACK)
COMMAND_LINK = CommandLink("speed_cmd", "stroke", "speed_applied", "motor", "stroke")
