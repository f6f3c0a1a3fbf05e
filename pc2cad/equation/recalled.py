"""Values of parts of expressions from earlier readings.

A template is read again for each variant, and most names have the values that they had before: what
is made of these alone is not made again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Final

from pc2cad.equation.names import Curves, Listed, Named
from pc2cad.equation.points import Combination, Value
from pc2cad.equation.syntax import (
    BinaryNode,
    CallNode,
    NameNode,
    NegationNode,
    Node,
    NumberNode,
    PartNode,
    TripleNode,
)
from pc2cad.expression.budget import left, spend
from pc2cad.expression.carried import Carried

#: values by node and by the values of its names, and how many nodes of trees were made for each; so
#: many of these are kept
_read: Final[Carried[tuple[Value, int]]] = Carried(1 << 15)

#: functions that have names of their own, or make a choice
_READ_ANEW: Final = frozenset(("if", "sum", "diff"))


def recalled(
    node: Node, read: Callable[[Any], Value], names: Mapping[str, Named], curves: Curves
) -> Value:
    """Return what `read` makes of a node, from an earlier reading if its names had these values.

    What was made then counts again (see `budget`). Raises what `read` raises.
    """
    mentioned = _mentioned(node)
    if mentioned is None or not mentioned[1].isdisjoint(curves):
        return read(node)
    parts: list[object] = [node, read.__name__]
    for name in mentioned[0]:
        value = names.get(name)
        if isinstance(value, Combination):
            parts += value.x, value.y, value.z, value.weight
        elif isinstance(value, Listed):
            return read(node)
        else:
            parts.append(value)
    key = tuple(parts)
    known = _read.get(key)
    if known is None:
        before = left()
        value = read(node)
        known = value, before - left()
        _read.keep(key, known, known[1])
    else:
        spend(known[1] - 1)
    return known[0]


@lru_cache(maxsize=1024)
def _mentioned(node: Node) -> tuple[tuple[str, ...], frozenset[str]] | None:
    """Return the names that a node's value depends on, and the functions, or None.

    What has names of its own, or makes a choice, is always read.
    """
    names: dict[str, None] = {}
    calls, rest = set(), [node]
    while rest:
        part = rest.pop()
        # compared one by one, which is sooner than patterns
        if isinstance(part, NameNode):
            names[part.name] = None
        elif isinstance(part, BinaryNode):
            rest += part.left, part.right
        elif isinstance(part, CallNode) and part.name not in _READ_ANEW:
            calls.add(part.name)
            rest += part.operands
        elif isinstance(part, (NegationNode, PartNode)):
            rest.append(part.operand)
        elif isinstance(part, TripleNode):
            rest += part.operands
        elif not isinstance(part, NumberNode):
            return None
    return tuple(names), frozenset(calls)
