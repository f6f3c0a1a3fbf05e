"""The analyse stage: a point equation in, its boundary complex out.

Input: PointEquation. Output: Analysis (the map in local coordinates, the breaks of its directions
and the boundary complex), by the answers of `map_questions`.

It has two steps, `sample_sides` and then `derive`: a map without finite values is refused before
anything is asked of it, one without an orientation (`solidity.orientation`) before its boundary.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import product

from pc2cad.domain.cusps import with_cusps, with_joints
from pc2cad.domain.map import Mapping3, local_map
from pc2cad.domain.map_questions import MapQuestions
from pc2cad.domain.pieces import span_at
from pc2cad.domain.splits import folds, shifts
from pc2cad.equation.point_equation import LayersError, PointEquation
from pc2cad.errors import NotASolidError
from pc2cad.expression.breaks import SAME_POSITION, Break, find_breaks
from pc2cad.expression.tree import Expr
from pc2cad.geometry.scale import Scale
from pc2cad.topology.cells import (
    IDENTITY,
    Labels,
    SideKey,
    boundary_patches,
)
from pc2cad.topology.complex import BoundaryComplex
from pc2cad.topology.quotient import derive_boundary, derive_layers


@dataclass(frozen=True, eq=False)
class SampledSides:
    """M over the unit box, where it breaks, and samples of its six sides, all of them finite."""

    equation: PointEquation
    map: Mapping3
    #: all breaks of u, v and w in local coordinates, creases and smoother ones alike
    breaks: tuple[tuple[Break, ...], ...]
    #: ascending limits of the pieces of each direction: 0, creases, 1
    bounds: tuple[tuple[float, ...], ...]
    questions: MapQuestions


@dataclass(frozen=True)
class Analysis:
    """What the later stages know of the map: its trees, its pieces and its boundary."""

    equation: PointEquation
    map: Mapping3
    #: all breaks of u, v and w in local coordinates, creases and smoother ones alike
    breaks: tuple[tuple[Break, ...], ...]
    #: ascending limits of the pieces of each direction: 0, creases, 1
    bounds: tuple[tuple[float, ...], ...]
    boundary: BoundaryComplex
    #: the same with the faces between layers; the boundary itself where there are none
    complex: BoundaryComplex
    #: of the samples of the boundary
    scale: Scale
    #: limits between pieces across which plane faces are not joined to one, per direction
    apart: tuple[tuple[float, ...], ...] = ((), (), ())

    @property
    def size(self) -> float:
        """Diagonal of the box round the boundary's samples, model units."""
        return self.scale.size

    def span(self, direction: int, position: int) -> tuple[float, float]:
        """Return the local interval of a cell position (of no length for a limit)."""
        return span_at(self.bounds[direction], position)


def analyse(equation: PointEquation) -> Analysis:
    """Derive the boundary of a point equation's image; raise NotASolidError where it has none.

    Nothing is said of det J here; see `checked.check_map` for all that a solid needs.
    """
    return derive(sample_sides(equation))


def sample_sides(equation: PointEquation) -> SampledSides:
    """Return the map over the unit box, looked at on its sides; raise MapNotFiniteError."""
    mapping = local_map(equation)
    breaks = with_cusps(with_joints(find_breaks(mapping.coordinates), mapping), mapping)
    bounds = tuple(
        (0.0, *(b.position for b in row if b.smoothness == 0 and 0 < b.position < 1), 1.0)
        for row in breaks
    )
    return _sampled(equation, mapping, breaks, bounds)


def _sampled(
    equation: PointEquation,
    mapping: Mapping3,
    breaks: tuple[tuple[Break, ...], ...],
    bounds: tuple[tuple[float, ...], ...],
) -> SampledSides:
    """Return the map with samples of its sides in pieces."""
    questions = MapQuestions(mapping, bounds, _labels(equation, bounds))
    return SampledSides(equation, mapping, breaks, bounds, questions)


