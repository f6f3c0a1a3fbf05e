"""The sets of symbols and of operations that nodes have, and what their names count as.

They are a few, of many nodes: equal ones are one object, and what was united before is found.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final
from zlib import crc32

Names = frozenset[str]
_sets: Final[dict[Names, Names]] = {}


@lru_cache(maxsize=1 << 12)
def union(*sets: Names) -> Names:
    """Return the union of some sets, as the one set of its content."""
    found = Names().union(*sets)
    return _sets.setdefault(found, found)


@lru_cache(maxsize=1 << 12)
def union_with(name: str, *sets: Names) -> Names:
    """Return the union of a name and some sets, as the one set of its content."""
    found = Names((name,)).union(*sets)
    return _sets.setdefault(found, found)


def checksum(op: str, payload: object) -> int:
    """Return what an operation with a payload counts as in a node's rank."""
    return crc32(f"{op} {payload!r}".encode())


def number_checksum(numerator: int, denominator: int) -> int:
    """Return what `checksum` does of a number, whose text takes long to make."""
    return crc32(b"number Fraction(%d, %d)" % (numerator, denominator))


@lru_cache(maxsize=1 << 8)
def plain_checksum(op: str) -> int:
    """Return what an operation without a payload counts as."""
    return checksum(op, None)
