"""Trees as flat tables, for pickles: a chain of a thousand functions is no recursion there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pc2cad.expression.tree import Expr, intern, walk

#: per node: operation, places of its operands in the table, payload
Table = tuple[tuple[str, tuple[int, ...], Any], ...]


def stored(root: Expr) -> tuple[Callable[[Table], Expr], tuple[Table]]:
    """Return what makes the tree again, as `pickle` asks for it."""
    places: dict[Expr, int] = {}
    rows = []
    for node in walk((root,)):
        rows.append((node.op, tuple(places[arg] for arg in node.args), node.payload))
        places[node] = len(places)
    return restored, (tuple(rows),)


def restored(rows: Table) -> Expr:
    """Return the tree of a table; it is the very same one where that still exists."""
    nodes: list[Expr] = []
    for op, places, payload in rows:
        nodes.append(intern(op, tuple(nodes[i] for i in places), payload))
    return nodes[-1]
