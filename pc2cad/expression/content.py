"""What a node of an expression tree holds, before it is frozen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pc2cad.expression.foreign import Foreign

if TYPE_CHECKING:
    from pc2cad.expression.tree import Expr


class Content(Foreign):
    """The places of a node (see `tree.Expr`), which it becomes when all are filled in."""

    __slots__ = ("__weakref__", "args", "op", "ops", "payload", "rank", "symbols", "value")

    op: str
    args: tuple[Expr, ...]
    payload: Any
    #: what orders nodes: from the content alone, so that every process sums and multiplies in the
    #: same order and rounds the same way; addresses would not
    rank: int
    symbols: frozenset[str]
    ops: frozenset[str]  # of the node and of all below it
    #: of a tree without symbols, once `scalar.evaluate` has found it: its value as a float
    value: float | None
