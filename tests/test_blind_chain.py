"""The second reality's rigid-body terms: read off Drake's MultibodyPlant, printed as source, and checked against it.

A planar chain of three phalanges is built in MultibodyPlant<Expression>; its mass matrix, velocity bias and gravity
torques come out as symbolic expressions in angles, rates, lengths, masses, centres of mass and unit inertias. Common
subexpressions are shared and the result is `exodrake/blind/chain_generated.py` (a real file, so that numba can cache
it). `python -m tests.test_blind_chain` writes it anew. This lives among the tests since the package's blind part may
not import pydrake.

x is distal, y dorsal; q > 0 flexes, i.e. turns about -z.
"""

from pathlib import Path

import numpy as np
import pytest

from exodrake.blind.parameters import draw_numbers
from exodrake.blind.robot_spec import RealitySpec
from exodrake.blind.simulator import assemble

OPERATORS = {"add": "+", "mul": "*", "div": "/", "pow": "**"}
HEADER = '''"""Rigid-body terms of the finger, read off MultibodyPlant by tests/test_blind_chain.py. Do not edit."""

from math import cos, sin

from numba import njit
'''


def numeric_plant(lengths, masses, centres, inertias, gravity=(0.0, 0.0, 0.0)):
    """MultibodyPlant of the finger: lengths, centres [m], masses [kg], unit inertias about each body's origin [m2],
    gravity [m/s2].
    """
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia

    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.asarray(gravity, float))
    parent = plant.world_frame()
    for index in range(3):
        unit = UnitInertia(inertias[index], inertias[index], inertias[index])
        spatial = SpatialInertia(masses[index], np.array([centres[index], 0.0, 0.0]), unit, skip_validity_check=True)
        body = plant.AddRigidBody(f"phalanx_{index}", spatial)
        plant.AddJoint(RevoluteJoint(f"joint_{index}", parent, body.body_frame(), [0, 0, -1]))
        parent = plant.AddFrame(
            FixedOffsetFrame(f"tip_{index}", body.body_frame(), RigidTransform([lengths[index], 0, 0]))
        )
    plant.Finalize()
    return plant


def symbolic_terms():
    """Expressions: mass matrix (6, upper triangle), bias (3), gravity torque per m/s2 along x (3) and y (3)."""
    from pydrake.math import RigidTransform_
    from pydrake.multibody.tree import SpatialInertia_, UnitInertia_
    from pydrake.symbolic import Expression, Variable

    def symbols(letter):
        return [Expression(Variable(f"{letter}{index}")) for index in range(3)]

    angle, rate, length, mass, centre, inertia = (symbols(letter) for letter in "qvlmcI")
    zero = Expression(0.0)

    def evaluate(gravity, posture):
        numeric = numeric_plant([0.04, 0.02, 0.02], [1.0] * 3, [0.5] * 3, [1.0] * 3, gravity)
        plant = numeric.ToSymbolic()
        context = plant.CreateDefaultContext()
        for index in range(3):
            unit = UnitInertia_[Expression](inertia[index], inertia[index], inertia[index])
            where = np.array([centre[index], zero, zero])
            spatial = SpatialInertia_[Expression](mass[index], where, unit, skip_validity_check=True)
            plant.GetBodyByName(f"phalanx_{index}").SetSpatialInertiaInBodyFrame(context, spatial)
            tip = RigidTransform_[Expression](np.array([length[index], zero, zero]))
            plant.GetFrameByName(f"tip_{index}").SetPoseInParentFrame(context, tip)
        plant.SetPositions(context, np.array(posture))
        plant.SetVelocities(context, np.array(rate))
        return plant, context

    plant, context = evaluate((0.0, 0.0, 0.0), [zero, *angle[1:]])  # neither depends on the base's heading
    matrix = plant.CalcMassMatrix(context)
    upper = [matrix[row, column] for row in range(3) for column in range(row, 3)]
    gravity = []
    for pull in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        heavy, heavy_context = evaluate(pull, angle)
        gravity += list(heavy.CalcGravityGeneralizedForces(heavy_context))
    return upper, list(plant.CalcBiasTerm(context)), gravity


