"""Frozen, interned expression trees over the reals.

Equal trees are the same object, so that identity decides structural equality, common
sub-expressions are stored (and evaluated) once, and a proof such as M(u,0,w) = M(u,1,w) is often a
comparison of two references. Numbers are exact fractions; nothing is rounded in this module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from math import gcd
from typing import Any, Final, NamedTuple

from pc2cad.expression.budget import counted, spend
from pc2cad.expression.content import Content
from pc2cad.expression.exact import LARGEST_CONSTANT as LARGEST_CONSTANT
from pc2cad.expression.exact import ValueDomainError as ValueDomainError
from pc2cad.expression.exact import exact, exact_power, held
from pc2cad.expression.interning import Interned
from pc2cad.expression.name_sets import (
    checksum,
    number_checksum,
    plain_checksum,
    union,
    union_with,
)

Number = int | float | Fraction

LARGEST_EXPONENT: Final = 1000

_interned: Interned[Expr] = Interned()
_places: Final = _interned.places  # looked up here: a call less for each node

#: what each number has
_NONE: Final = union()
_NUMBER: Final = union_with("number")

#: order of continuity of what is one analytic function but for rounding: its breaks do not count
ANALYTIC: Final = 99


class Layout(NamedTuple):
    """The payload of a ``pieces`` node: everything but the argument and the coefficients."""

    breaks: tuple[Fraction, ...]
    #: coefficients per piece
    width: int
    #: order of continuity at the breaks; `ANALYTIC` where nothing changes there
    smoothness: int
    #: repeats with the period breaks[-1] - breaks[0]; else the end pieces go on
    closed: bool

    def rebuilt(self, args: tuple[Expr, ...]) -> Expr:
        """Return such pieces of other operands."""
        rows = tuple(args[i : i + self.width] for i in range(1, len(args), self.width))
        return pieces(args[0], self.breaks, rows, self.smoothness, self.closed)


class Expr(Content):
    """A node: an operation, its operands, and a payload for leaves.

    ``op`` is ``"number"`` (payload: Fraction), ``"constant"`` (payload: ``pi`` or ``e``),
    ``"symbol"`` (payload: name), one of ``add mul div pow neg``, a function name, ``"pieces"``
    (see `pieces`) or ``"fourier"`` (see `waves.fourier`). Build nodes with functions, not directly.
    """

    __slots__ = ()

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("expression trees are frozen")

    def __deepcopy__(self, _: object) -> Expr:
        return self  # equal trees are one object

    def __reduce__(self) -> tuple[Callable[..., Expr], tuple[Any, ...]]:
        from pc2cad.expression.storing import stored

        return stored(self)

    def __add__(self, other: Expr | Number) -> Expr:
        if type(other) is Expr:
            return add(self, other)
        return add(self, as_expr(other)) if _is_number(other) else NotImplemented

    def __radd__(self, other: Number) -> Expr:
        return add(as_expr(other), self)

    def __sub__(self, other: Expr | Number) -> Expr:
        if type(other) is Expr:
            return add(self, neg(other))
        return add(self, neg(as_expr(other))) if _is_number(other) else NotImplemented

    def __rsub__(self, other: Number) -> Expr:
        return add(as_expr(other), neg(self))

    def __mul__(self, other: Expr | Number) -> Expr:
        if type(other) is Expr:
            return mul(self, other)
        return mul(self, as_expr(other)) if _is_number(other) else NotImplemented

    def __rmul__(self, other: Number) -> Expr:
        return mul(as_expr(other), self)

    def __truediv__(self, other: Expr | Number) -> Expr:
        if type(other) is Expr:
            return div(self, other)
        return div(self, as_expr(other)) if _is_number(other) else NotImplemented

    def __rtruediv__(self, other: Number) -> Expr:
        return div(as_expr(other), self)

    def __pow__(self, other: Expr | Number) -> Expr:
        if type(other) is Expr:
            return power(self, other)
        return power(self, as_expr(other)) if _is_number(other) else NotImplemented

    def __rpow__(self, other: Number) -> Expr:
        return power(as_expr(other), self)

    def __neg__(self) -> Expr:
        return neg(self)

    def __abs__(self) -> Expr:
        return call("abs", self)

    def __repr__(self) -> str:
        from pc2cad.expression.printing import as_text

        return as_text(self)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, Fraction)) and not isinstance(value, bool)


def intern(op: str, args: tuple[Expr, ...], payload: Any = None) -> Expr:
    """Return the one node of this content as it is, nothing folded."""
    # fractions are slow to hash and to compare
    key = payload.as_integer_ratio() if op == "number" else (op, args, payload)
    if (rest := counted()) is not None:
        rest[0] -= 1 + len(args)
        if rest[0] < 0:
            spend(0)  # which complains
    if (place := _places.get(key)) is not None and (known := place()) is not None:
        return known
    return _made(key, op, args, payload)


def _made(key: tuple[Any, ...], op: str, args: tuple[Expr, ...], payload: Any) -> Expr:
    """Return a new node, and let it be the one of its key."""
    if op == "number":
        symbols, ops, rank = _NONE, _NUMBER, hash((number_checksum(*key),))
    else:
        own = plain_checksum(op) if payload is None else checksum(op, payload)
        if len(args) == 2:
            a, b = args
            symbols = a.symbols if a.symbols is b.symbols else union(a.symbols, b.symbols)
            ops, rank = union_with(op, a.ops, b.ops), hash((own, a.rank, b.rank))
        else:
            symbols = union_with(payload) if op == "symbol" else union(*{x.symbols for x in args})
            ops = union_with(op, *{x.ops for x in args})
            rank = hash((own, *[x.rank for x in args]))
    made: Any = Content()
    made.op, made.args, made.payload = op, args, payload
    made.symbols, made.ops, made.rank = symbols, ops, rank
    made.value = None
    # three times as fast as to go round what freezes it
    made.__class__ = Expr
    return _interned.keep(key, made)


def number(value: Number) -> Expr:
    """Return the exact number; a float means the decimal it prints as (0.1 is 1/10)."""
    if type(value) is not Fraction and type(value) is not int:
        value = exact(value)
    key = value.as_integer_ratio()
    if (place := _places.get(key)) is None or (known := place()) is None:
        known = _made(key, "number", (), held(value))
    spend(0)
    return known


def _ratio(numerator: int, denominator: int) -> Expr:
    """Return the number that a ratio is; the denominator is positive.

    What is known already is found without a new fraction, which takes three times as long.
    """
    common = gcd(numerator, denominator)
    key = numerator // common, denominator // common
    if (place := _places.get(key)) is None or (known := place()) is None:
        known = _made(key, "number", (), held(Fraction(*key)))
    spend(0)
    return known


def as_expr(value: Expr | Number) -> Expr:
    """Return `value` as a tree; numbers become exact constants."""
    return value if isinstance(value, Expr) else number(value)


def symbol(name: str) -> Expr:
    """Return the symbol `name` (a parameter of the box or of the template)."""
    return intern("symbol", (), name)


PI: Final = intern("constant", (), "pi")
E: Final = intern("constant", (), "e")
ZERO: Final = number(0)
ONE: Final = number(1)
_HALF: Final = number(Fraction(1, 2))


def add(a: Expr, b: Expr) -> Expr:
    """Return a + b."""
    if a is ZERO:
        return b
    if b is ZERO:
        return a
    if a.op == "number" and b.op == "number":
        (n, d), (m, e) = a.payload.as_integer_ratio(), b.payload.as_integer_ratio()
        return _ratio(n * e + m * d, d * e)
    if (b.op == "neg" and b.args[0] is a) or (a.op == "neg" and a.args[0] is b):
        return ZERO
    return intern("add", (a, b))


def neg(a: Expr) -> Expr:
    """Return -a."""
    if a.op == "number":
        n, d = a.payload.as_integer_ratio()
        return _ratio(-n, d)
    if a.op == "neg":
        return a.args[0]
    return intern("neg", (a,))


def mul(a: Expr, b: Expr) -> Expr:
    """Return a·b."""
    if a is ZERO or b is ZERO:
        return ZERO
    if a is ONE:
        return b
    if b is ONE:
        return a
    if a.op == "number" and b.op == "number":
        (n, d), (m, e) = a.payload.as_integer_ratio(), b.payload.as_integer_ratio()
        return _ratio(n * m, d * e)
    if _is_negative(a):
        return neg(mul(neg(a), b))
    if _is_negative(b):
        return neg(mul(a, neg(b)))
    return intern("mul", (a, b))


def _is_negative(a: Expr) -> bool:
    """Say whether a sign stands before the term: signs are kept outside products and quotients."""
    return a.op == "neg" or (a.op == "number" and a.payload.numerator < 0)


def div(a: Expr, b: Expr) -> Expr:
    """Return a/b; division by the constant 0 raises ValueDomainError."""
    if b is ZERO:
        raise ValueDomainError("division by zero")
    if a is ZERO or b is ONE:
        return a
    if b.op == "number":
        if a.op == "number":
            return number(a.payload / b.payload)
        return mul(number(1 / b.payload), a)
    if _is_negative(a):
        return neg(div(neg(a), b))
    if _is_negative(b):
        return neg(div(a, neg(b)))
    return intern("div", (a, b))


def power(a: Expr, b: Expr) -> Expr:
    """Return a**b; 0**0 is 1 only for an exponent written as the constant 0."""
    if b.op == "number":
        if b is ZERO or b is ONE:
            return ONE if b is ZERO else a
        if b is _HALF:
            return call("sqrt", a)
        exponent: Fraction = b.payload
        if abs(exponent.numerator) > LARGEST_EXPONENT * exponent.denominator:
            raise ValueDomainError(f"the exponent {exponent} is larger than {LARGEST_EXPONENT}")
        if a.op == "number" and (folded := exact_power(a.payload, exponent)) is not None:
            return number(folded)
    return intern("pow", (a, b))


def call(name: str, *args: Expr) -> Expr:
    """Return the function `name` of `functions.FUNCTIONS` applied to `args`."""
    from pc2cad.expression.functions import fold

    folded = fold(name, args)
    return folded if isinstance(folded, Expr) else intern(name, folded)


def pieces(
    arg: Expr,
    breaks: tuple[Fraction, ...],
    rows: tuple[tuple[Expr, ...], ...],
    smoothness: int,
    closed: bool = True,
) -> Expr:
    """Return a piecewise polynomial of `arg`.

    ``rows[i]`` holds the ascending coefficients on [breaks[i], breaks[i+1]] in the local variable
    arg - breaks[i]; all rows have one length. Coefficients may be functions themselves: rows of
    one are the pieces of any piecewise function. `smoothness` is the order of continuity (0: value,
    1: first derivative, -1: not even the value) at every break. A closed one has the period
    breaks[-1] - breaks[0], and its smoothness at the closing break as well; an open one goes on
    with its end pieces.
    """
    width = len(rows[0])
    if all(c is rows[0][0] for (c, *_) in rows) and all(c is ZERO for row in rows for c in row[1:]):
        return rows[0][0]
    layout = Layout(breaks, width, smoothness, closed)
    if arg.op == "number":
        index, local = row_at(layout, arg.payload)
        return polynomial(rows[index], number(local))
    flat = tuple(c for row in rows for c in row)
    spend(4 * len(flat))
    return intern("pieces", (arg, *flat), layout)


def row_at(layout: Layout, t: Fraction) -> tuple[int, Fraction]:
    """Return the piece at a value of the argument, and the local variable there."""
    breaks = layout.breaks
    if layout.closed:
        t = (t - breaks[0]) % (breaks[-1] - breaks[0]) + breaks[0]
    index = max((i for i in range(len(breaks) - 1) if breaks[i] <= t), default=0)
    return index, t - breaks[index]


def polynomial(row: tuple[Expr, ...], t: Expr) -> Expr:
    """Return the polynomial of t with ascending coefficients."""
    value = ZERO
    for coefficient in reversed(row):
        value = value * t + coefficient
    return value


def piece_rows(node: Expr) -> tuple[tuple[Expr, ...], ...]:
    """Return the coefficient rows of a ``pieces`` node."""
    width, flat = node.payload.width, node.args[1:]
    return tuple(flat[i : i + width] for i in range(0, len(flat), width))


def rebuild(node: Expr, args: tuple[Expr, ...]) -> Expr:
    """Return the node's operation applied to other operands, folded anew."""
    if (build := BUILDERS.get(node.op)) is not None:
        return build(*args)
    return call(node.op, *args) if node.payload is None else node.payload.rebuilt(args)


