"""Faces on analytic surfaces: the carrier, and where the face's four sides run on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.carriers import (
    Cone,
    CurveCarrier,
    PCurve,
    Segment,
    SplineCurve,
    SplinePath,
    ends_of,
)
from pc2cad.geometry.parameter_path import path
from pc2cad.geometry.point_inversion import curve_points
from pc2cad.geometry.recognition.from_points import Fitted
from pc2cad.geometry.recognition.placement import Along, SurfacePlacement
from pc2cad.geometry.splines.arcs import Arcs
from pc2cad.representation.boundary_model import ModelEdge, corner_at
from pc2cad.topology.complex import EdgeUse

#: the axis along which each side of a face runs, and the other axis' value there
_SIDES = ((0, 0.0), (1, 1.0), (0, 1.0), (1, 0.0))


def axis_of(side: int) -> int:
    """Return the axis of a face along which one of its four sides runs."""
    return _SIDES[side][0]


def is_upwards(side: int, use: EdgeUse) -> bool:
    """Say whether an edge's own direction is that of the face's axis along it."""
    return use.edge is None or use.forward == (side < 2)


def whole_square(uses: Sequence[EdgeUse]) -> tuple[Segment, ...]:
    """Return the sides of the unit square, each along its edge's own direction."""
    square = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    sides = [Segment(square[i], square[(i + 1) % 4]) for i in range(4)]
    return tuple(
        side if use.forward or use.edge is None else side.reversed()
        for side, use in zip(sides, uses, strict=True)
    )


def sides_of_fitted(
    fitted: Fitted, uses: Sequence[EdgeUse], edges: Sequence[ModelEdge], vertices: Array
) -> tuple[PCurve | None, ...]:
    """Return the four sides of a face in its surface's parameters, along the edges' directions.

    There is none for a side that is a point where the surface has no pole, and for an edge that the
    face has on both sides where the surface has no seam. Raises ToleranceNotReachedError for a side
    that is no smooth curve there, and where two sides meet at a pole of a smooth surface, which is
    no place of the face's own (the apex of a cone is: `ModelFace.corner`).
    """
    poles = [use.edge is None and fitted.is_pole(vertices[use.vertex]) for use in uses]
    sides: list[PCurve | None] = []
    for side, use in enumerate(uses):
        carrier = None if use.edge is None else edges[use.edge].carrier
        if carrier is None:
            sides.append(None)
            continue
        upwards = is_upwards(side, use)
        sides.append(fitted.side(side, partial(curve_points, carrier), upwards, _breaks(carrier)))
    for i, j in ((0, 2), (1, 3), (0, 1), (0, 3), (1, 2), (2, 3)):
        first, second = sides[i], sides[j]
        if first is None or second is None or uses[i].edge != uses[j].edge:
            continue
        if np.abs(np.subtract(ends_of(first), ends_of(second))).max() < 1.0:
            sides[i] = sides[j] = None
        elif any(poles) and isinstance(first, SplinePath):
            # programs that read the file take the face by another seam
            raise ToleranceNotReachedError("a seam winds about a pole of the surface it is on")
    for side, pole in enumerate(poles):
        # sides that are one pole after the other are run through as one
        if pole and not poles[side - 1]:
            sides[side] = _round_pole(sides, uses, poles, side)
    if not isinstance(fitted.carrier, Cone) and any(corner_at(sides, uses, k) for k in range(4)):
        raise ToleranceNotReachedError("two sides meet at a pole of the surface they are on")
    return tuple(sides)


def _round_pole(
    sides: Sequence[PCurve | None], uses: Sequence[EdgeUse], poles: Sequence[bool], side: int
) -> Segment:
    """Return a side that is a pole, from the end of the side before it to the next one's start."""
    after = next(k % 4 for k in range(side + 1, side + 4) if not poles[k % 4])
    places = []
    for neighbour, at_end in (((side - 1) % 4, True), (after, False)):
        curve = sides[neighbour]
        assert curve is not None
        places.append(ends_of(curve)[int(at_end == uses[neighbour].forward)])
    (a, b), (c, _) = np.array(places).tolist()
    return Segment((a, b), (c, b))


