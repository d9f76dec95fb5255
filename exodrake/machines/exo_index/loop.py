"""The tension loop of the Exo-Index robot, its operating points and the controllers that can be tuned."""

from exodrake.core.loop import Controller, Gain, Loop

KP, KD = Gain("controller.kp", 1e-3, 0.03), Gain("controller.kd", 1e-6, 5e-4)  # m/(s N), m/N: range of the robot file
KI = Gain("controller.ki", 3e-4, 0.3)  # m/(s2 N)
TAU_D, TAU_R = Gain("controller.tau_D", 2e-3, 0.2), Gain("controller.tau_R", 0.01, 1.0)  # s
FEED = Gain("controller.feed", 0.1, 1.5)
PLAIN = {f"controller.{name}": 0.0 for name in ("kd", "ki", "tau_D", "tau_R", "feed")}
COMPLIANCE = tuple(f"controller.compliance_{k}" for k in (1, 2, 3))

LOOP = Loop(
    reference="tension_ref",
    command="speed_cmd",
    output="tension",
    measured="tension_read",
    part="controller",
    held="command",
    gains=(Gain("controller.kp", 0.0, 0.03), Gain("controller.kd", -5e-4, 5e-4)),  # kd < 0: the sign as printed
    gentle={**PLAIN, "controller.kp": 3e-3, "controller.ki": 1e-3},  # ki empties the integral
    step=1.0,
    points={
        "middle": {"AF": 4.0, "MF": 3.0, "AE": 1.0},
        "small": {"AF": 0.3, "MF": 0.3, "AE": 0.3},  # F_min
        "full": {"AF": 12.0, "MF": 8.0, "AE": 8.0},  # F_max
    },
    controllers=(
        Controller("PD", (KP, KD), PLAIN),
        Controller("PD, filtered", (KP, KD, TAU_D), PLAIN),
        Controller("PI, reference filter", (KP, KI, TAU_R), PLAIN),
        Controller("PID, both filters", (KP, KI, KD, TAU_D, TAU_R), PLAIN),
        Controller("P, feed-forward", (KP, TAU_R, FEED), PLAIN, COMPLIANCE),
        Controller("PI, feed-forward", (KP, KI, TAU_R, FEED), PLAIN, COMPLIANCE),
    ),
    actuated="stroke_read",
    latency="timing.command_latency.frames",
    resolution="sensor.q_F",
    nonlinear={"motor.dead_zone": {}, "tendon.coulomb_friction": {}},
)
