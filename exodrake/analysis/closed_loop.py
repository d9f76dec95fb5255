"""Analysis of the closed loop at one operating point, `exo.analyse(robot)`, and its results as plain data."""

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import control
import numpy as np

from exodrake.analysis import margins as mg
from exodrake.analysis.limit_cycles import LimitCycles
from exodrake.analysis.linear_model import KINK, UNLIKE, FrameModel, OperatingPoint, System, linearise_robot
from exodrake.analysis.responses import FrequencyResponse, StepResponse, frequency_response, list_departures, returns
from exodrake.analysis.robustness import Band, Robustness, Uncertainty, robustness
from exodrake.core.errors import InputError, argument, nearest
from exodrake.core.plain import plain
from exodrake.model.robot import Robot

UNITS = {  # names of fields in JSON
    "rise": "rise_time [s]", "settling": "settling_time [s]", "time_constant": "time_constant [s]",
    "frequency": "frequency [Hz]", "bandwidth": "bandwidth [Hz]", "bandwidth_measured": "bandwidth_measured [Hz]",
    "crossover": "crossover [Hz]", "delay_margin": "delay_margin [s]", "to_control": "reading to law [s]",
    "to_write": "law to plant [s]", "hold": "hold [s]", "margin": "margin [s]", "spare_slots": "margin [slots]",
}  # fmt: skip
ROUGH = 1e-3  # slopes of two step sizes that differ by more deserve a word
STEADY_ERROR = 0.02  # share of a step


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of a robot at an operating point.

    Attributes:
        robot: robot that was analysed.
        point: operating point at which it rests.
        model: linear model with one step per frame.
        opened: linear model opened at its commands, see `margins.break_loop`.
        system: python-control's `StateSpace` of the closed loop. Inputs: references, sensor noise of unit variance, and
            disturbances added to the commands; outputs: all signals.
        steps: step response of each channel, in the machine's order.
        responses: frequency response of each channel.
        margins: stability margins of each channel's loop.
        delays: delay budget of each channel.
        robust: robustness with all commands at once.
        gains: stability map over two gains.
        latency: stability over command latency; None where the robot knows no such effect.
        returns: whether the nonlinear simulation comes back to rest after a kick; it decides where the poles do not.
        notes: what a reader must know before trusting the numbers, a sentence each.
        bands: robustness over populations of robots and operating points.
        uncertainty: what the intervals of a diagnosis mean for the loop; None without one.

    Examples:
        >>> import exodrake as exo
        >>> exo.analyse(exo.load_robot("emps")).model.spectral_radius < 1.0
        True
    """

    robot: Robot
    point: OperatingPoint
    model: FrameModel
    opened: System
    system: System
    steps: tuple[StepResponse, ...]
    responses: tuple[FrequencyResponse, ...]
    margins: tuple[mg.Margins, ...]
    delays: tuple[mg.DelayBudget, ...]
    robust: Robustness
    gains: mg.StabilityMap
    latency: mg.LatencySweep | None
    returns: bool
    notes: tuple[str, ...]
    bands: tuple[Band, ...] = ()
    uncertainty: Uncertainty | None = None

    def __repr__(self) -> str:
        slowest = max(s.settling for s in self.steps)
        margins = "; ".join(
            f"{m.channel} {m.gain_margin_db:.3g} dB, {m.phase_margin_deg:.3g} deg" for m in self.margins
        )
        return (
            f"ClosedLoop of {self.robot.machine.name}: {'stable' if self.stable else 'UNSTABLE'}, spectral radius "
            f"{self.model.spectral_radius:.4f}, settles in {slowest:.3g} s\nmargins: {margins}"
        )

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle; where they mean little, whether the loop returns to rest."""
        return self.model.spectral_radius < 1.0 if self.model.decides else self.returns

    def loop(self, source: str, target: str) -> control.StateSpace:
        """The closed loop from an input of `system` to an output, as a `StateSpace`. InputError for an unknown one.

        Inputs are references such as `tension_ref_AF`, commands that are disturbed, and noise; outputs such as
        `tension_AF`.
        """
        for name, known in ((source, self.system.input_labels), (target, self.system.output_labels)):
            if name not in known:
                raise InputError(f"the loop has no signal {name!r} there{nearest(name, known)}; see `system`")
        return System(self.system[target, source], name=f"{source}_to_{target}", states=self.system.state_labels)

    def open_loop(self, command: str) -> control.StateSpace:
        """The return ratio L of the loop opened at a command, the others closed, as python-control's `StateSpace`.

        Its margins need `control.stability_margins(L, method="frd")`: the default method goes through polynomials of
        the order of L, which are wrong for some tens of states. InputError for an unknown command.
        """
        if command not in self.opened.input_labels:
            known = self.opened.input_labels
            raise InputError(f"no command {command!r}{nearest(command, known)}; there are {', '.join(known)}")
        ratio, names = -mg.open_channel(self.opened, self.opened.input_labels.index(command))[0, 0], [command]
        return System(ratio, name=f"L_{command}", inputs=names, outputs=names, states=self.opened.state_labels)

    def to_control(self) -> control.StateSpace:
        """The closed loop from the references to all signals, as python-control's `StateSpace` with dt = one frame."""
        return self.model.system


