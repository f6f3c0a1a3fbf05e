"""What other libraries, and Python itself, may do with expressions.

NumPy's functions (`numpy.sin(u)`, `numpy.where(u < 0.5, a, b)`) and SymPy's give expressions;
those of `math` are told that they take numbers, and `u^2` that a power is written `**`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from typing import TYPE_CHECKING, Any

from pc2cad.errors import InputError

if TYPE_CHECKING:
    from pc2cad.expression.conditions import Condition
    from pc2cad.expression.tree import Expr, Number


class NotANumberError(InputError, TypeError):
    """An expression was taken for a number, or by what works on numbers only."""


class Foreign:
    """The part of an expression that others call; see the module."""

    __slots__ = ()

    def __lt__(self, other: Expr | Number) -> Condition:
        return _compared(self, "<", other)

    def __le__(self, other: Expr | Number) -> Condition:
        return _compared(self, "<=", other)

    def __gt__(self, other: Expr | Number) -> Condition:
        return _compared(self, ">", other)

    def __ge__(self, other: Expr | Number) -> Condition:
        return _compared(self, ">=", other)

    def __mod__(self, other: Expr | Number) -> Expr:
        return _called("mod", self, other)

    def __rmod__(self, other: Number) -> Expr:
        return _called("mod", other, self)

    def __floordiv__(self, other: Expr | Number) -> Expr:
        return _called("floor", self / other)  # type: ignore[operator]

    def __floor__(self) -> Expr:
        return _called("floor", self)

    def __ceil__(self) -> Expr:
        return -_called("floor", -_expr(self))

    def __xor__(self, other: object) -> Expr:
        raise NotANumberError(f"a power is written **, as in u**2: ^ has no meaning in Python "
                              f"({self!r} ^ {other!r})")  # fmt: skip

    __rxor__ = __xor__

    def __float__(self) -> float:
        from pc2cad.expression.scalar import evaluate
        from pc2cad.expression.tree import Expr

        assert isinstance(self, Expr)
        if self.symbols:
            raise NotANumberError(
                f"{self!r} is no number while {', '.join(sorted(self.symbols))} may take any "
                "value; functions of Python's math take numbers only: use those of pc2cad, such as "
                "pc.sin, or of NumPy"
            )
        return evaluate(self, {})

    def __int__(self) -> int:
        return int(float(self))

    def __round__(self, digits: int | None = None) -> float:
        return round(float(self), digits)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        name = ufunc.__name__
        if method != "__call__" or name not in UFUNCS or options.get("out") is not None:
            raise NotANumberError(f"numpy.{name} does not take expressions in u, v and w")
        return _elementwise(UFUNCS[name], inputs)

    def __array_function__(self, function: Any, _: Any, args: Any, options: Any) -> Any:
        if options or function.__name__ not in FUNCTIONS:
            raise NotANumberError(f"numpy.{function.__name__} does not take expressions")
        return _elementwise(FUNCTIONS[function.__name__], args)

    def __getattr__(self, name: str) -> Any:
        # what NumPy asks the entries of an array of objects for
        if name in UFUNCS and not name.startswith("_"):
            return partial(UFUNCS[name], self)
        raise AttributeError(f"an expression has no attribute {name}")

    def _sympy_(self) -> Any:
        from pc2cad.expression.sympy_bridge import to_sympy
        from pc2cad.expression.tree import Expr

        assert isinstance(self, Expr)
        return to_sympy(self)


def _expr(value: Any) -> Expr:
    from pc2cad.expression.tree import Expr, as_expr

    if isinstance(value, Expr):
        return value
    if type(value).__module__ == "numpy" and hasattr(value, "item"):
        value = value.item()
    return as_expr(value)


def _called(name: str, *args: Any) -> Expr:
    from pc2cad.expression.tree import call

    return call(name, *map(_expr, args))


def _compared(left: Any, operator: str, right: Any) -> Condition:
    from pc2cad.expression.conditions import compared

    return compared(_expr(left), operator, _expr(right))


def _elementwise(make: Callable[..., Any], inputs: tuple[Any, ...]) -> Any:
    """Return one result, or an array of them where an input is an array (or a list)."""
    import numpy as np

    if not any(isinstance(x, (list, tuple, np.ndarray)) for x in inputs):
        return make(*inputs)
    arrays = [np.asarray(x, dtype=object) for x in inputs]
    spread = np.broadcast(*arrays)
    results = np.empty(spread.size, dtype=object)
    for i, entries in enumerate(spread):
        results[i] = make(*entries)
    return results.reshape(spread.shape)


def _where(condition: Any, a: Any, b: Any) -> Expr:
    from pc2cad.expression.conditions import as_condition

    return as_condition(condition).choose(_expr(a), _expr(b))


def _clip(x: Any, low: Any, high: Any) -> Expr:
    x = x if low is None else _called("max", x, low)
    return _expr(x if high is None else _called("min", x, high))


def _logarithm(base: int, x: Any) -> Expr:
    return _called("log", x) / _called("log", base)


def _degrees(x: Any) -> Expr:
    from pc2cad.expression.tree import PI

    return _expr(x) * (180 / PI)


def _radians(x: Any) -> Expr:
    from pc2cad.expression.tree import PI

    return _expr(x) * (PI / 180)


def _joined(name: str, *args: Any) -> Any:
    from pc2cad.expression.conditions import as_condition, both, either

    if name == "not":
        return ~as_condition(args[0])
    return reduce(both if name == "and" else either, map(as_condition, args))


#: NumPy's name of a function -> what it makes of expressions
UFUNCS: dict[str, Callable[..., Any]] = {
    **{n: partial(_called, n) for n in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp")},
    **{n: partial(_called, n) for n in ("log", "sqrt", "floor", "sign")},
    **{f"arc{n}": partial(_called, f"a{n}") for n in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arctan2": partial(_called, "atan2"), "mod": partial(_called, "mod"),
    "remainder": partial(_called, "mod"), "absolute": partial(_called, "abs"),
    "fabs": partial(_called, "abs"), "minimum": partial(_called, "min"), "clip": _clip,
    "maximum": partial(_called, "max"), "fmin": partial(_called, "min"),
    "fmax": partial(_called, "max"),
    "hypot": lambda x, y: _called("sqrt", _expr(x) ** 2 + _expr(y) ** 2),
    "add": lambda x, y: _expr(x) + _expr(y), "subtract": lambda x, y: _expr(x) - _expr(y),
    "multiply": lambda x, y: _expr(x) * _expr(y), "divide": lambda x, y: _expr(x) / _expr(y),
    "true_divide": lambda x, y: _expr(x) / _expr(y), "power": lambda x, y: _expr(x) ** _expr(y),
    "float_power": lambda x, y: _expr(x) ** _expr(y), "negative": lambda x: -_expr(x),
    "positive": _expr, "square": lambda x: _expr(x) ** 2, "reciprocal": lambda x: 1 / _expr(x),
    "conjugate": _expr, "ceil": lambda x: -_called("floor", -_expr(x)),
    "floor_divide": lambda x, y: _called("floor", _expr(x) / _expr(y)),
    "log2": partial(_logarithm, 2), "log10": partial(_logarithm, 10),
    "log1p": lambda x: _called("log", 1 + _expr(x)), "expm1": lambda x: _called("exp", x) - 1,
    "exp2": lambda x: _expr(2) ** _expr(x), "deg2rad": _radians, "radians": _radians,
    "rad2deg": _degrees, "degrees": _degrees,
    "less": lambda x, y: _compared(x, "<", y), "greater": lambda x, y: _compared(x, ">", y),
    "less_equal": lambda x, y: _compared(x, "<=", y),
    "greater_equal": lambda x, y: _compared(x, ">=", y),
    "logical_and": partial(_joined, "and"), "logical_or": partial(_joined, "or"),
    "logical_not": partial(_joined, "not"), "bitwise_and": partial(_joined, "and"),
    "bitwise_or": partial(_joined, "or"), "invert": partial(_joined, "not"),
}  # fmt: skip
#: the same of functions that are no universal functions
FUNCTIONS: dict[str, Callable[..., Any]] = {"where": _where, "clip": _clip}
