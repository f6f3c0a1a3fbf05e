"""Fields as formulas of the place: steps of plain operations on x, y and z, for other programs.

A field is one where it depends on x, y and z alone, or on u, v and w of an affine map, whose
inverse is written in their place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pc2cad.equation.fields import COORDINATES, Field
from pc2cad.equation.point_equation import PointEquation
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import ONE, ZERO, Expr, substitute, symbol, walk

#: functions that a step may be, by what the language calls them
FUNCTIONS: Final = (
    "sin", "cos", "tan", "asin", "acos", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
    "abs", "sign", "floor", "min", "max",
)  # fmt: skip
#: whole exponents up to which a power is written as products: programs take others of positive
#: numbers alone
MOST_FACTORS: Final = 16


@dataclass(frozen=True)
class Step:
    """One operation on earlier steps, by their numbers.

    ``constant``, one of x, y and z, ``add``, ``subtract``, ``multiply``, ``divide``, ``power``,
    ``select`` (c if a < b, else d) or one of `FUNCTIONS`.
    """

    operation: str
    operands: tuple[int, ...] = ()
    value: float = 0.0


#: steps, the last of which is the value
Formula = tuple[Step, ...]


def formula_of(equation: PointEquation, field: Field) -> Formula | None:
    """Return a scalar field as steps, or None: it is no formula of the place alone."""
    (tree, *more) = field.components
    if more:
        return None
    if not tree.symbols <= set(COORDINATES):
        inverse = _inverse(equation)
        if inverse is None:
            return None
        (tree,) = simplified(substitute((tree,), inverse))
    writer = _Writer()
    try:
        for node in walk((tree,)):  # operands first: long sums are deep
            if node.symbols:
                writer.step(node)
        last = writer.step(tree)
    except _NoStepError:
        return None
    # the value is the last step, whatever it shares with others
    if last != len(writer.steps) - 1:
        writer.add("add", last, writer.constant(0.0))
    return tuple(writer.steps)


def _inverse(equation: PointEquation) -> dict[str, Expr] | None:
    """Return u, v and w as trees of x, y and z where M is affine, else None."""
    columns = [derivatives(equation.coordinates, p) for p in PARAMETERS]
    columns = [simplified(column) for column in columns]
    if any(tree.symbols for column in columns for tree in column):
        return None
    zero = dict.fromkeys(PARAMETERS, ZERO)
    start = substitute(equation.coordinates, zero)
    way = [symbol(c) - s for c, s in zip(COORDINATES, start, strict=True)]
    a, b, c = columns
    det = _dot(a, _cross(b, c))
    if evaluate(det, {}) == 0.0:
        return None
    rows = (_cross(b, c), _cross(c, a), _cross(a, b))
    return {p: _dot(row, way) / det for p, row in zip(PARAMETERS, rows, strict=True)}


def _cross(a: tuple[Expr, ...], b: tuple[Expr, ...]) -> tuple[Expr, ...]:
    return (
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
    )  # fmt: skip


def _dot(a: tuple[Expr, ...], b: tuple[Expr, ...] | list[Expr]) -> Expr:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class _NoStepError(Exception):
    """An operation that formulas do not have."""


class _Writer:
    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._known: dict[Expr, int] = {}
        self._constants: dict[float, int] = {}

    def add(self, operation: str, *operands: int) -> int:
        self.steps.append(Step(operation, operands))
        return len(self.steps) - 1

    def constant(self, value: float) -> int:
        if value not in self._constants:
            self.steps.append(Step("constant", (), value))
            self._constants[value] = len(self.steps) - 1
        return self._constants[value]

    def step(self, tree: Expr) -> int:
        if tree not in self._known:
            self._known[tree] = self._made(tree)
        return self._known[tree]

    def _made(self, tree: Expr) -> int:
        if not tree.symbols:
            return self.constant(evaluate(tree, {}))
        op, args = tree.op, tree.args
        if op == "symbol":
            return self.add(str(tree.payload))
        if op == "pow":
            return self._power(*args)
        if op == "neg":
            return self.add("subtract", self.constant(0.0), self.step(args[0]))
        if op == "atan":
            return self.add("atan2", self.step(args[0]), self.step(ONE))
        if op == "mod":
            a, b = (self.step(arg) for arg in args)
            turns = self.add("floor", self.add("divide", a, b))
            return self.add("subtract", a, self.add("multiply", b, turns))
        if op == "where":
            condition, there, other = (self.step(arg) for arg in args)
            return self.add("select", condition, self.constant(0.0), other, there)
        named = {"add": "add", "mul": "multiply", "div": "divide"}.get(op, op)
        if named == op and op != "add" and op not in FUNCTIONS:
            raise _NoStepError
        return self.add(named, *(self.step(arg) for arg in args))

    def _power(self, base: Expr, exponent: Expr) -> int:
        number = exponent.payload if exponent.op == "number" else None
        if number is None or number.denominator != 1 or abs(number) > MOST_FACTORS:
            return self.add("power", self.step(base), self.step(exponent))
        square, left, product = self.step(base), abs(int(number)), None
        while left:
            if left % 2:
                product = square if product is None else self.add("multiply", product, square)
            left //= 2
            square = self.add("multiply", square, square) if left else square
        assert product is not None
        return self.add("divide", self.constant(1.0), product) if number < 0 else product