def analyse(robot: Robot, at: Mapping[str, float] | str | None = None, seed: int | None = None) -> ClosedLoop:
    """Step responses, poles, margins, frequency response and stability maps of a robot's closed loop.

    Args:
        robot: to be analysed.
        at: operating point, channel -> reference [SI] or the name of one of the machine's; its first by default.
        seed: of sensor noise in the measured frequency response; None measures without noise and rounding.

    Raises:
        InputError: no closed loop, unknown channel, reference outside its limits, kp = 0, or no state of rest.

    Examples:
        >>> import exodrake as exo
        >>> exo.analyse(exo.load_robot()).margins[0].channel
        'AF'
    """
    model = linearise_robot(argument("robot", robot, Robot), at)
    loop, point, system, channels = model.loop, model.point, model.system, range(len(model.loop.channels))
    whole, v = mg.open_loop(model), model.rows(loop.loop.command)
    robust, found = robustness(model, "this robot"), tuple(mg.margins(whole, i, loop.channels[i]) for i in channels)
    d = system.D @ np.linalg.inv(system.D[v])  # of disturbances added to the commands, as `opened` has them in its B
    d[v] = 0.0
    connected = System(
        system.A, np.hstack([system.B, model.N, whole.B]), system.C, np.hstack([system.D, model.M, d]), system.dt,
        states=system.state_labels, outputs=system.output_labels,
        inputs=[*system.input_labels, *loop.noises, *(system.output_labels[i] for i in v)],
    )  # fmt: skip
    responses = tuple(frequency_response(model, i, seed=seed) for i in channels)
    return ClosedLoop(
        loop.robot, point, model, whole, connected, robust.steps, responses, found, mg.delay_budget(loop, found),
        robust, mg.stability_map(model), mg.latency_sweep(model), returns(loop, point),
        list_remarks(model, robust.steps, found),
    )  # fmt: skip


def list_remarks(
    model: FrameModel, steps: tuple[StepResponse, ...] = (), found: tuple[mg.Margins, ...] = ()
) -> tuple[str, ...]:
    """Conditions under which the results mean little, a sentence each."""
    loop, point = model.loop, model.point
    held = [f"{effect}.{next(iter(p))}=0" for effect, p in loop.robot.effects().items() if "friction" in effect]
    moving = f"; --set {' --set '.join(held)} shows the loop in motion" if held else ""
    unit, idle = loop.robot.machine.signal[loop.loop.output].unit, [m.channel for m in found if not m.acts]
    remarks = {
        loop.loop.note: loop.loop.note,
        f"left out: {', '.join(loop.outside)}, which moves the loop from outside and no pole": loop.outside,
        "the robot's own gains do not bring it to rest; the operating point was reached with gentler ones": (
            not point.steady
        ),
        f"something slow still moves ({point.residual:.1g} of its excursion a frame)": point.residual > 1e-6,
        f"a pole lies on the unit circle (radius 1 {model.spectral_radius - 1.0:+.0e}), as in a loop that rests "
        "within a dead zone or does not act: only the simulated kick says whether it is stable"
        + moving: model.marginal,
        "the loop is unstable here: its step and frequency responses are those of a growing oscillation, "
        "and it has no margins": model.decides and model.spectral_radius > 1.0,
        f"slack at rest: {', '.join(point.slack)}; poles hold for slack channels, not for taut ones": point.slack,
        f"one-sided slopes differ ({model.where}, {model.kink:.2g}): a kink such as friction; "
        "poles, margins and maps mean little, steps and multisine do" + moving: model.kink > KINK,
        f"difference quotients depend on their step ({model.convergence:.2g}): rounding or a kink nearby"
        + "; poles, margins and maps mean little" * (model.convergence > UNLIKE): model.convergence > ROUGH,
    }
    notes = [*(words for words, holds in remarks.items() if holds), *list_departures(model, steps)]
    for s in steps:
        if abs(s.steady_error) > STEADY_ERROR * abs(s.size):
            notes.append(f"{s.channel} ends {s.steady_error:+.3g} {unit} off its reference after {s.time[-1]:.3g} s")
    if idle:
        notes.append(f"the command of {', '.join(idle)} does not act on its reading here: no margins and no frame map")
    lowest = [(m.channel, m.gain_low_db) for m in found if np.isfinite(m.gain_low_db)]
    notes += [f"{name} is conditionally stable: {low:.3g} dB of loop gain is too little" for name, low in lowest]
    return tuple(notes)


