"""det J as a tree."""

from __future__ import annotations

from pc2cad.expression.tree import Expr


def determinant(columns: tuple[tuple[Expr, ...], ...]) -> Expr:
    """Return the determinant of three columns as a tree."""
    a, b, c = columns
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
