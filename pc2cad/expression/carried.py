"""What one build leaves to the next: values of trees that occur again, as many as fit.

Variants of a template have most of their trees in common: of a channel whose wall varies, the guide
and all that moves along it. Values are kept of trees that occurred in an earlier build, and of no
others, so that a single build keeps none. They are found by the tree and by every bit of the places
that it was taken at, and are what would be worked out again: no bit depends on earlier builds.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Set
from typing import Final, Generic, TypeVar

from pc2cad.expression.tree import Expr

Value = TypeVar("Value")
#: trees of earlier builds that are remembered
MOST_TREES: Final = 1 << 15


class _Trees:
    """Which trees occurred in this build, and which in one before."""

    def __init__(self) -> None:
        self.met: set[Expr] = set()
        self.earlier: set[Expr] = set()


_trees: Final = _Trees()


def begin_build() -> None:
    """Let what was met so far be that of earlier builds."""
    met, _trees.met = _trees.met, set()
    if len(_trees.earlier) > MOST_TREES:
        _trees.earlier = met  # not cleared: another thread may be reading it
    else:
        _trees.earlier |= met


def earlier_trees() -> Set[Expr]:
    """Return the trees that occurred in earlier builds, until the next one begins."""
    return _trees.earlier


def meet(trees: Iterable[Expr]) -> None:
    """Note that trees occur in this build."""
    _trees.met.update(trees)


class Carried(Generic[Value]):
    """Values by tree and place: those asked for last, of so many bytes, and as many older ones."""

    def __init__(self, most: int) -> None:
        self._most, self._bytes = most, 0
        self._recent: dict[Hashable, tuple[Value, int]] = {}
        self._older: dict[Hashable, tuple[Value, int]] = {}

    def get(self, key: Hashable) -> Value | None:
        """Return the value of a key, None where there is none any more."""
        found = self._recent.get(key)
        if found is None:
            found = self._older.get(key)
            if found is None:
                return None
            self.keep(key, *found)
        return found[0]

    def keep(self, key: Hashable, value: Value, size: int) -> None:
        """Keep a value of a size in bytes."""
        if self._bytes + size > self._most:
            self._older, self._recent, self._bytes = self._recent, {}, 0
        self._recent[key] = value, size
        self._bytes += size
