"""Sums of points in the M of a template: M1 + M2 - D, and S1*(1 - w) + S2*w.

The second is the first for any D, with the cones M1 = S1*(1 - w) + D*w and M2 = S2*w + D*(1 - w):
every point of the template may be their apex.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pc2cad.equation.point_equation import Written
from pc2cad.equation.points import Combination, Kind, kind_of
from pc2cad.equation.syntax import BinaryNode, NameNode, Node, NumberNode, parse
from pc2cad.expression.tree import ONE, symbol


def written_sums(text: str, known: Mapping[str, Combination]) -> tuple[Written, ...]:
    """Return what a text that is a sum of named points may be taken for."""
    return tuple(_read(parse(text), known))


def _read(node: Node, known: Mapping[str, Combination]) -> Iterator[Written]:
    match node:
        case BinaryNode(_, "-", BinaryNode(_, "+", NameNode(_, a), NameNode(_, b)), NameNode(_, k)):
            if all(name in known for name in (a, b, k)):
                trees = [known[name].coordinates for name in (a, b, k)]
                yield Written(f"{a} + {b} - {k}", (a, b), k, trees[0], trees[1], trees[2])
        case BinaryNode(_, "+", left, right):
            first, second = _weighted(left), _weighted(right)
            if first and second and {first[1], second[1]} == {False, True}:
                ends = (first[0], second[0]) if second[1] else (second[0], first[0])
                if all(name in known for name in ends):
                    yield from _cones(*ends, known)


def _weighted(node: Node) -> tuple[str, bool] | None:
    """Return the name of a point, and whether its weight is w and not 1 - w."""
    match node:
        case BinaryNode(_, "*", NameNode(_, name), weight) if _is_weight(weight):
            return name, isinstance(weight, NameNode)
        case BinaryNode(_, "*", weight, NameNode(_, name)) if _is_weight(weight):
            return name, isinstance(weight, NameNode)
    return None


def _is_weight(node: Node) -> bool:
    """Say whether a node is w or 1 - w."""
    match node:
        case NameNode(_, "w"):
            return True
        case BinaryNode(_, "-", NumberNode(_, one), NameNode(_, "w")):
            return one == 1
    return False


def _cones(low: str, high: str, known: Mapping[str, Combination]) -> Iterator[Written]:
    w = symbol("w")
    text = f"{low}*(1 - w) + {high}*w"
    for name, apex in known.items():
        fixed = not frozenset().union(*(tree.symbols for tree in apex.coordinates))
        if fixed and kind_of(apex) is Kind.POINT:
            first = known[low] * (ONE - w) + apex * w
            second = known[high] * w + apex * (ONE - w)
            yield Written(
                text, (f"the cone {name}-{low}", f"the cone {name}-{high}"), name,
                first.coordinates, second.coordinates, apex.coordinates,
            )  # fmt: skip