def sides_on(
    placement: SurfacePlacement,
    uses: Sequence[EdgeUse],
    edges: Sequence[ModelEdge],
    arcs: Sequence[Arcs | None],
) -> tuple[PCurve, ...]:
    """Return the four sides of a face in its surface's parameters, along the edges' directions.

    Lines, circles and ellipses go at constant speed along the surface's parameters. A spline edge
    keeps the parameter that its other face asks for: `arcs` of the face's axes tell which.
    """
    result: list[PCurve] = []
    for side, use in enumerate(uses):
        carrier = None if use.edge is None else edges[use.edge].carrier
        axis, level = _SIDES[side]
        places = _Places(placement, axis, level, arcs[axis])
        if isinstance(carrier, SplineCurve) and _is_straight(carrier):
            first, last = places.towards(is_upwards(side, use))(np.array([0.0, 1.0]))
            result.append(_along_line(carrier, first, last))
            continue
        if isinstance(carrier, SplineCurve):
            upwards = is_upwards(side, use)
            result.append(path(places.towards(upwards), _breaks(carrier), places.scale))
            continue
        ends = places(np.array([0.0, 1.0])).tolist()
        forwards = is_upwards(side, use) if use.edge is not None else side < 2
        first, last = ends if forwards else ends[::-1]
        result.append(Segment(tuple(first), tuple(last)))
    return tuple(result)


def _is_straight(carrier: SplineCurve) -> bool:
    steps = carrier.poles - carrier.poles[0]
    length = float(np.linalg.norm(steps[-1]))
    across = np.linalg.norm(np.cross(steps, steps[-1]), axis=1)
    return length > 0 and carrier.weights is None and bool(across.max() <= 1e-12 * length**2)


def _along_line(carrier: SplineCurve, first: Array, last: Array) -> SplinePath:
    """Return a straight edge's path: on straight lines of a surface, parameters are lengths."""
    along = carrier.poles[-1] - carrier.poles[0]
    share = (carrier.poles - carrier.poles[0]) @ along / (along @ along)
    return SplinePath(carrier.degree, carrier.knots, first + share[:, None] * (last - first))


def _breaks(carrier: CurveCarrier) -> Array:
    """Return places at which a curve may have kinks, or is cut so that none has a whole turn."""
    if not isinstance(carrier, SplineCurve):
        return np.array([0.0, 0.5, 1.0])
    simple = len(carrier.knots) <= 40 * (carrier.degree + 1)
    return distinct(carrier.knots) if simple else np.array([0.0, 1.0])


class _Places:
    """Surface parameters along one side of a face, by the spline parameter of its axis."""

    def __init__(
        self, placement: SurfacePlacement, axis: int, level: float, arcs: Arcs | None
    ) -> None:
        self._placement, self._axis, self._level, self._arcs = placement, axis, level, arcs

    @property
    def scale(self) -> Array:
        """Sizes of the surface's two parameters over the face."""
        ends = np.abs([self._placement.a.ends, self._placement.b.ends])
        return np.asarray(np.maximum(ends.max(axis=1), 1e-300))

    def __call__(self, x: Array) -> Array:
        return np.stack(
            [self._along(self._placement.a, x), self._along(self._placement.b, x)], axis=-1
        )

    def towards(self, upwards: bool) -> Callable[[Array], Array]:
        """Return the places by the edge's own parameter."""
        return self if upwards else lambda x: self(1 - x)

    def _along(self, along: Along, x: Array) -> Array:
        if along.axis != self._axis:
            first, last = along.ends
            return np.full(np.shape(x), last if self._level else first)
        if along.values is None:
            return x
        return along.values(x if self._arcs is None else self._arcs.places(x))
