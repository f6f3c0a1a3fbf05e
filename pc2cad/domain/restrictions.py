"""M on the sides and edges of the box: its points and normals there, and what it is by algebra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross, thickness
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.domain.pieces import has_pieces, having_a_value, piece_at, span_at
from pc2cad.domain.sections import SECTIONS
from pc2cad.expression.breaks import Break
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.plain_functions import of_powers_or_waves
from pc2cad.expression.polynomials import Vectors, polynomials
from pc2cad.expression.tree import Expr
from pc2cad.geometry.splines.bernstein import chebyshev_nodes, degree_in, to_powers
from pc2cad.geometry.splines.spline_profile import LARGEST_DEGREE
from pc2cad.topology.cells import Cell, directions_of

# who only asks for trees, as `verify` does, needs neither forms nor spaces
if TYPE_CHECKING:
    from pc2cad.geometry.carriers import Plane
    from pc2cad.geometry.recognition.separable_form import Separation
    from pc2cad.geometry.splines.arcs import Wave
    from pc2cad.geometry.splines.spline_space import SplineSpace

#: unit of rounding of double precision
UNIT = 2.0**-53
#: polynomials up to this degree lose at most 1e-10 of their size
SAFE_DEGREE = 8
#: what rounding in the kernel may make of an exact form, relative to the part's size
LARGEST_LOSS = 1e-9
#: the ends of an edge
ENDS = np.array([0.0, 1.0])
#: local parameters by their bytes
_Places = tuple[bytes, ...]
#: a direction (0, 1, 2) and the position of one of its pieces (odd)
Piece = tuple[int, int]


@dataclass(frozen=True, eq=False)
class RestrictedMap:
    """M restricted to a face or an edge of the box, in the cell's own coordinates on [0, 1]."""

    analysis: Analysis
    cell: Cell
    #: polynomials of a higher degree are not carried exactly
    largest: int = LARGEST_DEGREE
    #: polynomial degree per axis (None: not polynomial), filled in on demand
    degrees: dict[int, int | None] = field(default_factory=dict, repr=False)
    #: what it is per axis as a wave of a linear angle (None: no such wave), filled in on demand
    waves: dict[int, Wave | None] = field(default_factory=dict, repr=False)
    #: points and normals on products of parameters, that somebody has looked at (`looks`)
    _points: dict[_Places, Array] = field(default_factory=dict, repr=False)
    _normals: dict[_Places, Array] = field(default_factory=dict, repr=False)

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The direction pieces along which the cell extends."""
        return tuple((d, self.cell[d]) for d in directions_of(self.cell))

    def __call__(self, *local: Array) -> Array:
        """Return M on the product of the local parameter arrays: shape (len, …, 3)."""
        if self._points and (seen := self._points.get(_key(local))) is not None:
            return seen
        places = self.places(*local)
        values = self.analysis.map.points(*open_grid(*(np.atleast_1d(x) for x in places)))
        keep = tuple(slice(None) if p % 2 else 0 for p in self.cell)
        return np.asarray(values[keep])

    def at(self, *local: Array) -> Array:
        """Return M at places given by broadcastable local parameters: shape broadcast + (3,)."""
        return self.analysis.map.points(*self.places(*local))

    def normals(self, *local: Array) -> Array:
        """Return M_s × M_t of a face on the product of parameter arrays: shape (len, len, 3)."""
        if self._normals and (seen := self._normals.get(_key(local))) is not None:
            return seen
        s, t = directions_of(self.cell)
        grid = open_grid(*(np.atleast_1d(x) for x in self.places(*local)))
        along_s, along_t = self.analysis.map.tangents((s, t), *grid)
        keep = tuple(slice(None) if p % 2 else 0 for p in self.cell)
        return cross(along_s, along_t)[keep]

    def keep(self, local: tuple[Array, ...], points: Array) -> None:
        """Remember points on a product of parameters."""
        self._points[_key(local)] = points

    def keep_normals(self, local: tuple[Array, ...], normals: Array) -> None:
        """Remember normals on a product of parameters."""
        self._normals[_key(local)] = normals

    def knows(self, *local: Array) -> bool:
        """Say whether points on a product of parameters are known."""
        return _key(local) in self._points

    def knows_normals(self, *local: Array) -> bool:
        """Say whether normals on a product of parameters are known."""
        return _key(local) in self._normals

    def shown(self, *local: float) -> str:
        """Return a place as the equation's own parameters, for a message."""
        return self.analysis.map.shown(float(x) for x in self.places(*local))

    def place(self, *local: float) -> tuple[float, float, float]:
        """Return a place as local coordinates of the box, each from 0 to 1."""
        u, v, w = (float(x) for x in self.places(*local))
        return u, v, w

    def places(self, *local: Array | float) -> list[Array]:
        """Return places as local coordinates of the box, not broadcast."""
        free, found = iter(local), []
        for row, position in zip(self.analysis.bounds, self.cell, strict=True):
            low, high = span_at(row, position)
            found.append(np.asarray(low + (high - low) * next(free) if position % 2 else low))
        return found

    @property
    def is_affine(self) -> bool:
        """Say whether an edge's trees show at once that it is run through at one velocity."""
        ((direction, _),) = self.pieces
        spans, _ = piece_at(self.cell, self.analysis.bounds)
        return self.analysis.map.pieces.degree(spans, PARAMETERS[direction]) == 1

    @cached_property
    def trees(self) -> tuple[tuple[Expr, ...], tuple[str, ...]]:
        """The coordinate trees in local parameters, and the names of those."""
        spans, limits = piece_at(self.cell, self.analysis.bounds)
        names = tuple(PARAMETERS[d] for d in directions_of(self.cell))
        with having_a_value(self.cell, self.analysis.boundary.labels):
            return self.analysis.map.pieces.restricted(spans, limits), names

    @cached_property
    def polynomial(self) -> tuple[Vectors, int] | None:
        """The coordinates times a whole number, and that number, where M is one polynomial."""
        if any(len(row) > 2 for row in self.analysis.bounds):
            return None
        found = polynomials(self.analysis.map.coordinates)
        return None if found is None else (found.on(self.cell), found.scale)

    @cached_property
    def exact_plane(self) -> Plane | None:
        """The plane of a face of a polynomial map, None where it is not told by whole numbers."""
        from pc2cad.geometry.recognition.from_polynomials import exact_plane

        return None if self.polynomial is None else exact_plane(*self.polynomial)

    @cached_property
    def is_exactly_straight(self) -> bool:
        """Whether the whole numbers of a polynomial map show that an edge is straight."""
        from pc2cad.geometry.recognition.from_polynomials import is_exactly_straight

        return self.polynomial is not None and is_exactly_straight(self.polynomial[0])

    @cached_property
    def form(self) -> Separation | None:
        """The coordinates as sums of products of functions of one parameter each.

        It is exact algebra, and dear: ask `may_be_exact` or `may_be_swept` first.
        """
        from pc2cad.expression.magnitudes import spread
        from pc2cad.geometry.recognition.separable_form import of_polynomial, separate

        places = (SECTIONS[::2],) * len(self.pieces)
        seen = spread(self(*places).reshape(-1, 3))
        if self.polynomial is None:
            return separate(*self.trees, seen)
        names = [PARAMETERS[d] for d, _ in self.pieces]
        return of_polynomial(*self.polynomial, names, seen)

    def may_be_exact(self, axis: int) -> bool:
        """Say whether powers or waves alone may hold an axis: no other operation meets it."""
        trees, names = self.trees
        return of_powers_or_waves(trees, names[axis])

    @cached_property
    def may_be_swept(self) -> bool:
        """Whether samples allow a line, an extrusion or a revolution.

        The chords along one axis of these are in one plane, whatever the other parameter is.
        """
        if len(self.pieces) == 1:
            values = self(SECTIONS[::2])
            return _flat_rank(values[1:], values[:1]) < 2
        values = self(SECTIONS[::2], SECTIONS[::2])
        return any(_flat_rank(v[1:], v[:1]) < 3 for v in (values, values.transpose(1, 0, 2)))


