"""Walks through the part of trees of which something holds, and trees with it changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from pc2cad.expression.tree import Expr, rebuild, walk


def among(roots: tuple[Expr, ...], holds: Callable[[Expr], bool]) -> Iterator[Expr]:
    """Yield once, operands first, the nodes of which something holds as it does of all above."""
    return walk(tuple(filter(holds, roots)), lambda node: tuple(filter(holds, node.args)))


def rewrite(roots: tuple[Expr, ...], op: str, change: Callable[[Expr], Expr]) -> tuple[Expr, ...]:
    """Return the trees with every node of one operation changed, operands first."""
    done: dict[Expr, Expr] = {}
    within = tuple([root for root in roots if op in root.ops])
    for node in walk(within, lambda n: tuple([arg for arg in n.args if op in arg.ops])):
        args = tuple([done.get(arg, arg) for arg in node.args])
        moved = node if args == node.args else rebuild(node, args)
        done[node] = change(moved) if moved.op == op else moved
    return tuple([done.get(root, root) for root in roots])
