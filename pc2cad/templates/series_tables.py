"""The table [fourier] of a template: series of two angles, R(theta, phi)."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Final

from pc2cad.expression.scalar import evaluate
from pc2cad.expression.waves import LARGEST_WAVE, MOST_WAVES, Series, series
from pc2cad.templates.channel_tables import attempt
from pc2cad.templates.tables import Tables, shown

#: series of one template
MOST_SERIES: Final = 100


def read_series(tables: Tables, name: str, raw: object) -> None:
    """Define NAME(theta, phi) for a series."""
    count = len(tables.table("fourier"))
    if count > MOST_SERIES:
        tables.fail("[fourier]", f"has {count} series, and at most {MOST_SERIES} are read")
    key = f"[fourier] {shown(name)}"
    if not isinstance(raw, dict):
        tables.fail(key, "is a table, { periods = 5, cos = [[m, n, c], …], sin = [[m, n, c], …] }")
        return
    tables.check_keys(raw, ("periods", "cos", "sin"), f"{key} ")
    if not ("cos" in raw or "sin" in raw):
        tables.fail(key, "needs waves, cos = [[m, n, c], …] or sin = [[m, n, c], …]")
    periods = _whole(tables, f"{key} periods", raw.get("periods", 1), (1, LARGEST_WAVE))
    rows = [_waves(tables, f"{key} {part}", raw.get(part, [])) for part in ("cos", "sin")]
    if sum(map(len, rows)) > MOST_WAVES:
        tables.fail(key, f"has {sum(map(len, rows))} waves, and at most {MOST_WAVES} are read")
    tables.define(key, name, None, function=True)
    tables.curves[name] = Series(attempt(tables, key, lambda: series(periods, *rows)))


def _waves(tables: Tables, key: str, raw: object) -> list[tuple[int, int, Fraction]]:
    """Return the waves of one kind, (m, n, coefficient) each."""
    if not isinstance(raw, list) or any(not isinstance(r, list) or len(r) != 3 for r in raw):
        tables.fail(key, "is a list of waves, [[m, n, c], …]")
    assert isinstance(raw, list)
    if len(raw) > MOST_WAVES:
        tables.fail(key, f"has {len(raw)} waves, and at most {MOST_WAVES} are read")
    return [_wave(tables, f"{key}[{i}]", row) for i, row in enumerate(raw)]


def _wave(tables: Tables, key: str, row: Sequence[Any]) -> tuple[int, int, Fraction]:
    limits = (-LARGEST_WAVE, LARGEST_WAVE)
    m, n = (_whole(tables, f"{key} {what}", x, limits) for what, x in zip("mn", row, strict=False))
    value = row[2]
    if isinstance(value, str):
        # one of the parameters is taken as it stands
        tree = tables.constant(key, value)
        value = tree.payload if tree.op == "number" else evaluate(tree, {})
    return m, n, attempt(tables, key, lambda: tables.scalar(key, value).payload)


def _whole(tables: Tables, key: str, raw: object, limits: tuple[int, int]) -> int:
    """Return a whole number between limits, both included."""
    whole = isinstance(raw, (int, Fraction)) and not isinstance(raw, bool) and raw == int(raw)
    if not whole or not limits[0] <= raw <= limits[1]:  # type: ignore[operator]
        return tables.fail(key, f"is a whole number from {limits[0]} to {limits[1]}")  # type: ignore[no-any-return]
    return int(raw)  # type: ignore[call-overload,no-any-return]
