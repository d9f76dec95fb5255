"""Parameters by name in the modules of parts, by index in the generated module: `n.kappa[i]` becomes `n[37 + i]`.

A named tuple travels by value, some seventy parameters at each call that the compiler does not inline; a slice of the
flat vector is a pointer.
"""

from __future__ import annotations

import ast

from exodrake.core.machine import Machine
from exodrake.core.part import Part
from exodrake.core.signal import SCALAR

PARAMETERS = "n"  # the argument by which the functions of parts know their parameters


class Flatten(ast.NodeTransformer):
    """Rewrites `n.name`, `n.name[channel]` by the indices of a part's parameters."""

    def __init__(self, machine: Machine, part: Part) -> None:
        self.indices: dict[str, tuple[int, int]] = {}
        at = 0
        for field in part.fields:
            width = machine.width(field.axis) if field.axis != SCALAR else 0
            self.indices[field.name] = (at, width)
            at += max(width, 1)

    def index(self, node: ast.AST) -> tuple[int, int] | None:
        """Start and width (0: a scalar) of the parameter that a node names."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == PARAMETERS:
            return self.indices.get(node.attr)
        return None

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """`n.name[channel]`."""
        found = self.index(node.value)
        if found is None:
            return self.generic_visit(node)
        return item(ast.BinOp(ast.Constant(found[0]), ast.Add(), self.visit(node.slice)))

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """`n.name`."""
        found = self.index(node)
        if found is None:
            return self.generic_visit(node)
        start, width = found
        if not width:
            return item(ast.Constant(start))
        return ast.Tuple([item(ast.Constant(start + i)) for i in range(width)], ast.Load())


def item(index: ast.expr) -> ast.Subscript:
    """`n[index]`."""
    return ast.Subscript(ast.Name(PARAMETERS, ast.Load()), index, ast.Load())
