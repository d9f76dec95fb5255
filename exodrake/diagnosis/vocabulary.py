"""Effects that a diagnosis tries: those on a machine's effect library but the rare ones, which a user may add by name.

More hypotheses make every verdict less sure; the effects tried are those that such machines are known to have, each of
which can be told from the others in a log, or is known to be inseparable from a named one.
"""

RARE = frozenset({
    "motor.speed_droop", "motor.friction", "motor.gear_efficiency", "motor.spool_layers",
    "tendon.bouc_wen", "tendon.presliding", "tendon.prandtl_ishlinskii", "sensor.creep", "sensor.hysteresis",
    "finger.co_activation", "finger.voluntary_torque", "timing.jitter", "mocap.skin_artefact",
})  # fmt: skip


class Common:
    """The ids of all effects that are not rare."""

    def __contains__(self, identity: str) -> bool:
        return identity not in RARE


COMMON = Common()

SELF_DEFINED = (
    "sensor.gain", "sensor.offset", "sensor.crosstalk", "finger.stiffness", "finger.gravity", "tendon.slack",
    "timing.command_latency", "timing.dropped_commands", "timing.mocap_delay", "timing.mocap_clock_skew",
    "encoder.homing_offset", "mocap.gain", "mocap.offset",
)  # fmt: skip
"""Effects whose parameters mean the same whatever the law: a scale, a zero, a delay. Those of friction, creep or a
contact are numbers of the law that is fitted, and reality follows another.
"""
