"""Fields of several bodies as formulas of the place: at every place that of the body it is in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.booleans import original
from pc2cad.csg.moving import places
from pc2cad.csg.regions import Piece
from pc2cad.domain.formulas import Formula, NoFormulaError, Writer
from pc2cad.equation.fields import COORDINATES
from pc2cad.errors import InputError
from pc2cad.part import Body
from pc2cad.sampling.formulas import TOLERANCE, FieldFormula, Inversions
from pc2cad.sampling.newton import lesser
from pc2cad.templates.bodies import Pattern, Tree
from pc2cad.templates.patterns import Placement


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A body, or a copy of it, that the result has places of."""

    name: str
    body: Body
    place: Placement
    known: Inversions
    #: how many leaves are copies of the same body: places that are looked at are shared out
    copies: int

    def there(self, writer: Writer) -> list[int]:
        """Write the place as the body itself has it."""
        turn, offset = self.place.turn, self.place.offset
        return [
            writer.total([(float(turn[i, k]), i) for i in range(3)], float(-offset @ turn[:, k]))
            for k in range(3)
        ]

    def samples(self) -> tuple[Array, Array]:
        """Return points in space, and the parameters of the unit box that they have."""
        local = self.known.inverse.places()[:: self.copies]
        points = self.body.checked.map.points(*local.T)
        return points @ self.place.turn.T + self.place.offset, local


def field_formulas(
    result: Tree,
    parts: Mapping[str, Body],
    pieces: Callable[[], Sequence[Piece]],
    names: Sequence[str],
) -> dict[str, FieldFormula]:
    """Return scalar fields as formulas of the place.

    Raises InputError where a body of the result has no such field, where bodies overlap whose
    fields differ, and where M is not inverted so.
    """
    known = {name: Inversions(body.checked.analysis) for name, body in parts.items()}
    lying, kept = dict(places(result)), [*_kept(result)]
    copies = Counter(original(name) for name in kept)
    leaves = [
        _Leaf(name, parts[body], lying[name], known[body], copies[body])
        for name, body in zip(kept, map(original, kept), strict=True)
    ]
    try:
        return {name: _field(name, leaves, pieces) for name in names}
    except NoFormulaError as error:
        raise InputError(
            f"fields of several bodies go into files as functions, and this is none: {error}"
        ) from None


def _field(
    name: str, leaves: Sequence[_Leaf], pieces: Callable[[], Sequence[Piece]]
) -> FieldFormula:
    for leaf in leaves:
        if all(field.name != name for field in leaf.body.equation.fields):
            raise InputError(f"the body {original(leaf.name)} has no field '{name:.80}'")
    own = [leaf.known.field(name) for leaf in leaves]
    if len(leaves) > 1:
        _check_apart(name, leaves, pieces())
    writer = Writer(name, COORDINATES)
    best, least = list[int](), -1
    for leaf, field in zip(leaves, own, strict=True):
        there = leaf.there(writer)
        value = writer.call(field.formula, *there)
        if len(leaves) == 1:
            best = [*value]
            continue
        gap = writer.call(leaf.known.inverse.formula, *there)[3]
        least, best = lesser(writer, gap, value, least, best) if best else (gap, [*value])
    formula = writer.made(value=best[0])
    if len(leaves) == 1:
        return FieldFormula(formula, own[0].deviation, own[0].places)
    return _held(name, leaves, formula)


def _held(name: str, leaves: Sequence[_Leaf], formula: Formula) -> FieldFormula:
    """Return a formula with what it is off at places of one body alone; raise NoFormulaError."""
    worst, count = 0.0, 0
    for leaf in leaves:
        points, local = leaf.samples()
        alone = np.ones(len(points), dtype=bool)
        for other in leaves:
            if other is not leaf:
                before = (points - other.place.offset) @ other.place.turn
                inverse = other.known.inverse
                alone &= inverse.formula(*before.T)[3] > (1e3 * inverse.near) ** 2
        if alone.any():
            off, span = leaf.known.off(name, formula, points[alone], local[alone])
            if not off <= TOLERANCE * span:
                raise NoFormulaError(
                    f"the formula of {name} is {off:.2g} off, and may be {TOLERANCE * span:.2g}"
                )
            worst, count = max(worst, off), count + int(alone.sum())
    return FieldFormula(formula, worst, count)


def _check_apart(name: str, leaves: Sequence[_Leaf], pieces: Sequence[Piece]) -> None:
    """Raise InputError where bodies overlap with fields that are not one formula of the place."""
    own = {leaf.name: leaf for leaf in leaves}
    for piece in pieces:
        inside = [own[body] for body in sorted(piece.bodies) if body in own]
        trees = {leaf.body.equation.field(name).components for leaf in inside}
        moved = any(not np.array_equal(leaf.place.turn, np.eye(3)) or leaf.place.offset.any()
                    for leaf in inside)  # fmt: skip
        symbols = set().union(*(tree.symbols for row in trees for tree in row))
        if len(inside) > 1 and (len(trees) > 1 or moved or not symbols <= {*COORDINATES}):
            raise InputError(
                f"{' and '.join(leaf.name for leaf in inside)} overlap, and their fields {name} "
                "differ: cut one of them from the other in the result, or give them the same "
                "formula of x, y and z"
            )


def _kept(tree: Tree, mark: str = "") -> Iterator[str]:
    """Yield the bodies and copies that a result has places of: not what is cut away."""
    if isinstance(tree, str):
        yield f"{tree}{mark}"
    elif isinstance(tree, Pattern):
        for k in range(len(tree.copies)):
            yield from _kept(tree.operand, f"[{k}]{mark}")
    else:
        kept = tree.operands if tree.kind in ("union", "intersect") else tree.operands[:1]
        for operand in kept:
            yield from _kept(operand, mark)
