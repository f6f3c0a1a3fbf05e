"""Proved deviations in place of sampled ones, for faces, edges and volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import comb

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import vectors
from pc2cad.bounds.deviation import Bound, bound_surface
from pc2cad.bounds.known import Known
from pc2cad.bounds.rational_deviation import bound_spline
from pc2cad.bounds.slices import between
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.breaks import BreaksNotAlignedError
from pc2cad.expression.tree import ZERO, Expr, number, substitute
from pc2cad.geometry.carriers import Evidence, Plane, Revolution, SplineCurve, SplineSurface
from pc2cad.geometry.splines.bernstein import bezier_knots, degree_in
from pc2cad.geometry.splines.rational import Parametrisation
from pc2cad.geometry.splines.trivariate import SplineVolume
from pc2cad.representation.boundary_model import ModelEdge, ModelFace
from pc2cad.representation.meridian_faces import Meridian
from pc2cad.topology.cells import Cell

#: share of the distance that may be added between slices of a volume
_BETWEEN = 0.05
#: degree in which the distance from a plane, which is zero, is looked at
_FLAT_DEGREE = 7


#: a bound on a side of a face that is wider of the samples is not as good as an edge's own
_WIDEST = 1.9


@dataclass(frozen=True, eq=False)
class Side:
    """A side of a proved face: its cell, knots and poles, and how far it is from the equation."""

    cell: Cell
    knots: Array
    poles: Array
    #: of the face, and which of its sides it is
    whole: Bound
    index: int

    @property
    def bound(self) -> Bound:
        """How far the side is from the equation: few are asked for it."""
        return self.whole.side(self.index)

    def carries(self, cell: Cell, carrier: SplineCurve) -> bool:
        """Say whether it is an edge, pole for pole, and known about as well as that could be."""
        return (
            cell == self.cell
            and carrier.weights is None
            and np.array_equal(carrier.knots, self.knots)
            and np.array_equal(carrier.poles, self.poles)
            and self.bound.largest <= _WIDEST * self.bound.sampled
        )


def _sides_of(face: ModelFace, function: RestrictedMap, bound: Bound) -> list[Side]:
    """Return the sides of a face that are bounded with it, rational ones left out."""
    surface = face.carrier
    if not isinstance(surface, SplineSurface) or bound.pairs is None:
        return []
    rows, weights = _rows(surface.poles), surface.weights
    plain = [True] * 4 if weights is None else [bool((row == 1).all()) for row in _rows(weights)]
    found = []
    for k, row in enumerate(rows):
        if not plain[k]:
            continue
        direction, position = function.pieces[k // 2]
        cell = list(function.cell)
        cell[direction] = position + (1 if k % 2 else -1)
        found.append(Side((cell[0], cell[1], cell[2]), surface.knots[1 - k // 2], row, bound, k))
    return found


def _rows(net: Array) -> tuple[Array, Array, Array, Array]:
    return net[0], net[-1], net[:, 0], net[:, -1]


def prove_edge(
    edge: ModelEdge,
    function: RestrictedMap,
    parametrisation: Parametrisation,
    sides: Sequence[Side],
    known: Known,
) -> ModelEdge:
    """Return the edge with a proved deviation, where one can be had; it is no exact one.

    `sides` are those of proved faces: where the edge is one of them, it is proved with the face.
    What is `known` of the equation's parts is used, and added to.
    """
    carrier = edge.carrier
    if not isinstance(carrier, SplineCurve):
        return edge
    bound = next((s.bound for s in sides if s.carries(function.cell, carrier)), None)
    try:
        if bound is None:
            bound = bound_spline(*function.trees, carrier, (parametrisation,), known)
    except BreaksNotAlignedError:
        return replace(edge, sampled=edge.deviation, open=((0.0, 1.0),))
    evidence, deviation = _judge(bound)
    return replace(
        edge, evidence=evidence, deviation=deviation, sampled=bound.sampled, open=bound.open,
        place=bound.place,
    )  # fmt: skip


def prove_face(
    face: ModelFace,
    functions: Sequence[RestrictedMap],
    parametrisations: Sequence[Parametrisation],
    rounding: float,
    known: Known,
) -> tuple[ModelFace, list[Side]]:
    """Return the face with a proved deviation, where one can be had; it is no exact one.

    With it come its sides, as far as they are bounded. `functions` are those of the patches that it
    covers, `parametrisations` those along a spline's axes, and `rounding` is the length below which
    places of the part cannot be told apart.
    """
    try:
        if isinstance(face.carrier, Plane):
            bounds = [_from_plane(function, face.carrier, rounding) for function in functions]
        elif isinstance(face.carrier, SplineSurface):
            trees, names = functions[0].trees
            seen = face.deviation
            bounds = [bound_spline(trees, names, face.carrier, parametrisations, known, seen)]
        else:
            return face, []
    except BreaksNotAlignedError:
        return replace(face, sampled=face.deviation, open=((0.0, 1.0), (0.0, 1.0))), []
    bound = max(bounds, key=lambda b: b.largest)
    evidence, deviation = _judge(bound)
    proved = replace(
        face, evidence=evidence, deviation=deviation, sampled=bound.sampled,
        samples=sum(b.samples for b in bounds), open=bound.open, place=bound.place,
    )  # fmt: skip
    return proved, _sides_of(face, functions[0], bound)


def prove_meridian(face: ModelFace, meridian: Meridian, known: Known) -> ModelFace:
    """Return a revolution with a proved deviation, where one can be had: that of its meridian.

    The patch is the meridian turned, by algebra, as the surface is its spline.
    """
    trees, names = meridian.function.trees
    axis = meridian.axis
    section = substitute(trees, {names[1 - axis]: number(Fraction(meridian.level))})
    assert isinstance(face.carrier, Revolution)
    assert isinstance(face.carrier.basis, SplineCurve)
    try:
        bound = bound_spline(
            section, (names[axis],), face.carrier.basis, (meridian.parametrisation,), known
        )
    except BreaksNotAlignedError:
        return face
    evidence, deviation = _judge(bound)
    open_ = bound.open and (*bound.open, (0.0, 1.0))
    return replace(
        face, evidence=evidence, deviation=deviation, sampled=bound.sampled,
        samples=bound.samples, open=open_ if axis == 0 else open_[::-1],
        place=meridian.place(bound.place[0]),
    )  # fmt: skip


def bound_volume(
    function: RestrictedMap, volume: SplineVolume, directions: Sequence[int]
) -> Bound | None:
    """Bound the distance of M from a trivariate spline, None where no way to is known.

    `directions` are those of u, v, w (0, 1, 2) along the spline's axes.
    """
    trees, names = function.trees
    along = [names[d] for d in directions]
    ruled = next((k for k in range(3) if _is_bernstein(volume.axes[k], trees, along[k])), None)
    try:
        if ruled is None:
            bound = _bound_slices(trees, along, volume)
        else:
            bound = _bound_ruled(trees, along, volume, ruled)
    except BreaksNotAlignedError:
        return None
    if bound is None:
        return None
    # rounding of the sums of poles that slices and control surfaces are
    size = float(np.sqrt((volume.poles**2).sum(axis=-1)).max())
    terms = max(volume.degrees) + 4
    return replace(bound, largest=bound.largest + 4 * terms * 2.0**-53 * size)


def _bound_slices(
    trees: tuple[Expr, ...], along: Sequence[str], volume: SplineVolume
) -> Bound | None:
    """Bound the distance from those of slices (see `bounds.slices`)."""
    # slices as few as can be; the weights do not change from slice to slice
    axis = min((k for k in range(3) if volume.axes[k].arcs is None),
               key=lambda k: len(volume.axes[k].space.points))  # fmt: skip
    others = [k for k in range(3) if k != axis]
    parametrisations = [volume.axes[k] for k in others]
    names = [along[k] for k in others]
    known, space = Known(), volume.axes[axis].space

    def bound_at(place: float) -> Bound:
        section = substitute(trees, {along[axis]: number(Fraction(place))})
        shares = space.basis(np.array([place])).toarray()[0]
        return bound_spline(
            section, names, _combined(volume, axis, shares), parametrisations, known
        )

    first = max(bound_at(place).sampled for place in (0.0, 0.3, 0.6, 1.0))
    rows = between(trees, along, volume.knots, volume.degrees, axis, _BETWEEN * first)
    if rows is None:
        return None
    found = [bound_at(float(place)) for place in rows.places()]
    largest = rows.largest(np.array([bound.largest for bound in found]))
    return Bound(
        largest, max(bound.sampled for bound in found), sum(bound.samples for bound in found)
    )


def _bound_ruled(
    trees: tuple[Expr, ...], along: Sequence[str], volume: SplineVolume, ruled: int
) -> Bound:
    """Bound the distance where M and S are polynomials of one Bernstein basis B_k along an axis.

    M - S = Σ B_k (C_k - S_k), and since the basis is positive and sums to 1, the distance is at
    most the largest of those of the surfaces C_k, S_k.
    """
    others = [k for k in range(3) if k != ruled]
    places = [
        substitute(trees, {along[ruled]: number(Fraction(j, max(volume.degrees[ruled], 1)))})
        for j in range(volume.degrees[ruled] + 1)
    ]
    known, bounds = Known(), []
    for k, shares in enumerate(_to_bernstein(volume.degrees[ruled])):
        control = tuple(
            sum((c * row[i] for c, row in zip(shares, places, strict=True) if c), ZERO)
            for i in range(3)
        )
        surface = _combined(volume, ruled, np.eye(volume.degrees[ruled] + 1)[k])
        parametrisations = [volume.axes[axis] for axis in others]
        bounds.append(
            bound_spline(
                control, [along[axis] for axis in others], surface, parametrisations, known
            )
        )
    return max(bounds, key=lambda bound: bound.largest)


def _is_bernstein(axis: Parametrisation, trees: Sequence[Expr], name: str) -> bool:
    """Say whether the spline's basis along an axis is one Bernstein basis, which holds M too."""
    if axis.arcs is not None or len(axis.space.points) > 2:
        return False
    degree = degree_in(trees, name)
    return degree is not None and degree <= axis.space.degree


