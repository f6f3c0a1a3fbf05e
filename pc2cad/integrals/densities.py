"""The integrands of volume, first moments and areas, as functions of places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.jacobian_watch import JacobianWatch, determinants, volumes
from pc2cad.integrals.quadrature import Samples
from pc2cad.integrals.rules import Density
from pc2cad.topology.cells import Cell, directions_of

#: u, v and w (broadcastable) to det J (…), M, and M_u, M_v and M_w (…, 3)
Look = Callable[[Array, Array, Array], tuple[Array, Array, list[Array]]]


def with_moments(determinant: Array, points: Array, centre: Array) -> Array:
    """Return det J (…) and, of points M (…, 3), its moments (M - centre) det J, all (4, …)."""
    values = np.empty((4, *determinant.shape))
    values[0] = determinant
    with np.errstate(all="ignore"):
        for axis in range(3):
            row = values[1 + axis, ...]
            np.subtract(points[..., axis], centre[axis], out=row)
            row *= determinant
    return values


@dataclass(frozen=True, eq=False)
class Densities:
    """The integrands, as functions of places."""

    analysis: Analysis
    centre: Array
    #: notes the sign of det J at all nodes, where that is not proved
    watch: JacobianWatch | None

    def look(self, u: Array, v: Array, w: Array) -> tuple[Array, Array, list[Array]]:
        """Return det J, M, and M_u, M_v and M_w; signs are noted on the way, if they are to be."""
        points, *tangents = self.analysis.map.frame(u, v, w)
        if self.watch is not None:
            return self.watch.note(tangents, (u, v, w))[0], points, tangents
        with np.errstate(all="ignore"):
            return determinants(*tangents), points, tangents

    def volume(self, u: Array, v: Array, w: Array) -> Samples:
        """Return det J and (M - centre) det J; signs are noted on the way, if they are to be."""
        points, *tangents = self.analysis.map.frame(u, v, w)
        if self.watch is None:
            determinant, size, _ = volumes(tangents)
        else:
            determinant, size, _ = self.watch.note(tangents, (u, v, w))
        values = with_moments(determinant, points, self.centre)
        return Samples(np.moveaxis(values, 0, -1), size, points, tangents)

    def measure(self, u: Array, v: Array, w: Array) -> Samples:
        """Return det J and (M - centre) det J, and note no sign."""
        points, a, b, c = self.analysis.map.frame(u, v, w)
        values = np.einsum("...i,...i->...", a, cross(b, c))[..., None]
        with np.errstate(all="ignore"):
            moments = (points - self.centre) * values
        return Samples(np.concatenate((values, moments), axis=-1), np.abs(values[..., 0]))

    def area_of(self, patch: Cell) -> Density:
        """Return the function that gives |M_s × M_t| on a patch."""
        s, t = directions_of(patch)

        def area(u: Array, v: Array, w: Array) -> Samples:
            tangents = self.analysis.map.tangents((s, t), u, v, w)
            # coordinate by coordinate: np.cross is slower
            (a, b, c), (x, y, z) = (np.moveaxis(m, -1, 0) for m in tangents)
            with np.errstate(all="ignore"):
                values = _length(b * z - c * y, c * x - a * z, a * y - b * x)
                terms = _length(a, b, c) * _length(x, y, z)
            return Samples(values[..., None], terms)

        return area


def _length(x: Array, y: Array, z: Array) -> Array:
    return np.asarray(np.sqrt(x * x + y * y + z * z))
