"""A scenario: all that makes a simulated log, as a YAML file that makes the same log again.

protocol: caging                  # name with options (chirp:high=1.5), or reference: log.csv, beside this file
robot: exo_index                  # built-in, or a robot file's content
parameters: {finger.kappa.MCP: 0.09}
effects: {tendon.capstan_friction: {mu_phi: {AF: 0.3, MF: 0.0, AE: 0.0}}}
parts: [controller_as_printed]
seed: 0                           # of the noise; null runs without
quantisation: true
engine: compiled
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from exodrake import __version__
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.schema import anything, dump_yaml, mapping, optional, parse_yaml, text
from exodrake.data.log import CHANGED, MODEL, Log
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import EFFECTS, PARAMETERS, VARIANTS, build, load_robot
from exodrake.model.robot import Robot
from exodrake.model.units import quantity
from exodrake.simulation.protocols import from_log, protocol, split_options
from exodrake.simulation.simulate import ENGINES, simulate

SCHEMA = mapping({
    "exodrake": anything, "protocol": optional(text()), "reference": optional(text()), "robot": anything,
    "parameters": optional(PARAMETERS), "effects": optional(EFFECTS), "parts": optional(VARIANTS),
    "seed": anything, "quantisation": anything, "engine": optional(text(ENGINES)),
})  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """Which references (`protocol`, or `reference`: a log's file), which robot, with which noise, by which engine."""

    protocol: str = ""
    reference: str = ""
    robot: str | Mapping[str, Any] = "exo_index"
    parameters: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    parts: Sequence[str] = ()
    seed: int | None = 0
    quantisation: bool = True
    engine: str = "compiled"

    def __post_init__(self) -> None:
        if self.seed is not None and (isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0):
            raise InputError(f"seed is {self.seed!r}, wanted a whole number from 0, or null for no noise")
        if not isinstance(self.quantisation, bool):
            raise InputError(f"quantisation is {self.quantisation!r}, wanted true or false")
        if bool(self.protocol) == bool(self.reference):
            both = "both a protocol and a reference" if self.protocol else "neither a protocol nor a reference"
            raise InputError(f"{both}: wanted the name of a protocol or grasp mode, or a log with references to follow")

    def build_robot(self) -> Robot:
        """The robot with parts, numbers and effects in it. InputError naming what is unknown."""
        robot = load_robot(self.robot) if isinstance(self.robot, str) else build(self.robot, "scenario's robot")
        for part in self.parts:
            robot = robot.with_part(part)
        robot = robot.with_parameters(self.parameters)
        for identity, given in self.effects.items():
            robot = robot.splice(identity, given, name_channels(given))
        return robot

    def build_reference(self, robot: Robot) -> Reference:
        """References of the robot."""
        return from_log(self.reference, robot) if self.reference else protocol(self.protocol, robot)

    def run(self) -> tuple[Robot, Log]:
        """The robot and the log it writes; InputError if the numbers make it diverge."""
        robot = self.build_robot()
        return robot, self.simulate(robot, self.build_reference(robot))

    def simulate(self, robot: Robot, reference: Reference) -> Log:
        """The log of a robot built by `build_robot` on a reference; its mark says whether the scenario changes it."""
        log = simulate(robot, reference, self.seed, self.quantisation, self.engine)
        changed = self.effects or self.parameters or self.parts
        return replace(log, simulated=CHANGED if changed else MODEL)


def name_channels(given: Mapping[str, Any]) -> list[str]:
    """Channels named by an effect's per-channel numbers, in order."""
    return list(dict.fromkeys(channel for value in given.values() if isinstance(value, Mapping) for channel in value))


def read_scenario(path: str | Path) -> Scenario:
    """A scenario from its file; InputError naming file and key. Files it names lie beside it."""
    name = Path(path).name
    content = SCHEMA(parse_yaml(read_bytes(path), name), name)
    if content.get("reference"):
        content["reference"] = str(Path(path).parent / content["reference"])
    given: dict[str, Any] = {k: v for k, v in content.items() if k != "exodrake" and (v is not None or k == "seed")}
    try:
        return Scenario(**given)
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from None


def scenario_text(scenario: Scenario) -> str:
    """The scenario as YAML."""
    content = asdict(scenario) | {"parts": list(scenario.parts)}
    kept = {k: v for k, v in content.items() if k in ("seed", "quantisation", "engine") or v}
    return dump_yaml({"exodrake": __version__, **kept})


def change_robot(
    robot: Robot, parameters: Sequence[str], effects: Sequence[str], parts: Sequence[str] = ()
) -> tuple[Robot, dict[str, float], dict[str, dict[str, Any]]]:
    """A robot with parts, parameters (`tendon.k=2.7 N/mm`) and effects (`parse_effect`), and values of the last two."""
    for part in parts:
        robot = robot.with_part(part)
    numbers, spliced = {}, {}
    for word in parameters:
        name, equals, value = (part.strip() for part in word.partition("="))
        if not equals:
            raise InputError(f"{word!r} is not of the form name=number, with a unit if it is not in SI")
        numbers[name] = quantity(value, robot.machine.parameters[robot.indices(name)[0]].unit, name)
    robot = robot.with_parameters(numbers, "--set")
    for effect in effects:
        identity, given = parse_effect(effect, robot)
        robot, spliced[identity] = robot.splice(identity, given, name_channels(given)), given
    return robot, numbers, spliced


def parse_effect(text: str, robot: Robot) -> tuple[str, dict[str, dict[str, float] | float]]:
    """`id:parameter=value,...@AF,MF` as the id and all its numbers: those given, else the robot's, else typical."""
    head, at, channels = text.partition("@")
    identity, given = split_options(head)
    chosen = [channel.strip() for channel in channels.split(",") if channel.strip()]
    if at and not chosen:
        raise InputError(f"{text!r}: no channel after @")
    there = robot.splice(identity, given, chosen).effect_values(robot.machine.effect(identity))
    return identity, {name: values.get("", values) for name, values in there.items()}
