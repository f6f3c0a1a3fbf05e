"""Meaning of the equation language: syntax trees to scalars, points and free vectors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import Final

from pc2cad.equation import points
from pc2cad.equation.points import Combination, Value, kind_of
from pc2cad.equation.syntax import (
    BinaryNode,
    CallNode,
    ExpressionSyntaxError,
    NameNode,
    NegationNode,
    Node,
    NumberNode,
    TripleNode,
    parse,
)
from pc2cad.errors import InputError
from pc2cad.expression.functions import FUNCTIONS, PUBLIC_FUNCTIONS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import PI, E, Expr, call, number

PARAMETER_NAMES: Final = ("u", "v", "w")
CONSTANTS: Final[dict[str, Expr]] = {"pi": PI, "e": E}

_POINT_FUNCTIONS: Final[dict[str, tuple[Callable[..., Value], tuple[str, ...]]]] = {
    "dot": (points.dot, ("a", "b")),
    "cross": (points.cross, ("a", "b")),
    "length": (points.length, ("a",)),
    "unit": (points.unit, ("a",)),
    "distance": (points.distance, ("A", "B")),
    "det": (points.det, ("a", "b", "c")),
    "metric": (points.metric, ("A", "B", "C")),
    "translate": (points.translate, ("A", "B", "C")),
    "exit_from_plane": (points.exit_from_plane, ("N", "P", "Q")),
}
_COORDINATE_FUNCTIONS: Final = {"point": points.point, "vector": points.vector}

FUNCTION_NAMES: Final = (*PUBLIC_FUNCTIONS, *_POINT_FUNCTIONS, *_COORDINATE_FUNCTIONS, "diff")
RESERVED_NAMES: Final = frozenset((*PARAMETER_NAMES, *CONSTANTS, *FUNCTION_NAMES))

#: scalar functions of one operand that a template defines for itself, such as a contour's x(t)
Curves = Mapping[str, Callable[[Expr], Expr]]


class UnknownNameError(ExpressionSyntaxError):
    """A name stands for nothing that is known at this place."""


class ExpressionValueError(ExpressionSyntaxError):
    """An operation got operands of the wrong kind, or has no value."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint that lists the nearest known names (empty when nothing is near)."""
    known = list(known)
    close = get_close_matches(name, known, n=3, cutoff=0.5)
    close += [k for k in known if k.lower() == name.lower() and k not in close]
    return f"; did you mean {' or '.join(close)}?" if close else ""


def read_expression(text: str, names: Mapping[str, Value], curves: Curves | None = None) -> Value:
    """Return the value of an expression with these names known.

    Raises ExpressionSyntaxError (or a subclass) with the column of the mistake; a value that is
    neither scalar, point nor free vector as a whole is an ExpressionValueError.
    """
    node = parse(text)
    value = _Reader(names, curves or {}).value(node)
    try:
        kind_of(value)
    except InputError as error:
        raise ExpressionValueError(str(error), node.column) from error
    return value


