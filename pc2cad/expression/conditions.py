"""Conditions: what `if` chooses by, made of comparisons, and, or and not.

A comparison is kept as a tree that is not negative where it holds (x >= y), or where it does not
(x < y); joined conditions choose one after the other. A condition is no tree itself, and has no
truth of its own: it has one wherever the parameters have values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pc2cad.errors import InputError
from pc2cad.expression.foreign import Foreign
from pc2cad.expression.tree import Expr, call

COMPARISONS: Final = ("<", "<=", ">", ">=")


class NoTruthError(InputError, TypeError):
    """A condition was asked whether it holds before its parameters have values."""


@dataclass(frozen=True, eq=False)
class Condition:
    """A condition; `choose(a, b)` is a where it holds, else b.

    Conditions are joined by ``&`` (and), ``|`` (or) and ``~`` (not).
    """

    choose: Callable[[Expr, Expr], Expr]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        return Foreign.__array_ufunc__(self, ufunc, method, *inputs, **options)  # type: ignore[arg-type]

    def __array_function__(self, function: Any, kinds: Any, args: Any, options: Any) -> Any:
        return Foreign.__array_function__(self, function, kinds, args, options)  # type: ignore[arg-type]

    def __and__(self, other: Condition | bool) -> Condition:
        return both(self, as_condition(other))

    def __or__(self, other: Condition | bool) -> Condition:
        return either(self, as_condition(other))

    def __invert__(self) -> Condition:
        return Condition(lambda a, b: self.choose(b, a))

    __rand__, __ror__ = __and__, __or__

    def __bool__(self) -> bool:
        raise NoTruthError(
            "a condition on u, v or w has no truth of its own: write where(condition, a, b) "
            "instead of 'if', minimum and maximum instead of min and max, and & | ~ with brackets "
            "round comparisons for 'and', 'or', 'not'"
        )


def as_condition(value: Condition | bool) -> Condition:
    """Return a condition as it is, and a truth as one that always, or never, holds."""
    if isinstance(value, Condition):
        return value
    if type(value).__name__ not in ("bool", "bool_"):
        raise InputError(f"a condition is made of < <= > >=, and {value!r} was given")
    return Condition(lambda a, b: a if value else b)


def compared(left: Expr, operator: str, right: Expr) -> Condition:
    """Return the condition of one of `COMPARISONS`."""
    if operator in (">=", "<"):
        first, second = left, right
    else:
        first, second = right, left
    holds = Condition(lambda a, b: call("where", first - second, a, b))
    return holds if operator in (">=", "<=") else ~holds


def both(first: Condition, second: Condition) -> Condition:
    """Return the condition that two others hold."""
    return Condition(lambda a, b: first.choose(second.choose(a, b), b))


def either(first: Condition, second: Condition) -> Condition:
    """Return the condition that at least one of two others holds."""
    return Condition(lambda a, b: first.choose(a, second.choose(a, b)))
