"""Effects that a diagnosis tries: the common ones. The shelf holds rarer ones too, which a user may add by name.

More hypotheses make every verdict less sure; these are the effects that tendon-driven robots are known to have, each of which
can be told from the others in a log of tension, stroke and angle, or is known to be inseparable from a named one.
"""

COMMON = (
    "motor.slow_velocity_loop", "motor.dead_zone", "motor.current_limit", "motor.spool_growth",
    "tendon.capstan_friction", "tendon.coulomb_friction", "tendon.stribeck_friction", "tendon.viscous_friction",
    "tendon.compliance", "tendon.creep", "tendon.slack", "tendon.stiffening",
    "sensor.gain", "sensor.offset", "sensor.drift", "sensor.nonlinearity", "sensor.lag", "sensor.pulley_friction", "sensor.crosstalk",
    "finger.stiffness", "finger.hardening", "finger.viscoelasticity", "finger.hysteresis", "finger.coupling",
    "finger.router_height", "finger.router_migration", "finger.gravity", "finger.contact", "finger.tremor", "finger.spasticity",
    "timing.command_latency", "timing.dropped_commands", "timing.mocap_delay", "timing.mocap_clock_skew",
    "encoder.homing_offset", "mocap.gain", "mocap.offset",
)  # fmt: skip