class _Reader:
    def __init__(self, names: Mapping[str, Value], curves: Curves) -> None:
        self._names = names
        self._curves = curves

    def value(self, node: Node) -> Value:
        try:
            value = self._value(node)
        except ExpressionSyntaxError:
            raise
        except InputError as error:
            raise ExpressionValueError(str(error), node.column) from error
        if isinstance(value, Expr) and not value.symbols and value.op != "number":
            _check_constant(value, node.column)
        return value

    def _value(self, node: Node) -> Value:
        match node:
            case NumberNode():
                return number(node.value)
            case NameNode():
                return self._name(node)
            case NegationNode():
                return -self.value(node.operand)
            case BinaryNode():
                return self._binary(node)
            case TripleNode():
                return points.point(*(self._scalar(x, "a coordinate") for x in node.operands))
            case CallNode():
                return self._call(node)
        raise AssertionError(node)

    def _name(self, node: NameNode) -> Value:
        if node.name in self._names:
            return self._names[node.name]
        if node.name in CONSTANTS:
            return CONSTANTS[node.name]
        if node.name in FUNCTION_NAMES or node.name in self._curves:
            raise UnknownNameError(f"{node.name} is a function; write {node.name}(…)", node.column)
        known = [*self._names, *CONSTANTS]
        raise UnknownNameError(f"unknown name '{node.name}'{nearest(node.name, known)}",
                               node.column)  # fmt: skip

    def _scalar(self, node: Node, role: str) -> Expr:
        value = self.value(node)
        if not isinstance(value, Expr):
            raise ExpressionValueError(f"{role} must be a scalar, and {_named(value)} was given",
                                       node.column)  # fmt: skip
        return value

    def _binary(self, node: BinaryNode) -> Value:
        # a sum of a thousand terms leans to the left: walk down its spine without recursion
        spine = [node]
        while isinstance(spine[-1].left, BinaryNode):
            spine.append(spine[-1].left)
        value = self.value(spine[-1].left)
        for step in reversed(spine):
            try:
                value = _combine(step, value, self.value(step.right))
            except ExpressionSyntaxError:
                raise
            except InputError as error:
                raise ExpressionValueError(str(error), step.column) from error
        return value

    def _call(self, node: CallNode) -> Value:
        name, given = node.name, len(node.operands)
        if name in FUNCTIONS and name in PUBLIC_FUNCTIONS:
            self._check_count(node, FUNCTIONS[name].arity)
            return call(name, *(self._scalar(x, f"the operand of {name}") for x in node.operands))
        if name in self._curves:
            self._check_count(node, 1)
            return self._curves[name](self._scalar(node.operands[0], f"the operand of {name}"))
        if name in _POINT_FUNCTIONS:
            function, roles = _POINT_FUNCTIONS[name]
            if given != len(roles):
                raise ExpressionValueError(f"write {name}({', '.join(roles)})", node.column)
            return function(*(self.value(x) for x in node.operands))
        if name in _COORDINATE_FUNCTIONS:
            self._check_count(node, 3)
            coordinates = [self._scalar(x, f"a coordinate of {name}") for x in node.operands]
            return _COORDINATE_FUNCTIONS[name](*coordinates)
        if name == "diff":
            return self._diff(node)
        if name in self._names:
            raise UnknownNameError(f"{name} is not a function; write {name}*(…) for a product",
                                   node.column)  # fmt: skip
        hint = nearest(name, [*FUNCTION_NAMES, *self._curves])
        raise UnknownNameError(f"unknown function '{name}'{hint}", node.column)

    def _diff(self, node: CallNode) -> Value:
        parameter = node.operands[1] if len(node.operands) in (2, 3) else None
        order = node.operands[2] if len(node.operands) == 3 else NumberNode(0, number(1).payload)
        if (
            not isinstance(parameter, NameNode)
            or parameter.name not in PARAMETER_NAMES
            or not isinstance(order, NumberNode)
            or order.value not in (1, 2, 3, 4)
        ):
            raise ExpressionValueError(
                "write diff(expression, u) or diff(expression, u, n): the parameter is u, v or w "
                "and the order n is 1 to 4", node.column,
            )  # fmt: skip
        return points.derivative(self.value(node.operands[0]), parameter.name, int(order.value))

    def _check_count(self, node: CallNode, wanted: int) -> None:
        if len(node.operands) != wanted:
            plural = "operand" if wanted == 1 else "operands"
            raise ExpressionValueError(
                f"{node.name} takes {wanted} {plural}, here are {len(node.operands)}", node.column
            )


_OPERATIONS: Final[dict[str, Callable[[Expr, Expr], Expr]]] = {
    "+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y,
    "/": lambda x, y: x / y, "^": lambda x, y: x**y,
}  # fmt: skip


def _combine(node: BinaryNode, left: Value, right: Value) -> Value:
    operator = node.operator
    a, b = isinstance(left, Combination), isinstance(right, Combination)
    fits = {"+": a == b, "-": a == b, "*": not (a and b), "/": not b, "^": not (a or b)}
    if not fits[operator]:
        hint = "; use dot(a, b) or cross(a, b)" if operator == "*" else ""
        raise ExpressionValueError(
            f"{_named(left)} {operator} {_named(right)} has no meaning{hint}", node.column
        )
    if isinstance(left, Combination):
        if isinstance(right, Combination):
            return left + right if operator == "+" else left - right
        return left * right if operator == "*" else left / right
    if isinstance(right, Combination):
        return right * left
    return _OPERATIONS[operator](left, right)


def _named(value: Value) -> str:
    try:
        return kind_of(value).value
    except InputError:
        return "a weighted point"


def _check_constant(value: Expr, column: int) -> None:
    magnitude = abs(evaluate(value, {}))
    if not magnitude <= 1e60:
        raise ExpressionValueError(f"{value!r} is not a finite real number", column)
