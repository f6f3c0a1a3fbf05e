"""Faces on analytic surfaces: the carrier, and where the face's four sides run on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pc2cad.geometry.carriers import PCurve, Segment, SplineCurve, SplinePath
from pc2cad.geometry.parameter_path import path
from pc2cad.geometry.rational import Arcs
from pc2cad.geometry.recognition import Along, Laid
from pc2cad.model import ModelEdge
from pc2cad.topology.complex import EdgeUse

Array = NDArray[np.float64]

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


def sides_on(
    laid: Laid,
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
        places = _Places(laid, axis, level, arcs[axis])
        if isinstance(carrier, SplineCurve) and _is_straight(carrier):
            first, last = places.towards(is_upwards(side, use))(np.array([0.0, 1.0]))
            result.append(_along_line(carrier, first, last))
            continue
        if isinstance(carrier, SplineCurve):
            upwards = is_upwards(side, use)
            breaks = np.unique(carrier.knots) if _is_simple(carrier) else np.array([0.0, 1.0])
            result.append(path(places.towards(upwards), breaks, places.scale))
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


def _is_simple(carrier: SplineCurve) -> bool:
    return len(carrier.knots) <= 40 * (carrier.degree + 1)


class _Places:
    """Surface parameters along one side of a face, by the spline parameter of its axis."""

    def __init__(self, laid: Laid, axis: int, level: float, arcs: Arcs | None) -> None:
        self._laid, self._axis, self._level, self._arcs = laid, axis, level, arcs

    @property
    def scale(self) -> Array:
        """Sizes of the surface's two parameters over the face."""
        ends = np.abs([self._laid.a.ends, self._laid.b.ends])
        return np.asarray(np.maximum(ends.max(axis=1), 1e-300))

    def __call__(self, x: Array) -> Array:
        return np.stack([self._along(self._laid.a, x), self._along(self._laid.b, x)], axis=-1)

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
