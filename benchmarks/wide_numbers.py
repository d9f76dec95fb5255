"""Numbers of eight values in generated functions, for the experiment of `benchmarks.lanes`.

`Lanes` holds the values of eight robots in one vector register, `Dual` the value of one robot and its derivatives in
eight directions (forward-mode differentiation; Griewank & Walther 2008, ch. 3). Numba compiles a function for them as
for doubles, as long as no branch depends on a value.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

WIDTH = 8
VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
OPERATIONS = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}
IN_PLACE = {operator.iadd: "fadd", operator.isub: "fsub", operator.imul: "fmul"}


class Wide(types.Type):
    """A numba type of eight values or derivatives; numbers convert to it."""

    def unify(self, typingctx: Any, other: Any) -> Any:
        """The common type of a branch that gives a plain number."""
        return self if isinstance(other, types.Number) else None

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Whether a number becomes one."""
        return Conversion.safe if isinstance(other, types.Number) else None


class LanesType(Wide):
    """Values of eight robots."""


class DualType(Wide):
    """A value of one robot with eight derivatives."""


LANES, DUAL = LanesType("Lanes"), DualType("Dual")
NUMBERS = (types.Float, types.Integer)
PAIRS = [pair for wide in (LANES, DUAL) for n in NUMBERS for pair in ((wide, n), (n, wide), (wide, wide))]


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):
    """One vector register."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(DualType)
class DualModel(models.StructModel):
    """A double and a vector register."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("value", types.float64), ("slope", LANES)])


def spread(builder: Any, value: Any) -> Any:
    """A vector of eight equal values."""
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), zeros)


def parts(context: Any, builder: Any, value: Any, kind: Any) -> tuple[Any, Any]:
    """Value and derivatives; None in place of derivatives that are 0."""
    if kind is LANES:
        return value, None
    if kind is DUAL:
        dual = cgutils.create_struct_proxy(DUAL)(context, builder, value)
        return dual.value, dual.slope
    return context.cast(builder, value, kind, types.float64), None


def joined(context: Any, builder: Any, value: Any, slope: Any) -> Any:
    """The dual number of a value and its derivatives."""
    dual = cgutils.create_struct_proxy(DUAL)(context, builder)
    dual.value, dual.slope = value, slope
    return dual._getvalue()


def slope_of(builder: Any, code: str, left: tuple[Any, Any], right: tuple[Any, Any], value: Any) -> Any:
    """Derivatives of a sum, difference, product or quotient."""
    zero = ir.Constant(VECTOR, [0.0] * WIDTH)
    (a, da), (b, db) = ((value, zero if slope is None else slope) for value, slope in (left, right))
    if code in ("fadd", "fsub"):
        return getattr(builder, code)(da, db)
    if code == "fmul":
        terms = [builder.fmul(s, spread(builder, v)) for s, v in ((left[1], b), (right[1], a)) if s is not None]
        return terms[0] if len(terms) == 1 else builder.fadd(*terms)
    inverse = spread(builder, builder.fdiv(ir.Constant(ir.DoubleType(), 1.0), b))
    return builder.fmul(builder.fsub(da, builder.fmul(db, spread(builder, value))), inverse)


def lower_binary(function: Any, code: str) -> None:
    """Give numba an operation of two numbers of which one is wide."""

    def lower(context: Any, builder: Any, given: Any, args: Any) -> Any:
        left, right = (parts(context, builder, a, kind) for a, kind in zip(args, given.args, strict=True))
        if given.return_type is LANES:
            both = (a if a.type == VECTOR else spread(builder, a) for a in (left[0], right[0]))
            return getattr(builder, code)(*both)
        value = getattr(builder, code)(left[0], right[0])
        return joined(context, builder, value, slope_of(builder, code, left, right, value))

    for pair in PAIRS:
        lower_builtin(function, *pair)(lower)


