"""Formulas: steps of plain operations on numbers, for programs that know neither M nor its fields.

What a tree is made of is written as such steps, one after another; formulas call each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.functions import FUNCTIONS as KNOWN
from pc2cad.expression.operations import operands
from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, Expr, Layout, call, number, piece_rows, walk
from pc2cad.expression.waves import written_out

#: functions that a step may be, by what the language calls them
FUNCTIONS: Final = (
    "sin", "cos", "tan", "asin", "acos", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
    "abs", "sign", "floor", "min", "max",
)  # fmt: skip
#: whole exponents up to which a power is written as products: programs take others of positive
#: numbers alone
MOST_FACTORS: Final = 16
#: steps of one formula: what takes them needs a time that goes with their square
MOST_STEPS: Final = 8000
_PLAIN: Final[Mapping[str, Callable[..., Any]]] = {
    "add": np.add, "subtract": np.subtract, "multiply": np.multiply, "divide": np.divide,
    "power": np.power, "select": lambda a, b, c, d: np.where(a < b, c, d),
    **{name: getattr(np, KNOWN[name].numpy_name) for name in FUNCTIONS},
}  # fmt: skip


class NoFormulaError(Exception):
    """Something is no formula, or one of too many steps; the message says why, after "since"."""


@dataclass(frozen=True)
class Step:
    """One operation on earlier steps, by their numbers.

    ``input`` (the one of that number), ``constant``, ``add``, ``subtract``, ``multiply``,
    ``divide``, ``power``, ``select`` (c if a < b, else d), one of `FUNCTIONS`, ``call`` of another
    formula, or ``output`` (the one of that number, of a call).
    """

    operation: str
    operands: tuple[int, ...] = ()
    value: float = 0.0
    formula: Formula | None = None


@dataclass(frozen=True, eq=False)
class Formula:
    """Numbers in, numbers out."""

    name: str
    inputs: tuple[str, ...]
    steps: tuple[Step, ...] = field(repr=False)
    #: the steps that are given, by the names they are given under
    outputs: Mapping[str, int]

    def __call__(self, *given: Array) -> list[Array]:
        """Return the outputs (n,) for inputs (n,); where there is none, nan or inf."""
        found: list[list[Any]] = []
        with np.errstate(all="ignore"):
            for step in self.steps:
                operands = [found[k][0] for k in step.operands]
                if step.operation == "input":
                    found.append([given[int(step.value)]])
                elif step.operation == "constant":
                    found.append([np.float64(step.value)])
                elif step.operation == "output":
                    found.append([found[step.operands[0]][int(step.value)]])
                elif step.formula is not None:
                    found.append(step.formula(*operands))
                else:
                    found.append([_PLAIN[step.operation](*operands)])
        shape = np.broadcast_shapes(*(np.shape(column) for column in given))
        return [np.broadcast_to(found[k][0], shape) for k in self.outputs.values()]


class Writer:
    """A formula while it is written; `add` and the rest return numbers of steps."""

    def __init__(self, name: str, inputs: Sequence[str]) -> None:
        self._name, self._inputs = name, tuple(inputs)
        self._steps = [Step("input", (), float(k)) for k in range(len(self._inputs))]
        self._constants: dict[float, int] = {}

    def made(self, **outputs: int) -> Formula:
        """Return the formula with what it gives."""
        return Formula(self._name, self._inputs, tuple(self._steps), outputs)

    def add(self, operation: str, *operands: int) -> int:
        """Add an operation on earlier steps; raise NoFormulaError after too many."""
        return self._put(Step(operation, operands))

    def constant(self, value: float) -> int:
        """Add a number, once."""
        if value not in self._constants:
            self._constants[value] = self._put(Step("constant", (), value))
        return self._constants[value]

    def call(self, formula: Formula, *operands: int) -> tuple[int, ...]:
        """Call another formula; return its outputs."""
        at = self._put(Step("call", operands, 0.0, formula))
        return tuple(
            self._put(Step("output", (at,), float(k))) for k in range(len(formula.outputs))
        )

    def total(self, terms: Sequence[tuple[float, int]], start: float = 0.0) -> int:
        """Add up multiples of steps, and a number."""
        total = self.constant(start)
        for factor, term in terms:
            total = self.add("add", total, self.add("multiply", self.constant(factor), term))
        return total

    def trees(self, roots: tuple[Expr, ...], names: Mapping[str, int]) -> list[int]:
        """Write trees whose symbols are steps; raise NoFormulaError."""
        known: dict[Expr, int] = {}
        roots = tuple(_plain(root) for root in roots)
        for node in walk(roots, operands):  # operands first: long sums are deep
            if _is_table(node):
                (known[node],) = self.call(_table(node), known[node.args[0]])
            elif node.symbols and node.op != "pieces":
                known[node] = self._made(node, names, known)
            elif node.symbols:
                known[node] = self.pieces(node, known)
            else:
                known[node] = self.constant(evaluate(node, {}))
        return [known[root] for root in roots]

    def pieces(self, tree: Expr, known: Mapping[Expr, int]) -> int:
        """Write a polynomial in pieces: its start and coefficients by the breaks, then its sum."""
        layout: Layout = tree.payload
        breaks, place = [float(b) for b in layout.breaks], known[tree.args[0]]
        if layout.closed:
            period = self.constant(breaks[-1] - breaks[0])
            past = self.add("subtract", place, self.constant(breaks[0]))
            turns = self.add("floor", self.add("divide", past, period))
            place = self.add("subtract", place, self.add("multiply", turns, period))
        rows = piece_rows(tree)
        starts = self._chosen(place, breaks, [self.constant(b) for b in breaks[:-1]])
        along, total = self.add("subtract", place, starts), self.constant(0.0)
        for k in reversed(range(layout.width)):
            own = self._chosen(place, breaks, [known[row[k]] for row in rows])
            total = own if k == layout.width - 1 else self.add(
                "add", self.add("multiply", total, along), own
            )  # fmt: skip
        return total

    def _put(self, step: Step) -> int:
        if len(self._steps) >= MOST_STEPS:
            raise NoFormulaError(f"the formula {self._name} takes more than {MOST_STEPS} steps")
        self._steps.append(step)
        return len(self._steps) - 1

    def _made(self, tree: Expr, names: Mapping[str, int], known: Mapping[Expr, int]) -> int:
        op, args = tree.op, [known[arg] for arg in tree.args]
        if op == "symbol":
            return names[str(tree.payload)]
        if op == "within":  # an argument, and what is known of it
            return args[0]
        if op == "pow":
            return self._power(tree, args)
        if op == "neg":
            return self.add("subtract", self.constant(0.0), args[0])
        if op == "mod":
            turns = self.add("floor", self.add("divide", *args))
            return self.add("subtract", args[0], self.add("multiply", args[1], turns))
        if op == "where":
            return self.add("select", args[0], self.constant(0.0), args[2], args[1])
        named = {"mul": "multiply", "div": "divide"}.get(op, op)
        if named not in _PLAIN:
            raise NoFormulaError(f"functions of such files have no {op}")
        return self.add(named, *args)

    def _power(self, tree: Expr, args: list[int]) -> int:
        exponent = tree.args[1]
        power = exponent.payload if exponent.op == "number" else None
        if power is None or power.denominator != 1 or abs(power) > MOST_FACTORS:
            return self.add("power", *args)
        square, left, product = args[0], abs(int(power)), None
        while left:
            if left % 2:
                product = square if product is None else self.add("multiply", product, square)
            left //= 2
            square = self.add("multiply", square, square) if left else square
        assert product is not None
        return self.add("divide", self.constant(1.0), product) if power < 0 else product

    def _chosen(self, place: int, breaks: Sequence[float], values: Sequence[int]) -> int:
        """Return the one of some values that is in force at a place, by halves."""
        if len({*values}) == 1:
            return values[0]
        half = len(values) // 2
        below = self._chosen(place, breaks[: half + 1], values[:half])
        above = self._chosen(place, breaks[half:], values[half:])
        return self.add("select", place, self.constant(breaks[half]), below, above)


def _is_table(tree: Expr) -> bool:
    return tree.op == "pieces" and bool(tree.symbols) and len(operands(tree)) == 1


@lru_cache(maxsize=1024)  # M, its steps and fields look up the same ones
def _table(tree: Expr) -> Formula:
    """Return a polynomial in pieces whose coefficients are numbers, of its argument."""
    writer = Writer("table", ("place",))
    known = {c: writer.constant(evaluate(c, {})) for c in tree.args[1:]}
    return writer.made(value=writer.pieces(tree, {**known, tree.args[0]: 0}))


def _plain(root: Expr) -> Expr:
    """Return a tree without operations that steps have not, where others make them up."""
    for op, change in _CHANGES.items():
        (root,) = rewrite((root,), op, change)
    return root


def _asinh(tree: Expr) -> Expr:
    x = call("abs", tree.args[0])
    return call("sign", tree.args[0]) * call("log", x + call("sqrt", x**2 + 1))


_CHANGES: Final[Mapping[str, Callable[[Expr], Expr]]] = {
    "atan": lambda tree: call("atan2", tree.args[0], ONE),
    "asinh": _asinh,
    "acosh": lambda tree: call("log", tree.args[0] + call("sqrt", tree.args[0] ** 2 - 1)),
    "atanh": lambda tree: call("log", (1 + tree.args[0]) / (1 - tree.args[0])) * number(0.5),
    "fourier": lambda tree: written_out(tree.payload, *tree.args),
}