def _combined(volume: SplineVolume, axis: int, shares: Array) -> SplineSurface:
    """Return the surface whose poles are a sum of a volume's along an axis, by shares."""
    first, second = (k for k in range(3) if k != axis)
    weights, poles = None, vectors(shares, np.moveaxis(volume.poles, axis, 0))
    if volume.weights is not None:
        weights = vectors(shares, np.moveaxis(volume.weights, axis, 0))
        weighted = volume.poles * volume.weights[..., None]
        poles = vectors(shares, np.moveaxis(weighted, axis, 0)) / weights[..., None]
    return SplineSurface(
        (volume.degrees[first], volume.degrees[second]),
        (volume.knots[first], volume.knots[second]), poles, weights,
    )  # fmt: skip


def _to_bernstein(degree: int) -> list[list[Fraction]]:
    """Return the shares of values at even places in each Bernstein coefficient, exactly."""
    n = max(degree, 1)
    table = [[Fraction(comb(degree, k)) * Fraction(j, n) ** k * Fraction(n - j, n) ** (degree - k)
              for k in range(degree + 1)] for j in range(degree + 1)]  # fmt: skip
    size = degree + 1
    rows = [[*row, *(Fraction(int(i == j)) for j in range(size))] for i, row in enumerate(table)]
    for i in range(size):
        pivot = next(r for r in range(i, size) if rows[r][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for r in range(size):
            if r != i and rows[r][i]:
                rows[r] = [x - rows[r][i] * y for x, y in zip(rows[r], rows[i], strict=True)]
    return [row[size:] for row in rows]


def _judge(bound: Bound) -> tuple[Evidence, float]:
    if np.isfinite(bound.largest):
        return "bounded", bound.largest
    return "sampled", bound.sampled


def _from_plane(function: RestrictedMap, plane: Plane, rounding: float) -> Bound:
    """Bound the distance of a patch from a plane: that of (n·(M - o), 0, 0) from zero."""
    trees, names = function.trees
    height: Expr = ZERO
    for tree, origin, normal in zip(trees, plane.origin, plane.normal, strict=True):
        height = height + number(float(normal)) * (tree - number(float(origin)))
    flat = SplineSurface(
        (_FLAT_DEGREE, _FLAT_DEGREE),
        (bezier_knots(_FLAT_DEGREE), bezier_knots(_FLAT_DEGREE)),
        np.zeros((_FLAT_DEGREE + 1, _FLAT_DEGREE + 1, 3)),
    )
    return bound_surface((height, ZERO, ZERO), names, flat, rounding)
