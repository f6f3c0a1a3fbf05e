"""Places in a face, beside its edges: where a wrong edge shows first."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.verify.edges import Edge
from pc2cad.verify.faces import JudgedFace

#: where along an edge
_SHARES = np.array([0.171, 0.5, 0.839])
#: steps across the face from an edge, at least; and the share of its width, at most
_FAR, _WITHIN = 20.0, 0.2


@dataclass(frozen=True, eq=False)
class Beside:
    """Places on the edges of a face, into which it goes on from there, and how wide it is."""

    face: JudgedFace
    edges: tuple[Edge, ...]
    #: (n, 3) each, and (n,)
    places: Array
    inward: Array
    widths: Array

    @classmethod
    def of(cls, face: JudgedFace) -> Beside:
        """Return some places on every edge."""
        loops = face.face.loops
        border = sum(edge.length for loop in loops for edge, _ in loop.edges)
        edges, places, along = [], [], []
        for edge, forward in (use for loop in loops for use in loop.edges):
            first, last = edge.interval
            at, slope = edge.curve.at(first + (last - first) * _SHARES)
            edges += [edge] * len(at)
            places.append(at)
            along.append(slope if (last > first) == forward else -slope)
        points = np.concatenate(places)
        inward = np.cross(normals_of(face, points)[1], np.concatenate(along))
        inward = inward / np.maximum(np.linalg.norm(inward, axis=1), 1e-300)[:, None]
        own = [min(edge.length, face.moments.area / border) for edge in edges]
        return cls(face, tuple(edges), points, inward, np.array(own))

    def part(self, which: Booleans) -> Beside:
        """Return some of the places."""
        edges = tuple(edge for edge, own in zip(self.edges, which, strict=True) if own)
        return replace(
            self, edges=edges, places=self.places[which], inward=self.inward[which],
            widths=self.widths[which],
        )  # fmt: skip

    def wide(self, inwards: float, least: float) -> Beside | None:
        """Return those from which the face goes on far enough."""
        which = self._depths(inwards, least) < _WITHIN * self.widths
        return self.part(which) if which.any() else None

    def inside(self, inwards: float, least: float) -> Array:
        """Return rows of a place in the face, the normal of the face there, and the depth."""
        depths = self._depths(inwards, least)
        points, normals = normals_of(self.face, self.places + depths[:, None] * self.inward)
        return np.column_stack((points, normals, depths))

    def _depths(self, inwards: float, least: float) -> Array:
        return np.maximum(inwards * self.widths, _FAR * least)


def normals_of(face: JudgedFace, points: Array) -> tuple[Array, Array]:
    """Return the places of a face's surface that are nearest to points, and its normals there."""
    if face.frame is not None:
        place, axes = face.frame
        off = (points - place) @ axes[2]
        return points - off[:, None] * axes[2], np.broadcast_to(axes[2], points.shape)
    assert face.surface is not None
    place, along_u, along_v = face.surface.at(*face.surface.locate(points))
    normals = np.cross(along_u, along_v) * (1.0 if face.face.same_sense else -1.0)
    return place, normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