#: what makes nodes of operations that have no payload and are no functions
BUILDERS: Final[dict[str, Callable[..., Expr]]] = {
    "add": add, "mul": mul, "div": div, "pow": power, "neg": neg,
}  # fmt: skip


def walk(
    roots: tuple[Expr, ...], below: Callable[[Expr], tuple[Expr, ...]] | None = None
) -> list[Expr]:
    """Return every node below `roots` once, operands (those that `below` gives) before it."""
    seen, opened, found = set[Expr](), list[Expr](), list[Expr]()
    stack: list[Expr | None] = [*reversed(roots)]  # None: the node that was opened last
    pop, push, done, give = stack.pop, stack.append, seen.add, found.append
    while stack:
        node = pop()
        if node is None:
            node = opened.pop()
        elif node in seen:
            continue
        elif args := node.args if below is None else below(node):
            opened.append(node)
            push(None)
            for arg in reversed(args):
                if arg not in seen:
                    push(arg)
            continue
        done(node)
        give(node)
    return found


def substitute(roots: tuple[Expr, ...], values: dict[str, Expr]) -> tuple[Expr, ...]:
    """Return the trees with symbols replaced and everything folded anew."""
    from pc2cad.expression.substitution import substituted

    return substituted(roots, values)


def ops_of(roots: Iterable[Expr]) -> frozenset[str]:
    """Return the operations of all nodes below some."""
    return frozenset[str]().union(*(root.ops for root in roots))
