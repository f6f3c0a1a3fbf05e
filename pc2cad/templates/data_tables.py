"""The tables of a template that hold data: lists of [data] and functions of [tables]."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, Final

from pc2cad.equation.language import Listed
from pc2cad.equation.tables import function
from pc2cad.expression.table_rules import KINDS, MOST_VALUES
from pc2cad.expression.tree import Expr
from pc2cad.templates.channel_tables import attempt
from pc2cad.templates.tables import Tables, shown

_KEYS: Final = ("at", "values", "points", "kind", "ends", "periodic")


def read_list(tables: Tables, name: str, raw: object) -> Listed:
    """Define an entry of [data]: a list, or a list of lists, of numbers or expressions."""
    key = f"[data] {shown(name)}"
    if not isinstance(raw, list) or not raw:
        return tables.fail(key, "is a list, [1, 2, …], or a list of lists")  # type: ignore[no-any-return]
    plain = not isinstance(raw[0], list)
    if any(isinstance(row, list) == plain for row in raw):
        tables.fail(key, "is a list of numbers, or one of lists, and not of both")
    rows = [raw] if plain else raw
    if sum(len(row) for row in rows) > MOST_VALUES:
        tables.fail(key, f"has more than {MOST_VALUES} entries")
    listed = Listed(
        tuple(tuple(tables.scalar(_place(key, plain, i, j), x) for j, x in enumerate(row))
              for i, row in enumerate(rows)),
        plain,
    )  # fmt: skip
    tables.define(key, name, listed)
    return listed


def _place(key: str, plain: bool, i: int, j: int) -> str:
    return f"{key}[{j}]" if plain else f"{key}[{i}, {j}]"


def read_table(tables: Tables, name: str, raw: object) -> None:
    """Define an entry of [tables]: a function through values or points."""
    key = f"[tables] {shown(name)}"
    if not isinstance(raw, dict):
        tables.fail(key, "is a table, { at = […], values = […], kind = … }")
        return
    tables.check_keys(raw, _KEYS, f"{key}.")
    if "at" not in raw:
        tables.fail(key, "needs the places of its values, at = […]")
    if ("values" in raw) == ("points" in raw):
        tables.fail(key, "needs either values or points")
    kind = raw.get("kind", "cubic")
    if kind not in KINDS:
        tables.fail(f"{key}.kind", f"is one of {', '.join(KINDS)}")
    tables.define(key, name, None, function=True)
    what = "points" if "points" in raw else "values"
    at = raw["at"]
    nested = isinstance(at, list) and bool(at) and isinstance(at[0], list)
    budget = [MOST_VALUES]
    places = _numbers(tables, f"{key}.at", at if nested else [at], budget, 2)
    depth = len(places) + (what == "points")
    net = _numbers(tables, f"{key}.{what}", raw[what], budget, depth)
    ends = _numbers(tables, f"{key}.ends", raw["ends"], budget, 1 + (what == "points")) \
        if "ends" in raw else None  # fmt: skip
    turns = _periodic(tables, f"{key}.periodic", raw.get("periodic", False), len(places))
    if what == "points" and not _are_triples(net, depth):
        tables.fail(f"{key}.points", "are lists of three coordinates, [x, y, z]")
    made = attempt(tables, key, lambda: function(name, places, net, kind, turns, ends))
    tables.curves[name] = made


def _numbers(tables: Tables, key: str, raw: object, budget: list[int], depth: int) -> Any:
    """Return lists within lists of exact numbers, so many levels deep."""
    if depth == 0:
        budget[0] -= 1
        if budget[0] < 0:
            tables.fail(key, f"a table has at most {MOST_VALUES} numbers")
        if isinstance(raw, (int, Fraction)) and not isinstance(raw, bool):
            return Fraction(raw)
        tree: Expr = tables.constant(key, raw)
        return tree.payload if tree.op == "number" else Fraction(tables.real(key, raw))
    if not isinstance(raw, list):
        return tables.fail(key, "is a list, and one of lists where there are two lists of places")
    return [_numbers(tables, f"{key}[{i}]", x, budget, depth - 1) for i, x in enumerate(raw)]


def _are_triples(net: Any, depth: int) -> bool:
    return len(net) == 3 if depth == 1 else all(_are_triples(inner, depth - 1) for inner in net)


def _periodic(tables: Tables, key: str, raw: object, count: int) -> list[bool]:
    found = raw if isinstance(raw, list) else [raw] * count
    if len(found) != count or not all(isinstance(x, bool) for x in found):
        tables.fail(key, "is true or false, or a list of them, one for each list of places")
    return list(found)
