"""Volume, area and centroid of what closed triangles enclose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Integers


@dataclass(frozen=True)
class TriangleIntegrals:
    """Integrals in model units."""

    volume: float
    area: float
    centroid: tuple[float, float, float]


def triangle_integrals(vertices: Array, triangles: Integers) -> TriangleIntegrals:
    """Return the integrals of closed triangles, oriented outwards: (n, 3) points, (m, 3) rows.

    Exact for the triangles but for rounding: the divergence theorem on each, about their middle.
    """
    centre = vertices.mean(axis=0)
    a, b, c = ((vertices - centre)[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    sixfold = (a * normals).sum(axis=1)
    volume = float(sixfold.sum()) / 6
    x, y, z = ((a + b + c) * sixfold[:, None]).sum(axis=0) / 24 / volume + centre
    area = float(np.sqrt((normals * normals).sum(axis=1)).sum()) / 2
    return TriangleIntegrals(volume, area, (float(x), float(y), float(z)))