class Printer:
    """Shares common subexpressions: every distinct node becomes one line `t<n> = ...`."""

    def __init__(self):
        self.lines, self.names = [], {}

    def line(self, text):
        if text not in self.names:
            self.names[text] = f"t{len(self.lines)}"
            self.lines.append(f"    {self.names[text]} = {text}")
        return self.names[text]

    def emit(self, expression):
        """Name (or literal) that holds the value of one symbolic expression; 0/x, 0*x and x+0 fold away."""
        from pydrake.symbolic import ExpressionKind

        kind = expression.get_kind()
        if kind == ExpressionKind.Constant:
            return repr(float(expression.Evaluate()))
        if kind == ExpressionKind.Var:
            return expression.to_string()
        _, operands = expression.Unapply()
        values = [self.emit(part) if hasattr(part, "get_kind") else repr(float(part)) for part in operands]
        if kind in (ExpressionKind.Sin, ExpressionKind.Cos):
            return self.line(f"{kind.name.lower()}({values[0]})")
        return self.combine(kind.name.lower(), values)

    def combine(self, name, values):
        if name == "add":
            kept = [value for value in values if value != "0.0"]
            return self.chain("+", kept) if kept else "0.0"
        if name == "mul":
            return (
                "0.0" if "0.0" in values else self.chain("*", [value for value in values if value != "1.0"] or ["1.0"])
            )
        if name == "div":
            return "0.0" if values[0] == "0.0" else self.chain("/", values)
        if name == "pow" and values[1] == "2.0":
            return "0.0" if values[0] == "0.0" else self.chain("*", [values[0], values[0]])
        raise ValueError(f"no rule for {name} of {values}")

    def chain(self, symbol, values):
        result = values[0]
        for value in values[1:]:
            result = self.line(f"{result} {symbol} {value}")
        return result


def print_function(name, arguments, doc, expressions):
    """Source of one numba function that returns the expressions' values as a tuple of floats."""
    printer = Printer()
    results = [printer.emit(expression) for expression in expressions]
    head = f'\n\n@njit(cache=True)\ndef {name}({", ".join(arguments)}):\n    """{doc}"""\n'
    return head + "\n".join(printer.lines) + f"\n    return ({', '.join(results)})\n"


TARGET = Path(__file__).parent.parent / "exodrake" / "blind" / "chain_generated.py"


def generate(path=TARGET):
    """Write the generated module."""
    upper, bias, gravity = symbolic_terms()
    angles, rates = ["q1", "q2"], ["v0", "v1", "v2"]
    rest = ["l0", "l1", "m0", "m1", "m2", "c0", "c1", "c2"]
    text = HEADER
    text += print_function(
        "mass_matrix", [*angles, *rest, "I0", "I1", "I2"], "Upper triangle, row by row [kg m2].", upper
    )
    text += print_function("velocity_bias", [*angles, *rates, *rest, "I0", "I1", "I2"], "C(q, v) v [N m].", bias)
    text += print_function(
        "gravity_torque", ["q0", *angles, *rest], "Torque per m/s2 of gravity along x (3), then y (3) [N m].", gravity
    )
    Path(path).write_text(text)


def test_rigid_body_terms_equal_drakes():
    from exodrake.blind.chain_generated import gravity_torque, mass_matrix, velocity_bias

    record = assemble(RealitySpec(draw_numbers(np.random.default_rng(1))), 2, None).record
    length, mass, centre, inertia = (record[name] for name in ("length", "mass", "centre", "unit_inertia"))
    plant = numeric_plant(length, mass, centre, inertia, (1.5, -9.0, 0.0))
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, v = rng.uniform(-0.5, 2.0, 3), rng.uniform(-9.0, 9.0, 3)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        shape = (length[0], length[1], *mass, *centre)
        upper = mass_matrix(q[1], q[2], *shape, *inertia)
        assert upper == pytest.approx(plant.CalcMassMatrix(context)[np.triu_indices(3)], rel=1e-12)
        assert velocity_bias(q[1], q[2], *v, *shape, *inertia) == pytest.approx(plant.CalcBiasTerm(context), rel=1e-9)
        pull = np.array(gravity_torque(*q, *shape))
        wanted = plant.CalcGravityGeneralizedForces(context)
        assert 1.5 * pull[:3] - 9.0 * pull[3:] == pytest.approx(wanted, rel=1e-9)


def test_generated_source_is_up_to_date(tmp_path):
    generate(tmp_path / "again.py")
    assert (tmp_path / "again.py").read_text() == TARGET.read_text()


if __name__ == "__main__":
    generate()
