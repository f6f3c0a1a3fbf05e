"""What was found of the last nodes, so that work on chains of definitions stays linear."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
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

    def of(
        self,
        roots: tuple[Expr, ...],
        find: Callable[[Expr, dict[Expr, Found]], Found],
        settled: Callable[[Expr], Found | None],
        below: Callable[[Expr], tuple[Expr, ...]] = attrgetter("args"),
        worst: Found | None = None,
    ) -> dict[Expr, Found]:
        """Return what is known of trees: what is neither settled nor remembered is found, and kept.

        `find` is given a node and what is known of its operands (those that `below` gives). Below
        what is settled or remembered nothing is looked at: it is not in what is returned. What is
        above a node with the `worst` has that as well, and then nothing more is looked at.
        """
        recall, known, opened = self._found.get, dict[Expr, Found](), list[Expr]()
        # as `walk` does; None stands for the node that was opened last
        stack: list[Expr | None] = []
        pop, push, fresh = stack.pop, stack.append, roots
        while True:
            for arg in reversed(fresh):
                if arg not in known:
                    found = settled(arg)
                    if found is None:
                        found = recall(arg)
                        if found is None:
                            push(arg)
                            continue
                    known[arg] = found
                    if found is worst:
                        return self._spoilt(opened, known, found)
            while stack:
                node = pop()
                if node is None:
                    node = opened.pop()
                elif node in known:
                    continue
                elif fresh := below(node):
                    opened.append(node)
                    push(None)
                    break
                known[node] = found = find(node, known)
                if len(self._found) >= MOST:  # as `keep` does
                    self._found = {}
                self._found[node] = found
                if found is worst:
                    return self._spoilt(opened, known, found)
            else:
                return known

    def _spoilt(
        self, above: list[Expr], known: dict[Expr, Found], worst: Found
    ) -> dict[Expr, Found]:
        """Return what is known with all above something that has the worst."""
        for node in above:
            known[node] = worst
            self.keep(node, worst)
        return known


class Holding:
    """Remembers of which nodes something holds, and of all that are looked at below them."""

    def __init__(
        self, holds: Callable[[Expr], bool], below: Callable[[Expr], tuple[Expr, ...]]
    ) -> None:
        self._holds, self._below = holds, below
        self._known = Recent[bool]()

    def of(self, roots: tuple[Expr, ...]) -> bool:
        """Say whether it holds of trees and of all below them (that `below` gives)."""
        # a node is asked only when it holds of all below it
        known = self._known.of(
            roots, lambda node, _: self._holds(node), lambda _: None, self._below, worst=False
        )
        return False not in known.values()