def _key(local: tuple[Array, ...]) -> _Places:
    return tuple([x.tobytes() for x in local])


def _flat_rank(points: Array, origins: Array) -> int:
    """Return the dimension of the space of the steps from origins to points, to rounding."""
    steps = (points - origins).reshape(-1, 3)
    lost = 1e-14 * float(np.abs(points).max()) * len(steps)
    least, size = thickness(steps)
    if least > 1e-9 * size + lost:
        return 3
    values = np.linalg.svd(steps, compute_uv=False)
    rounding = 1e-9 * values[0] + lost
    return int((values > rounding).sum())


def polynomial_space(
    function: RestrictedMap, axis: int, breaks: Sequence[Break]
) -> SplineSpace | None:
    """Return a space that holds the function exactly along one of its axes, or None.

    None also where the kernel could not evaluate it: it goes by powers within a span, and those of
    a Chebyshev polynomial of degree 15 lose nine digits, those of u^15 none.
    """
    from pc2cad.geometry.splines.spline_space import SplineSpace, bezier_space

    if function.degrees.get(axis, 0) is None:
        return None  # known without trees
    trees, names = function.trees
    inner = [b for b in breaks if 0 < b.position < 1]
    points = [0.0, *(b.position for b in inner), 1.0]
    if axis not in function.degrees:
        degree = degree_in(trees, names[axis])
        if degree is not None and SAFE_DEGREE < degree <= function.largest:
            lost = max(_loss(function, axis, degree, span) for span in pairwise(points))
            degree = degree if lost <= LARGEST_LOSS * function.analysis.size else None
        function.degrees[axis] = degree
    degree = function.degrees[axis]
    if degree is None or degree > function.largest:
        return None
    if not inner or not has_pieces(trees, names[axis]):
        return bezier_space(degree)
    return SplineSpace(degree, points, [max(1, degree - b.smoothness) for b in inner])


def _loss(function: RestrictedMap, axis: int, degree: int, span: tuple[float, float]) -> float:
    """Return what rounding leaves open of a polynomial that is evaluated by powers on a span."""
    places = [SECTIONS[::4]] * len(function.pieces)
    places[axis] = span[0] + (span[1] - span[0]) * chebyshev_nodes(degree)
    values = np.moveaxis(function(*places), axis, 0).reshape(degree + 1, -1)
    return UNIT * float(np.abs(to_powers(degree) @ values).sum(axis=0).max())
