"""What is integrated over the faces of a solid: columns of places and normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array

#: pairs of axes with products of inertia, and those of squares, in the order of `second`
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Form:
    """Integrands r·n, |n| and r_i² n_i, then what else is asked for.

    `more` takes places and normals, (n, 3) each; these are as long as the area element.
    """

    more: Callable[[Array, Array], Array] | None = None
    #: of each further column: what it is at most, per area, `reach` away from the origin
    most: Callable[[float], Array] | None = None

    def rows(self, points: Array, normals: Array) -> Array:
        """Return the integrands (5 + k, …) at places with normals, (3, …) each."""
        first = np.empty((5, *points.shape[1:]))
        flux = points * normals
        np.add(flux[0] + flux[1], flux[2], out=first[0])
        np.multiply(points, flux, out=first[2:])
        squares = np.multiply(normals, normals, out=flux)
        np.sqrt(squares[0] + squares[1] + squares[2], out=first[1])
        if self.more is None:
            return first
        more = self.more(points.reshape(3, -1).T, normals.reshape(3, -1).T).T
        return np.concatenate((first, more.reshape(-1, *first.shape[1:])))

    def turned(self) -> Form:
        """Return the form whose further columns take the normals the other way round."""
        more = self.more
        return self if more is None else Form(lambda at, normals: more(at, -normals), self.most)

    def worth(self, area: float, reach: float) -> Array:
        """Return what each integral over an area may be at most, (5 + k,)."""
        first = np.array([reach, 1.0, *[reach * reach] * 3])
        if self.most is not None:
            first = np.concatenate((first, self.most(reach)))
        return np.asarray(area * first)


#: volume (three times), area and first moments (twice)
FLUX = Form()


def _second(points: Array, normals: Array) -> Array:
    flux = points * points * normals
    rows = [(flux[:, i] * points[:, j] + flux[:, j] * points[:, i]) for i, j in PAIRS]
    return np.asarray(np.stack(rows, axis=1) / np.array([6.0] * 3 + [4.0] * 3))


#: and the second moments ∫ r_i r_j dV, in the order of `PAIRS`
SECOND = Form(_second, lambda reach: np.full(6, reach**3))
