"""What was found of the last nodes, so that work on chains of definitions stays linear."""

from __future__ import annotations

from typing import Final, Generic, TypeVar

from pc2cad.expression.tree import Expr

Found = TypeVar("Found")
#: nodes that are remembered
MOST: Final = 4096


class Recent(Generic[Found]):
    """Remembers something of up to `MOST` nodes, then begins anew."""

    def __init__(self) -> None:
        self._found: dict[Expr, Found] = {}

    def get(self, node: Expr) -> Found | None:
        """Return what is remembered of a node, None for nothing."""
        return self._found.get(node)

    def keep(self, node: Expr, found: Found) -> None:
        """Remember something of a node."""
        if len(self._found) >= MOST:
            self._found = {}  # not cleared: another thread may be reading it
        self._found[node] = found
