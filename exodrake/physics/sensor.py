"""Load cell of each wire and its reading over the bus.

The cell reads 2 T and is halved; its amplifier is a first-order lag, exact for a tension that is linear over a tick:

    tau_F F' = T_c - F          reading = round(F + sigma_F noise, q_F)            (`physics.md`, Sensors)
"""

import sys
from math import exp

from exodrake.model.part import SCALAR, TENDONS, FreeLaw, Output, Part, Point, State, Task, free_memory, parameter_class
from exodrake.physics.arithmetic import round_to

# amplifier lag, noise and resolution in units of tension
Parameters = parameter_class((SCALAR, {"tau_F": "s", "sigma_F": "N", "q_F": "N"}))
CELL, LOAD, READING, CLOCK, TICK, SLIDE = 0, 3, 6, 9, 10, 11
PRESLIDING = 5e-5  # wire travel over which friction at the sensing pulley turns round [m]; assumed

cell_load = Point("felt", TENDONS, "tension, slide",
                  "load on cell j [N] from the wire's tension; slide [-1 .. 1] > 0 while the spool takes wire in",
                  laws=(FreeLaw("friction at the cell over tension", "tension", "N", "-slide"),))  # fmt: skip
lag = Point("lag", TENDONS, "time_constant", "amplifier's time constant [s]", laws=())
mix_loads = Point("mixed", TENDONS, "load, following",
                  "what the amplifier sees [N], from the cell's load and the tension of the following wire [N]",
                  laws=())  # fmt: skip
settle = Point("settle", TENDONS, "dt, load, cell, travel",
               "states of the effects on cell j after dt [s]; load: on the cell [N]; cell: the same behind the "
               "amplifier [N]; travel: of the wire in this tick [m]", laws=())  # fmt: skip
reading = Point(
    "reading", TENDONS, "tension, clock", "tension [N] before noise and rounding; clock [s]",
    laws=(
        FreeLaw("error of the reading over tension", "tension", "N"),
        FreeLaw("error of the reading over time", "clock", "s"),
        *free_memory("of the reading", "load", "N", "settle"),
    ),
)  # fmt: skip


def lag_ramp(cell, before, now, dt, tau):
    """First-order lag over a tick whose input runs straight from `before` to `now`."""
    if tau <= 0.0:
        return now
    decay = exp(-dt / tau)
    climb = (now - before) / dt
    return cell * decay + before * (1.0 - decay) + climb * (dt - tau * (1.0 - decay))


def load_on(x, z, e, j, tension):
    """Load that the amplifier of wire j sees [N]."""
    return mix_loads(e, z, j, cell_load(e, z, j, tension[j], x[SLIDE + j]), tension[j + 1 if j < 2 else 0])


def update(x, z, n, e, dt, tension, wire_speed):
    """One tick of the amplifiers; signals [N], [m/s]."""
    for j in range(3):
        load = load_on(x, z, e, j, tension)
        x[CELL + j] = lag_ramp(x[CELL + j], x[LOAD + j], load, dt, lag(e, z, j, n.tau_F))
        x[LOAD + j] = load
        travel = wire_speed[j] * dt
        x[SLIDE + j] = min(max(x[SLIDE + j] + travel / PRESLIDING, -1.0), 1.0)
        settle(e, z, j, dt, load, x[CELL + j], travel)
    x[CLOCK] += dt
    x[TICK] = dt


def output(x, z, n, e, tension, cell):
    """Amplified tension [N] of this instant."""
    for j in range(3):
        load = load_on(x, z, e, j, tension)
        if x[TICK] > 0.0:
            cell[j] = lag_ramp(x[CELL + j], x[LOAD + j], load, x[TICK], lag(e, z, j, n.tau_F))
        else:
            cell[j] = x[CELL + j]


def read(x, z, n, e, j, cell, noise_tension):
    """The bus reads cell j: signals [N], standard normal noise."""
    x[READING + j] = round_to(reading(e, z, j, cell[j], x[CLOCK]) + n.sigma_F * noise_tension[j], n.q_F)


PART = Part(
    name="sensor", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("cell", TENDONS, unit="N"), State("load", TENDONS, unit="N"), State("reading", TENDONS, unit="N"),
        State("clock", SCALAR, unit="s"), State("tick", SCALAR, unit="s"), State("slide", TENDONS),
    ),
    tasks=(
        Task("update", ("tension", "wire_speed")),
        Task("read", ("cell", "noise_tension"), slots=(1, 2, 3), per_channel=True),
    ),
    outputs=(Output("output", ("cell",), reads=("tension",)), Output.of_states(reading="tension_read")),
    points=(cell_load, lag, mix_loads, settle, reading),
)  # fmt: skip
