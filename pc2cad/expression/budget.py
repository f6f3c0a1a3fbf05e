"""How large the trees of one reading may grow.

A short text can stand for a huge tree: a fourth derivative of a product of fourth derivatives, a
curve of a thousand arcs within itself. All nodes are made at one place, which counts them here
while a template is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

from pc2cad.errors import InputError

#: nodes and operands that one reading of a template may make (the largest shipped one: 4,300)
MOST_NODES: Final = 450_000


class TooLargeError(InputError):
    """The trees of a template grow beyond what is ever worked with."""


_left: ContextVar[list[int] | None] = ContextVar("_left", default=None)
#: returns what may still be made, None where nodes are not counted
counted: Final = _left.get


@contextmanager
def bounded(nodes: int = MOST_NODES) -> Iterator[None]:
    """Let what is read within the block make so many nodes; within another such block, as it says.

    Raises TooLargeError where a node is made beyond that.
    """
    if _left.get() is not None:
        yield
        return
    token = _left.set([nodes])
    try:
        yield
    finally:
        _left.reset(token)


def is_counted() -> bool:
    """Say whether nodes are counted: then what was made before is made, and counted, again."""
    return counted() is not None


def spend(operands: int) -> None:
    """Count a node with so many operands."""
    rest = counted()
    if rest is not None:
        rest[0] -= 1 + operands
        if rest[0] < 0:
            raise TooLargeError(
                "the equations written out grow beyond all measure here; look for derivatives of "
                "derivatives, or for curves within curves, in [let]"
            )