def derive(sides: SampledSides, known: BoundaryComplex | None = None) -> Analysis:
    """Return the boundary of sampled sides; raise NotASolidError where they do not close.

    It may be `known` (`family_sides`). Where sides coincide after a shift or fold, they are cut.
    """
    try:
        boundary = known or derive_boundary(sides.questions, sides.questions.labels)
        faces = [face.patch for face in boundary.faces]
        cut = _cut(sides, shifts(sides.map, faces, sides.questions.scale, boundary))
    except NotASolidError:
        cut = _cut(sides, _all_cuts(sides))
        if cut is sides:
            raise
    if cut is not sides:
        sides = cut
        boundary = derive_boundary(sides.questions, sides.questions.labels)
    layers = _layered(sides.equation, boundary, sides.questions)
    return Analysis(
        sides.equation, sides.map, sides.breaks, sides.bounds, boundary, layers,
        sides.questions.scale,
    )  # fmt: skip


def recut(analysis: Analysis, places: tuple[set[Fraction], ...]) -> Analysis:
    """Return the same solid with directions cut at some more places, or as it is."""
    equation = analysis.equation
    whole = _sampled(equation, analysis.map, analysis.breaks, analysis.bounds)
    sides = _cut(whole, places)
    if sides is whole:
        return analysis
    boundary = derive_boundary(sides.questions, sides.questions.labels)
    layers = _layered(equation, boundary, sides.questions)
    return replace(analysis, bounds=sides.bounds, boundary=boundary, complex=layers)


def _all_cuts(sides: SampledSides) -> tuple[set[Fraction], ...]:
    """Return where directions may have to be cut, if the boundary does not close without."""
    u, v, w = (len(row) - 1 for row in sides.bounds)
    patches, scale = boundary_patches((u, v, w)), sides.questions.scale
    found = shifts(sides.map, patches, scale), folds(sides.map, patches, sides.bounds, scale)
    return tuple(a | b for a, b in zip(*found, strict=True))


def _cut(sides: SampledSides, places: tuple[set[Fraction], ...]) -> SampledSides:
    """Return the sides with directions cut at some more places, or as they are."""
    bounds = []
    for row, more in zip(sides.bounds, places, strict=True):
        new = {float(x) for x in more if min(abs(float(x) - y) for y in row) > SAME_POSITION}
        bounds.append(tuple(sorted({*row, *new})))
    if tuple(bounds) == sides.bounds:
        return sides
    return _sampled(sides.equation, sides.map, sides.breaks, tuple(bounds))


def _layered(
    equation: PointEquation, boundary: BoundaryComplex, questions: MapQuestions
) -> BoundaryComplex:
    """Return the boundary with the faces between the layers; raise LayersError."""
    count, found = len(equation.layers), len(boundary.labels[2]) - 1
    if not count:
        return boundary
    if found != count:
        raise LayersError(
            f"there are {count} layers ({', '.join(equation.layers)}), and M has {found - 1} "
            "creases in w between them; layers lie at depth(w)"
        )
    along_u, along_v = (range(1, 2 * len(names) - 2, 2) for names in boundary.labels[:2])
    for i, j, k in product(along_u, along_v, range(count)):
        below, above = (i, j, 2 * k), (i, j, 2 * k + 2)
        if questions.coincide(below, above, IDENTITY):
            where = SideKey.of(below, boundary.labels, shown=(0, 1)).label
            raise LayersError(
                f"the layer {equation.layers[k]}{where} has no thickness: M is the same on both "
                "its sides; leave it out, or give it a thickness above 0"
            )
    return derive_layers(boundary, questions)


def _labels(equation: PointEquation, bounds: tuple[tuple[float, ...], ...]) -> Labels:
    labels = []
    for (low, high), (a, b), row in zip(equation.domain, equation.limits, bounds, strict=True):
        inner = (f"{a + (b - a) * position:.6g}" for position in row[1:-1])
        labels.append((_label(low, a), *inner, _label(high, b)))
    return tuple(labels)


@lru_cache(maxsize=64)
def _label(limit: Expr, value: float) -> str:
    text = repr(limit)
    return text if len(text) <= 8 else f"{value:.6g}"