def name_fields(result: Any, *without: str) -> dict[str, Any]:
    """Fields of a result, units in their names, some left out."""
    fields: dict[str, Any] = vars(result)
    return {UNITS.get(k, k): v for k, v in fields.items() if k not in without}


def to_plain(result: ClosedLoop, cycles: tuple[LimitCycles, ...] = ()) -> dict[str, Any]:
    """All results as plain data for JSON, units in the keys; values that are not finite become null."""
    robot, machine, gains, latency = result.robot, result.robot.machine, result.gains, result.latency
    model, point, readings = result.model, result.point, {}
    for kind, values in point.readings.items():
        signal = machine.column(kind).signal
        readings[f"{kind} [{machine.signal[signal].unit}]"] = dict(zip(machine.channels(signal), values))
    return plain(
        {
            "robot": robot.source or machine.name,
            "effects": robot.effects(),
            "stable": result.stable,
            "decided_by": "poles" if model.decides else "simulated kick",
            "spectral_radius": model.spectral_radius,
            "returns_after_kick": result.returns,
            "notes": list(result.notes),
            "operating_point": readings
            | {
                "frames": point.frames, "residual [excursion/frame]": point.residual,
                "steady_by_own_gains": point.steady,
            },
            "poles": [{"z": p.z, "modulus": abs(p.z), **name_fields(p)} for p in model.poles()],
            "linear_model": {
                "difference_step": model.step, "convergence": model.convergence, "kink": model.kink,
                "kink_at": model.where, **model_arrays(result),
            },
            "steps": {s.channel: name_fields(s, "channel", "time", "output") for s in result.steps},
            "frequency_response": {r.channel: name_fields(r, "channel") for r in result.responses},
            "margins": {m.channel: name_fields(m, "channel", "frequency", "loop") for m in result.margins},
            "delays": {
                d.channel: name_fields(d, "channel")
                | {"slots": dict(zip(("read", "control", "write"), d.slots)), "total [s]": d.total}
                for d in result.delays
            },
            "robustness": result.robust.numbers,
            "bands": {
                b.name: {
                    "members": {m.label: m.numbers for m in b.members},
                    "range over stable members": {
                        n: b.range(n) for n in (b.members[0].numbers if b.members else ()) if n != "spectral radius"
                    },
                    "unstable": b.unstable,
                    "undecided by their poles": b.undecided,
                    "without operating point": list(b.failures),
                }
                for b in result.bands
            },
            "limit_cycles": {c.label: {k: v for k, v in vars(c).items() if k != "label"} for c in cycles},
            "uncertainty": result.uncertainty and result.uncertainty.to_dict(),
            "stability_map": {
                "gains": {name: machine.parameters[robot.indices(name)[0]].unit for name in gains.names},
                "first": gains.first, "second": gains.second, "spectral_radius": gains.radius,
                "limit of the first": gains.limit, "nominal": gains.nominal,
            },
            "latency": latency
            and {"frames": latency.frames, "spectral_radius": latency.radius, "limit [frames]": latency.limit},
        }
    )  # fmt: skip


def model_arrays(result: ClosedLoop) -> dict[str, Any]:
    """Matrices, frame [s] and names of the linear model: what `control.StateSpace` takes."""
    s = result.model.system
    names = {"states": s.state_labels, "inputs": s.input_labels, "outputs": s.output_labels}
    return {"A": s.A, "B": s.B, "C": s.C, "D": s.D, "dt": s.dt} | names


def model_bytes(result: ClosedLoop) -> bytes:
    """The linear model as an NPZ file for use without python-control."""
    buffer = BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.array(value) for name, value in model_arrays(result).items()})
    return buffer.getvalue()
