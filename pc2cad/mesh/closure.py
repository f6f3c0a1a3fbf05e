"""Whether a mesh is whole: its facets close, and hold what its elements fill."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import NotASolidError
from pc2cad.mesh.elements import COLLAPSED_PYRAMID, TYPES, gradients, rule, shapes
from pc2cad.mesh.volume_mesh import VolumeMesh

#: units in the last place that one term of a sum of an integral can be off
_ULPS = 256
_CHUNK = 1 << 12


class MeshNotWholeError(NotASolidError):
    """The facets of a mesh do not close, or do not hold what its elements fill."""


def check_whole(mesh: VolumeMesh, filled: float) -> None:
    """Raise MeshNotWholeError where elements overlap, leave gaps or have faces in no side.

    `filled` is the sum of the elements' volumes, in model units cubed, with pyramids of order 2 as
    bricks one face of which is a point. On those faces such a brick is another surface than the
    triangle of order 2 that its neighbour and its side have; what is between is known, and counted.
    All other integrals are exact for the elements, so that only rounding is allowed for.
    """
    volume = swept = reach = 0.0
    normal, area = np.zeros(3), 0.0
    centre = mesh.centre
    for side in mesh.whole_sides:
        for normals, weights, places in mesh.facet_integrands(side):
            terms = (places * normals).sum(axis=-1) * weights
            volume += float(terms.sum()) / 3
            swept += float(np.abs(terms).sum()) / 3
            reach = max(reach, float(np.abs(places).max()))
            # summed pairwise: along the last axis of what is contiguous
            normal += np.ascontiguousarray(np.einsum("nqx,q->xn", normals, weights)).sum(axis=1)
            area += float((np.sqrt((normals**2).sum(axis=-1)) * weights).sum())
    between = _beside_pyramids(mesh, centre)
    # coordinates are rounded where they are, however small the part is there
    offset = 1 + float(np.abs(centre).max()) / reach if reach else 1.0
    rounding = _ULPS * float(np.finfo(float).eps) * offset
    if not abs(volume + between - filled) <= rounding * (swept + abs(filled)):
        raise MeshNotWholeError(
            f"the mesh's facets hold {volume:.9g} and its elements fill {filled - between:.9g}, "
            f"{abs(volume + between - filled) / abs(filled):.1e} of it apart: elements overlap, "
            "leave gaps, or have faces in no side; other cells may do"
        )
    if not float(np.abs(normal).max()) <= rounding * area:
        raise MeshNotWholeError(
            f"the mesh's facets leave an opening of {float(np.sqrt((normal**2).sum())):.3g} of "
            f"their area of {area:.6g}; other cells may do"
        )


def _beside_pyramids(mesh: VolumeMesh, centre: Array) -> float:
    """Return by how much pyramids of order 2 fill more than their faces of order 2 hold."""
    block = mesh.blocks.get("pyramid")
    if mesh.order == 1 or block is None:
        return 0.0
    total = 0.0
    columns = np.array(COLLAPSED_PYRAMID[2])
    at, weights = rule("hexahedron", 3)
    slopes = gradients("hexahedron", 2, at)
    for start in range(0, len(block), _CHUNK):
        nodes = block[start : start + _CHUNK]
        points = mesh.points[nodes] - centre
        tangents = np.einsum("qdk,nkx->dnqx", slopes, points[:, columns], optimize=True)
        determinant = (tangents[0] * np.cross(tangents[1], tangents[2])).sum(axis=-1)
        total += float((determinant @ weights).sum())
        total -= sum(_behind_faces(points))
    return total


def _behind_faces(points: Array) -> Iterator[float]:
    """Give the volume behind each face of pyramids of order 2, (n, 13, 3), from the origin."""
    kind = TYPES["pyramid"]
    for face, ring in enumerate(kind.faces):
        shape = "quad" if len(ring) == 4 else "triangle"
        at, weights = rule(shape, 6)
        own = points[:, kind.face_nodes(face, 2)]
        along = np.einsum("qdk,nkx->dnqx", gradients(shape, 2, at), own, optimize=True)
        places = shapes(shape, 2, at) @ own
        yield float(((places * np.cross(along[0], along[1])).sum(axis=-1) @ weights).sum()) / 3
