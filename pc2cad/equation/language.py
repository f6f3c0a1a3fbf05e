"""Meaning of the equation language: syntax trees to scalars, points and free vectors."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
from math import nan
from typing import Final, TypeVar

from pc2cad.equation import points
from pc2cad.equation.names import (
    CONSTANTS as CONSTANTS,
)
from pc2cad.equation.names import (
    COORDINATE_FUNCTIONS,
    POINT_FUNCTIONS,
    SHORTHANDS,
)
from pc2cad.equation.names import FUNCTION_NAMES as FUNCTION_NAMES
from pc2cad.equation.names import PARAMETER_NAMES as PARAMETER_NAMES
from pc2cad.equation.names import RESERVED_NAMES as RESERVED_NAMES
from pc2cad.equation.names import Curves as Curves
from pc2cad.equation.names import Listed as Listed
from pc2cad.equation.names import Named as Named
from pc2cad.equation.names import nearest as nearest
from pc2cad.equation.points import Combination, Value, kind_of
from pc2cad.equation.syntax import (
    RADIANS,
    WORDS,
    BinaryNode,
    CallNode,
    ConditionNode,
    ExpressionSyntaxError,
    IndexNode,
    NameNode,
    NegationNode,
    Node,
    NumberNode,
    PartNode,
    TripleNode,
    parse,
)
from pc2cad.errors import InputError
from pc2cad.expression.budget import bounded
from pc2cad.expression.conditions import Condition, both, compared, either
from pc2cad.expression.functions import FUNCTIONS, PUBLIC_FUNCTIONS, REPEATED
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, call, number

_T = TypeVar("_T")
#: terms of one sum, and of all sums within one another
MOST_TERMS: Final = 10_000


class UnknownNameError(ExpressionSyntaxError):
    """A name stands for nothing that is known at this place."""


class ExpressionValueError(ExpressionSyntaxError):
    """An operation got operands of the wrong kind, or has no value."""


def read_expression(text: str, names: Mapping[str, Named], curves: Curves | None = None) -> Value:
    """Return the value of an expression with these names known.

    Raises ExpressionSyntaxError (or a subclass) with the column of the mistake; a value that is
    neither scalar, point nor free vector as a whole is an ExpressionValueError.
    """
    node = parse(text)
    with bounded():
        return _Reader(names, curves or {}).whole(node)


class _Reader:
    def __init__(self, names: Mapping[str, Named], curves: Curves) -> None:
        self._names = dict(names)
        self._curves = curves
        self._terms = 0

    def whole(self, node: Node) -> Value:
        """Return the value of a whole expression: a scalar, a point or a free vector."""
        value = self.value(node)
        try:
            kind_of(value)
        except InputError as error:
            raise ExpressionValueError(str(error), node.column) from error
        return value

    def value(self, node: Node) -> Value:
        try:
            value = self._value(node)
            if isinstance(value, Expr):
                check_constants((value,))
        except ExpressionSyntaxError:
            raise
        except InputError as error:
            raise ExpressionValueError(str(error), node.column) from error
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
            case PartNode():
                return self._part(node)
            case IndexNode():
                return self._entry(node)
            case ConditionNode():
                raise ExpressionValueError(
                    "a condition is no value; write if(condition, a, b)", node.column
                )
        raise AssertionError(node)

    def _name(self, node: NameNode) -> Value:
        if node.name in self._names:
            value = self._names[node.name]
            if isinstance(value, Listed):
                places = "[i]" if value.plain else "[i, j]"
                raise ExpressionValueError(
                    f"{node.name} is a list of [data]; write {node.name}{places}", node.column
                )
            return value
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
        if name == "if":
            return self._choice(node)
        if name == "sum":
            return self._sum(node)
        if name in REPEATED:
            if given < 2:
                raise ExpressionValueError(f"{name} takes two operands or more", node.column)
            first, *others = (self._scalar(x, f"an operand of {name}") for x in node.operands)
            return reduce(partial(call, name), others, first)
        if name in SHORTHANDS:
            make, roles = SHORTHANDS[name]
            self._check_count(node, len(roles))
            return make(*(self._scalar(x, f"an operand of {name}") for x in node.operands))
        if name in FUNCTIONS and name in PUBLIC_FUNCTIONS:
            self._check_count(node, FUNCTIONS[name].arity)
            return call(name, *(self._scalar(x, f"the operand of {name}") for x in node.operands))
        if name in self._curves:
            function = self._curves[name]
            self._check_count(node, getattr(function, "arity", 1))
            return function(*(self._scalar(x, f"the operand of {name}") for x in node.operands))
        if name in POINT_FUNCTIONS:
            function, roles = POINT_FUNCTIONS[name]
            if given != len(roles):
                raise ExpressionValueError(f"write {name}({', '.join(roles)})", node.column)
            return function(*(self.value(x) for x in node.operands))
        if name in COORDINATE_FUNCTIONS:
            self._check_count(node, 3)
            coordinates = [self._scalar(x, f"a coordinate of {name}") for x in node.operands]
            return COORDINATE_FUNCTIONS[name](*coordinates)
        if name == "diff":
            return self._diff(node)
        if name in self._names:
            raise UnknownNameError(f"{name} is not a function; write {name}*(…) for a product",
                                   node.column)  # fmt: skip
        if name in WORDS:
            raise UnknownNameError(f"{name} stands between conditions", node.column)
        if name.lower() in ("deg", "rad", "degree", "degrees", "radians", "deg2rad", "rad2deg"):
            raise UnknownNameError(f"unknown function '{name}'; {RADIANS}", node.column)
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

    def _choice(self, node: CallNode) -> Value:
        if len(node.operands) != 3:
            raise ExpressionValueError("write if(condition, a, b)", node.column)
        condition = self._condition(node.operands[0])
        a, b = (self.value(x) for x in node.operands[1:])
        return points.chosen(condition, a, b)

    def _condition(self, node: Node) -> Condition:
        # a hundred conditions joined by "and" lean to the left
        spine = [node]
        while isinstance(spine[-1], ConditionNode) and spine[-1].operator in ("and", "or"):
            spine.append(spine[-1].operands[0])
        result = self._comparison(spine[-1])
        for joint in reversed(spine[:-1]):
            assert isinstance(joint, ConditionNode)
            join = both if joint.operator == "and" else either
            result = join(result, self._condition(joint.operands[1]))
        return result

    def _comparison(self, node: Node) -> Condition:
        if not isinstance(node, ConditionNode):
            raise ExpressionValueError(
                "a condition is made of < <= > >=, and, or, not, and a value was given", node.column
            )
        if node.operator == "not":
            return ~self._condition(node.operands[0])
        sides = (self._scalar(x, f"a side of {node.operator}") for x in node.operands)
        left, right = sides
        return compared(left, node.operator, right)

    def _part(self, node: PartNode) -> Expr:
        value = self.value(node.operand)
        if isinstance(value, Expr):
            raise ExpressionValueError(
                f"a point or a vector has the coordinate .{node.part}, a scalar has none",
                node.column,
            )
        return value.coordinates["xyz".index(node.part)]

    def _sum(self, node: CallNode) -> Value:
        form = "write sum(i, from, to, expression)"
        if len(node.operands) != 4 or not isinstance(node.operands[0], NameNode):
            raise ExpressionValueError(form, node.column)
        name = node.operands[0].name
        if name in RESERVED_NAMES or name in self._names or name in self._curves:
            raise ExpressionValueError(
                f"{name} has a meaning already; {form} with another name", node.operands[0].column
            )
        first, last = (self._whole(x, f"a limit of {node.name}") for x in node.operands[1:3])
        self._terms += max(last - first + 1, 0)
        if self._terms > MOST_TERMS:
            raise ExpressionValueError(
                f"sums have {self._terms} terms, and at most {MOST_TERMS} are added up", node.column
            )
        total: Value | None = None
        for i in range(first, last + 1):
            self._names[name] = number(i)
            term = self.value(node.operands[3])
            if total is not None and isinstance(term, Expr) != isinstance(total, Expr):
                raise ExpressionValueError("the terms of a sum are of one kind", node.column)
            total = term if total is None else total + term  # type: ignore[operator]
        self._names.pop(name, None)
        return number(0) if total is None else total

    def _entry(self, node: IndexNode) -> Expr:
        listed = self._names.get(node.name)
        if not isinstance(listed, Listed):
            lists = [n for n, value in self._names.items() if isinstance(value, Listed)]
            known = node.name in self._names or node.name in FUNCTION_NAMES
            what = f"{node.name} is no list" if known else f"unknown list '{node.name}'"
            raise UnknownNameError(
                f"{what}; entries are taken from lists of [data]{nearest(node.name, lists)}",
                node.column,
            )
        places = [self._whole(x, f"an index of {node.name}") for x in node.places]
        if len(places) != (1 if listed.plain else 2):
            form = "[i]" if listed.plain else "[i, j]"
            raise ExpressionValueError(f"write {node.name}{form}", node.column)
        row = listed.rows[0]
        if not listed.plain:
            row = self._taken(node, listed.rows, places[0])
        return self._taken(node, row, places[-1])

    def _taken(self, node: IndexNode, entries: Sequence[_T], place: int) -> _T:
        if not 0 <= place < len(entries):
            raise ExpressionValueError(
                f"{node.name} has entries from 0 to {len(entries) - 1}, and {place} was asked for",
                node.column,
            )
        return entries[place]

    def _whole(self, node: Node, role: str) -> int:
        value = self._scalar(node, role)
        if value.op == "number" and value.payload.denominator == 1:
            return int(value.payload)
        near = nan if value.symbols else evaluate(value, {})
        if not abs(near) < 1e9 or near != round(near):
            raise ExpressionValueError(
                f"{role} is a whole number, and {value!r} was given", node.column
            )
        return round(near)

    def _check_count(self, node: CallNode, wanted: int) -> None:
        if len(node.operands) != wanted:
            plural = "operand" if wanted == 1 else "operands"
            raise ExpressionValueError(
                f"{node.name} takes {wanted} {plural}, here are {len(node.operands)}", node.column
            )


_OPERATIONS: Final[dict[str, Callable[[Expr, Expr], Expr]]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "^": operator.pow,
}  # fmt: skip


def _combine(node: BinaryNode, left: Value, right: Value) -> Value:
    sign = node.operator
    if isinstance(left, Expr) and isinstance(right, Expr):
        return _OPERATIONS[sign](left, right)
    if isinstance(left, Combination) and isinstance(right, Combination):
        if sign == "+":
            return left + right
        if sign == "-":
            return left - right
    elif sign == "*":
        return left * right  # type: ignore[operator]
    elif sign == "/" and isinstance(right, Expr):
        return left / right
    hint = "; use dot(a, b) or cross(a, b)" if sign == "*" else ""
    raise ExpressionValueError(
        f"{_named(left)} {sign} {_named(right)} has no meaning{hint}", node.column
    )


def _named(value: Value) -> str:
    try:
        return kind_of(value).value
    except InputError:
        return "a weighted point"


def check_constants(trees: Sequence[Expr]) -> None:
    """Raise InputError for a constant among trees that is no finite real number."""
    for tree in trees:
        if not tree.symbols and tree.op != "number" and not abs(evaluate(tree, {})) <= 1e60:
            raise InputError(f"{tree!r} is not a finite real number")
