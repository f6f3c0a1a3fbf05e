"""The scalar functions of the language: domains, folding, derivatives.

One table serves the parser (names, arity), the tree (folding of exact values), the calculus
(derivatives) and the evaluation (NumPy's name of the function).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import floor, isqrt
from typing import Final

from pc2cad.expression.tree import ONE, PI, ZERO, Expr, ValueDomainError, call, mul, number

Args = tuple[Expr, ...]


@dataclass(frozen=True, eq=False)
class Function:
    """A scalar function: its arity, its NumPy name and its partial derivatives."""

    arity: int
    numpy_name: str
    #: partial derivatives with respect to each operand
    partials: Callable[[Args], tuple[Expr, ...]]


def _square(a: Expr) -> Expr:
    return a**2


def _chosen(condition: Expr) -> tuple[Expr, Expr]:
    """Return 1 and 0 where a number is not negative, else 0 and 1."""
    return call("where", condition, ONE, ZERO), call("where", condition, ZERO, ONE)


FUNCTIONS: Final[dict[str, Function]] = {
    "sin": Function(1, "sin", lambda a: (call("cos", a[0]),)),
    "cos": Function(1, "cos", lambda a: (-call("sin", a[0]),)),
    "tan": Function(1, "tan", lambda a: (1 + _square(call("tan", a[0])),)),
    "asin": Function(1, "arcsin", lambda a: (1 / call("sqrt", 1 - _square(a[0])),)),
    "acos": Function(1, "arccos", lambda a: (-1 / call("sqrt", 1 - _square(a[0])),)),
    "atan": Function(1, "arctan", lambda a: (1 / (1 + _square(a[0])),)),
    "atan2": Function(
        2,
        "arctan2",
        lambda a: (
            a[1] / (_square(a[0]) + _square(a[1])),
            -a[0] / (_square(a[0]) + _square(a[1])),
        ),
    ),
    "sinh": Function(1, "sinh", lambda a: (call("cosh", a[0]),)),
    "cosh": Function(1, "cosh", lambda a: (call("sinh", a[0]),)),
    "tanh": Function(1, "tanh", lambda a: (1 - _square(call("tanh", a[0])),)),
    "asinh": Function(1, "arcsinh", lambda a: (1 / call("sqrt", 1 + _square(a[0])),)),
    "acosh": Function(1, "arccosh", lambda a: (1 / call("sqrt", _square(a[0]) - 1),)),
    "atanh": Function(1, "arctanh", lambda a: (1 / (1 - _square(a[0])),)),
    "exp": Function(1, "exp", lambda a: (call("exp", a[0]),)),
    "log": Function(1, "log", lambda a: (1 / a[0],)),
    "sqrt": Function(1, "sqrt", lambda a: (1 / (2 * call("sqrt", a[0])),)),
    "abs": Function(1, "abs", lambda a: (call("sign", a[0]),)),
    "sign": Function(1, "sign", lambda a: (ZERO,)),
    "floor": Function(1, "floor", lambda a: (ZERO,)),
    # x - m floor(x/m): in [0, m) for m > 0
    "mod": Function(2, "mod", lambda a: (ONE, -call("floor", a[0] / a[1]))),
    "min": Function(2, "minimum", lambda a: _chosen(a[1] - a[0])),
    "max": Function(2, "maximum", lambda a: _chosen(a[0] - a[1])),
    # b where a condition of the form a >= 0 holds, else c: what if(...) is made of
    "where": Function(3, "", lambda a: (ZERO, *_chosen(a[0]))),
}
#: the names a user may write as functions of scalars
PUBLIC_FUNCTIONS: Final = tuple(name for name in FUNCTIONS if name != "where")
#: those that take two operands or more, one by one
REPEATED: Final = ("min", "max")

_AT_ZERO: Final = {
    **dict.fromkeys(("sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh"), ZERO),
    **dict.fromkeys(("sqrt", "abs", "sign", "floor"), ZERO),
    **dict.fromkeys(("cos", "cosh", "exp"), ONE),
}
#: cos(r·pi) for r in [0, 2): the values that are rational
_COSINES: Final[dict[Fraction, Fraction | int]] = {
    Fraction(0): 1, Fraction(1, 3): Fraction(1, 2), Fraction(1, 2): 0,
    Fraction(2, 3): Fraction(-1, 2), Fraction(1): -1, Fraction(4, 3): Fraction(-1, 2),
    Fraction(3, 2): 0, Fraction(5, 3): Fraction(1, 2),
}  # fmt: skip


def fold(name: str, args: Args) -> Expr | Args:
    """Return an exact value of the call where one is known, else its (normalised) operands.

    Raises ValueDomainError for constant operands outside the function's real domain.
    """
    (a, *_) = args
    if name == "atan2":
        return ZERO if a is ZERO and args[1] is ONE else args
    if len(args) > 1:
        return _fold_choice(name, args)
    if a is ZERO and name in _AT_ZERO:
        return _AT_ZERO[name]
    if name in ("sin", "cos"):
        return _fold_turn(name, a)
    if a.op == "number":
        return _fold_number(name, a)
    if a.op == "neg" and name in ("tan", "atan", "sinh", "tanh", "asin", "asinh", "atanh"):
        return -call(name, a.args[0])
    if a.op == "neg" and name in ("cosh", "abs"):
        return call(name, a.args[0])
    return args


def _fold_choice(name: str, args: Args) -> Expr | Args:
    """Fold what chooses between operands, or divides by one."""
    a, b = args[:2]
    numbers = a.op == b.op == "number"
    if name == "where":
        if b is args[2]:
            return b
        return (b if a.payload >= 0 else args[2]) if a.op == "number" else args
    if name == "mod":
        if b.op == "number" and b.payload <= 0:
            raise ValueDomainError(f"mod(x, {b.payload}) needs a positive number behind the comma")
        return number(a.payload % b.payload) if numbers else args
    if a is b:
        return a
    return (a if (a.payload <= b.payload) == (name == "min") else b) if numbers else args


def _fold_number(name: str, a: Expr) -> Expr | Args:
    value: Fraction = a.payload
    if name == "abs":
        return number(abs(value))
    if name == "sign":
        return number((value > 0) - (value < 0))
    if name == "floor":
        return number(floor(value))
    if name == "log" and value == 1:
        return ZERO
    if name == "sqrt" and value > 0:
        top, bottom = isqrt(value.numerator), isqrt(value.denominator)
        if top * top == value.numerator and bottom * bottom == value.denominator:
            return number(Fraction(top, bottom))
    outside = (
        (name == "sqrt" and value < 0)
        or (name == "log" and value <= 0)
        or (name in ("asin", "acos") and abs(value) > 1)
        or (name == "atanh" and abs(value) >= 1)
        or (name == "acosh" and value < 1)
    )
    if outside:
        raise ValueDomainError(f"{name}({value}) is not a real number")
    # what is too small to be told from zero evaluates to zero
    if (name == "exp" and value > 138) or (name in ("sinh", "cosh") and abs(value) > 138):
        raise ValueDomainError(f"{name}({value}) is outside the range 1e-60 to 1e60")
    return (a,)


def _fold_turn(name: str, a: Expr) -> Expr | Args:
    """Fold sin and cos: whole turns are taken out, rational values are exact, signs go out."""
    from pc2cad.expression.normal_form import split_turns

    turns, rest = split_turns(a)
    turns = turns % 2 if turns else turns
    if rest is ZERO:
        shifted = turns if name == "cos" else (turns - Fraction(1, 2)) % 2
        if shifted in _COSINES:
            return number(_COSINES[shifted])
        return (mul(number(turns), PI),)
    if turns.numerator >= turns.denominator:  # cos(x + pi) = -cos x, sin(x + pi) = -sin x
        return -call(name, rest + number(turns - 1) * PI)
    if not turns and rest.op == "neg":
        return -call("sin", rest.args[0]) if name == "sin" else call("cos", rest.args[0])
    return (rest + number(turns) * PI if turns else rest,)
