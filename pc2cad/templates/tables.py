"""Access to the tables of a template file: scalars, expressions, names, and exact complaints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any, Final

from pc2cad.equation.language import FUNCTION_NAMES, RESERVED_NAMES, Named, nearest, read_expression
from pc2cad.equation.points import Combination, Value, kind_of
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, substitute
from pc2cad.templates.header import TemplateError
from pc2cad.trust.names import is_identifier, visible

#: entries of one table, points or radii of one list
MOST_ENTRIES: Final = 2000


class Tables:
    """The tables of one file, and the names that are known so far."""

    def __init__(self, file: str, data: dict[str, Any]) -> None:
        self.file = file
        self.data = data
        self.names: dict[str, Named] = {}
        #: functions that [curves] defines
        self.curves: dict[str, Any] = {}
        #: parameters -> their values, or their defaults while none are given
        self.defaults: dict[str, Expr] = {}
        #: parameters whose values were asked for while they were symbols
        self.consumed: set[str] = set()

    def fail(self, key: str, message: str) -> Any:
        """Raise TemplateError for a key."""
        raise TemplateError(f"{self.file}: {key}: {message}")

    def check_keys(self, table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
        """Complain of a key that is not known."""
        known = tuple(known)
        for key in table:
            if key not in known:
                hint = nearest(key, known) or f"; known here: {', '.join(known)}"
                self.fail(where + shown(key), f"unknown key{hint}")

    def text(self, key: str) -> str:
        """Return a text of the file's first level."""
        value = self.data.get(key, "")
        if not isinstance(value, str):
            self.fail(key, "must be a text in quotes")
        return str(value)

    def table(self, key: str) -> dict[str, Any]:
        """Return a table of the file, empty where there is none."""
        value = self.data.get(key, {})
        if not isinstance(value, dict):
            self.fail(key, f"must be a table, [{key}]")
        if len(value) > MOST_ENTRIES:
            self.fail(f"[{key}]", f"has {len(value)} entries, and at most {MOST_ENTRIES} are read")
        return dict(value)

    def scalar(self, key: str, raw: object, more: Mapping[str, Value] | None = None) -> Expr:
        """Read a number or the text of a scalar expression."""
        if isinstance(raw, str):
            value = self.expression(key, raw, more)
            if not isinstance(value, Expr):
                self.fail(key, f"must be a scalar, and {kind_of(value).value} was given")
            return value  # type: ignore[return-value]
        if isinstance(raw, bool) or not isinstance(raw, (int, float, Fraction)):
            self.fail(key, "must be a number or an expression in quotes")
        if isinstance(raw, float) and not math.isfinite(raw):
            self.fail(key, f"{raw} is not a finite number")
        try:
            return number(raw)  # type: ignore[arg-type]
        except InputError as error:
            return self.fail(key, str(error))  # type: ignore[no-any-return]

    def expression(self, key: str, text: object, more: Mapping[str, Value] | None = None) -> Value:
        """Read the text of an expression, with more names known than elsewhere."""
        if not isinstance(text, str):
            return self.fail(key, "must be an expression in quotes")  # type: ignore[no-any-return]
        try:
            return read_expression(text, {**self.names, **(more or {})}, self.curves)
        except InputError as error:
            return self.fail(key, str(error))  # type: ignore[no-any-return]

    def define(self, key: str, name: str, value: Named | None, function: bool = False) -> None:
        """Add a name, which must be new, well formed and not reserved."""
        if not is_identifier(name):
            self.fail(key, f"'{shown(name)}' is not a name (a letter, then letters, digits, _)")
        if name in RESERVED_NAMES or (function and name in FUNCTION_NAMES):
            self.fail(key, f"the name {name} is reserved")
        if name in self.names or name in self.curves:
            self.fail(key, f"the name {name} is defined twice")
        if value is not None:
            self.names[name] = value

    def constant(self, key: str, raw: object) -> Expr:
        """Read a scalar that has to be a number once the parameters have their values."""
        (tree,) = self.valued((self.scalar(key, raw),))
        if tree.symbols:
            self.fail(key, f"must be constant, and depends on {', '.join(sorted(tree.symbols))}")
        return tree

    def real(self, key: str, raw: object) -> float:
        """Read a number, its parameters at their values, as a float."""
        value = evaluate(self.constant(key, raw), {})
        if not math.isfinite(value):
            self.fail(key, "is not a finite number")
        return value

    def rows(self, key: str, raw: object, width: int) -> list[list[Any]]:
        """Return a list of lists of one length, such as the points of a curve."""
        plain = isinstance(raw, list) and all(isinstance(r, list) and len(r) == width for r in raw)
        if not plain:
            shown_row = "[x, y, z]" if width == 3 else "[x, y]"
            self.fail(key, f"is a list of points, [{shown_row}, …]")
        return self.few(key, raw)

    def few(self, key: str, raw: object) -> list[Any]:
        """Return a list that is no longer than any is read."""
        found = raw if isinstance(raw, list) else [raw]
        if len(found) > MOST_ENTRIES:
            self.fail(key, f"has {len(found)} entries, and at most {MOST_ENTRIES} are read")
        return list(found)

    def bound(self, value: Value) -> Value:
        """Return a value with the parameters at their values."""
        if isinstance(value, Combination):
            self.valued((*value.coordinates, value.weight))
            return value.substitute(self.defaults)
        return self.valued((value,))[0]

    def valued(self, trees: tuple[Expr, ...]) -> tuple[Expr, ...]:
        """Return trees with the parameters at their values, and note which ones these are."""
        for tree in trees:
            self.consumed |= tree.symbols & self.defaults.keys()
        return substitute(trees, self.defaults)


def written(raw: object) -> str:
    """Return a value of the file as text, numbers as decimals."""
    return repr(number(raw)) if isinstance(raw, Fraction) else str(raw)


def shown(key: str) -> str:
    """Make a key safe for a one-line message."""
    return key if key.isprintable() and len(key) <= 80 else repr(visible(key))[:80]