def square_root(builder: Any, value: Any) -> Any:
    """The processor's square root."""
    name = "llvm.sqrt.v8f64" if value.type == VECTOR else "llvm.sqrt.f64"
    kind = ir.FunctionType(value.type, [value.type])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [value])


def lower_root(context: Any, builder: Any, given: Any, args: Any) -> Any:
    """Square root."""
    value, slope = parts(context, builder, args[0], given.args[0])
    root = square_root(builder, value)
    if slope is None:
        return root
    half = builder.fdiv(ir.Constant(ir.DoubleType(), 0.5), root)
    return joined(context, builder, root, builder.fmul(slope, spread(builder, half)))


def lower_negative(context: Any, builder: Any, given: Any, args: Any) -> Any:
    """Negative."""
    value, slope = parts(context, builder, args[0], given.args[0])
    return builder.fneg(value) if slope is None else joined(context, builder, builder.fneg(value), builder.fneg(slope))


def lower_maximum(context: Any, builder: Any, given: Any, args: Any) -> Any:
    """The larger one of a plain number and a wide one."""
    plain, (value, slope) = args[0], parts(context, builder, args[1], given.args[1])
    plain = spread(builder, plain) if slope is None else plain
    larger = builder.fcmp_ordered(">", value, plain)
    found = builder.select(larger, value, plain)
    zero = ir.Constant(VECTOR, [0.0] * WIDTH)
    return found if slope is None else joined(context, builder, found, builder.select(larger, slope, zero))


def lower_number(context: Any, builder: Any, kind: Any, wide: Any, value: Any) -> Any:
    """A plain number as a wide one."""
    value = context.cast(builder, value, kind, types.float64)
    zero = ir.Constant(VECTOR, [0.0] * WIDTH)
    return spread(builder, value) if wide is LANES else joined(context, builder, value, zero)


def register() -> None:
    """Make numba know all operations."""

    class Rule(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            wide = [a for a in args if a in (LANES, DUAL)]
            return signature(wide[0], *args) if wide else None

    for function in (*OPERATIONS, *IN_PLACE, operator.neg, max, math.sqrt):
        infer_global(function)(type("Rule", (Rule,), {}))  # pyright: ignore[reportOptionalCall]
    for function, code in (OPERATIONS | IN_PLACE).items():
        lower_binary(function, code)
    for wide in (LANES, DUAL):
        lower_builtin(operator.neg, wide)(lower_negative)
        lower_builtin(math.sqrt, wide)(lower_root)
        lower_builtin(max, types.Float, wide)(lower_maximum)
    for number in NUMBERS:
        for wide in (LanesType, DualType):
            lower_cast(number, wide)(lower_number)


@intrinsic
def load(typingctx: Any, array: Any, row: Any) -> Any:
    """Row of an array (rows, 8) as Lanes."""

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        data = context.make_array(given.args[0])(context, builder, args[0]).data
        at = builder.gep(data, [builder.mul(args[1], ir.Constant(args[1].type, WIDTH))])
        return builder.load(builder.bitcast(at, VECTOR.as_pointer()), align=8)

    return LANES(array, row), generate


@intrinsic
def store(typingctx: Any, array: Any, row: Any, wide: Any) -> Any:
    """Write Lanes, or the derivatives of a Dual, into a row of an array (rows, 8)."""

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        data = context.make_array(given.args[0])(context, builder, args[0]).data
        at = builder.gep(data, [builder.mul(args[1], ir.Constant(args[1].type, WIDTH))])
        value, slope = parts(context, builder, args[2], given.args[2])
        builder.store(value if slope is None else slope, builder.bitcast(at, VECTOR.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, row, wide), generate


@intrinsic
def dual(typingctx: Any, value: Any, slope: Any) -> Any:
    """A value with its derivatives."""

    def generate(context: Any, builder: Any, given: Any, args: Any) -> Any:
        return joined(context, builder, *args)

    return DUAL(types.float64, LANES), generate
