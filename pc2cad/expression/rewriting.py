"""Walks through the part of trees of which something holds, and trees with it changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import islice

from pc2cad.expression.budget import is_counted
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import Expr, rebuild, walk


def among(roots: tuple[Expr, ...], holds: Callable[[Expr], bool]) -> list[Expr]:
    """Return once, operands first, the nodes of which something holds as it does of all above."""
    return walk(tuple(filter(holds, roots)), lambda node: tuple(filter(holds, node.args)))


def downwards(roots: tuple[Expr, ...], holds: Callable[[Expr], bool]) -> Iterator[Expr]:
    """Yield the same nodes from above: for who stops at the first of a kind, or needs no order."""
    seen, stack = set[Expr](), [*roots]
    while stack:
        node = stack.pop()
        if node not in seen and holds(node):
            seen.add(node)
            yield node
            stack += node.args


@lru_cache(maxsize=64)  # the same trees are asked about their roots by one after another
def nodes_of(roots: tuple[Expr, ...], op: str) -> tuple[Expr, ...]:
    """Return the nodes of one operation below some trees once, operands first."""
    return tuple([node for node in among(roots, lambda n: op in n.ops) if node.op == op])


def has_more(root: Expr, most: int, leaves: bool = True) -> bool:
    """Say whether a tree has more than `most` different nodes, leaves counted or not.

    Not many more are looked at.
    """
    nodes = downwards((root,), lambda node: leaves or bool(node.args))
    return next(islice(nodes, most, None), None) is not None


def rewrite(
    roots: tuple[Expr, ...], op: str, change: Callable[[Expr], Expr], keep: bool = False
) -> tuple[Expr, ...]:
    """Return the trees with every node of one operation changed, operands first.

    What becomes of the last nodes is remembered where it is to be kept: `change` is a function of a
    module then, and tells by the node alone.
    """
    within = tuple([root for root in roots if op in root.ops])
    keep = keep and not is_counted()
    if not within or (keep and _stay(within, op, change)):
        return roots

    def find(node: Expr, done: dict[Expr, Expr]) -> Expr:
        args = tuple([done[arg] for arg in node.args])
        moved = node if args == node.args else rebuild(node, args)
        return change(moved) if moved.op == op else moved

    known = _changed(op, change) if keep else Recent[Expr]()
    done = known.of(within, find, lambda node: None if op in node.ops else node)
    return tuple([done.get(root, root) for root in roots])


def _stay(roots: tuple[Expr, ...], op: str, change: Callable[[Expr], Expr]) -> bool:
    """Say whether no node of an operation changes: then nothing above them has to be looked at."""
    known = _changed(op, change)
    for node in nodes_of(roots, op):
        moved = known.get(node)
        if moved is None:
            moved = change(node)
            known.keep(node, moved)
        if moved is not node:
            return False
    return True


@lru_cache(maxsize=16)
def _changed(_op: str, _change: Callable[[Expr], Expr]) -> Recent[Expr]:
    """Return what is remembered of a change: later stages make it of the same trees."""
    return Recent()
