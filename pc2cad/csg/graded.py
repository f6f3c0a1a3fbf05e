"""Mass of pieces of bodies whose density is a field, from the pieces' faces.

In the box of its body, a density times det J is the derivative along one direction of what it sums
up to from a side there. So by the divergence theorem in the box the mass of a piece is the flux of
that sum G through its faces: ∫ G (M_d · n) / det J dA, with M inverted at the faces' places. Along
the direction the far side has to be a face; the sum begins at the other one, seam or pole or not.
"""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.brep.booleans import unplaced
from pc2cad.brep.forms import PAIRS, Form
from pc2cad.brep.integrals import face_integrals, solid_integrals
from pc2cad.csg.regions import Piece
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.fields import local_field
from pc2cad.errors import InputError
from pc2cad.integrals.fields import check_density
from pc2cad.integrals.inertia import Mass, made
from pc2cad.integrals.quadrature import gauss
from pc2cad.part import Body
from pc2cad.sampling.inversion import Inverse
from pc2cad.sampling.on_sides import SidePlaces
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import SideKey, normal_direction

#: mass, first and second moments
COLUMNS = 10
#: nodes in each smooth part of a line, and those that they are held against
NODES, FEWER = 16, 12
#: places of faces whose sums are taken at once
CHUNK = 4000
#: how far a face may be from its own body, as a share of the part's size
OUTSIDE = 1e-5


class NoFaceAcrossError(InputError):
    """No direction of a body ends in a face, so that a field over parts of it is not summed up."""


class Graded:
    """A body, or a copy of it, with a field as its density."""

    def __init__(self, body: Body, name: str, field: str, place: Placement) -> None:
        self._body, self._place, self.name = body, place, name
        self._analysis = body.checked.analysis
        self._field = local_field(self._analysis, field)
        self._largest = check_density(self._analysis, self._field)
        self._direction, self._start = _across(self._analysis, name)
        self._sides: dict[SideKey, SidePlaces] = {}
        #: relative difference of two rules along lines, the largest one seen
        self.doubt = 0.0

    def mass(self, piece: Piece, error: float) -> Mass:
        """Return the mass properties of a piece that is made of the body."""
        whole = solid_integrals(piece.solid)
        centre = np.array(whole.centroid)
        total = np.zeros(COLUMNS)
        for face, keys in piece.faces:
            own = next((key for key in keys if key.body == self.name), None)
            total += face_integrals(face, centre, self._form(own, centre))[5:]
        mass, way = float(total[0]), total[1:4] / total[0]
        rows = zip(PAIRS, total[4:], strict=True)
        second = symmetric(PAIRS, (value - mass * way[i] * way[j] for (i, j), value in rows))
        x, y, z = (centre + way).tolist()
        source = "B-rep (divergence theorem, the density summed up along the equation)"
        return made(
            mass, (x, y, z), second, max(error, self.doubt), source, mass / whole.volume
        )  # fmt: skip

    def _form(self, own: SideKey | None, centre: Array) -> Form:
        def columns(points: Array, normals: Array) -> Array:
            place = self._place
            before = (points + centre - place.offset) @ place.turn
            local = self._local(before, own)
            across = (self._tangent(local) * (normals @ place.turn)).sum(axis=1)
            parts = range(0, len(local), CHUNK)
            sums = np.concatenate([self._sums(local[k : k + CHUNK], centre) for k in parts])
            return np.asarray(sums * across[:, None])

        size = self._analysis.scale.size

        def most(reach: float) -> Array:
            return self._largest * size * np.repeat([1.0, reach, reach * reach], [1, 3, 6])

        return Form(columns, most)

    def _local(self, points: Array, own: SideKey | None) -> Array:
        """Return where places of a face lie in the box, on a side of the body or inside."""
        if own is not None:
            if own not in self._sides:
                patches = self._body.patches(unplaced(own))
                self._sides[own] = SidePlaces(self._analysis, patches)
            return self._sides[own](points)
        local, gaps = self._inverse.inside(points)
        if not gaps.max(initial=0.0) <= OUTSIDE * self._analysis.scale.size:
            raise InputError(f"a piece of {self.name} has faces outside of it: M is not inverted")
        return local

    @cached_property
    def _inverse(self) -> Inverse:
        return Inverse(self._analysis)

    def _tangent(self, local: Array) -> Array:
        """Return M_d / det J at local places; 0 where det J vanishes, and so does the sum."""
        _, *tangents = self._analysis.map.frame(*local.T)
        det = _det(tangents)[:, None]
        along = tangents[self._direction]
        return np.divide(along, det, out=np.zeros_like(along), where=det != 0)

    def _sums(self, local: Array, centre: Array) -> Array:
        """Return ∫ ρ (1, r, r r) det J from the start to places, (n, columns)."""
        d = self._direction
        cuts = sorted({0.0, 1.0, *self._field.breaks[d], *self._inner(d)})
        found = [self._rule(local, centre, cuts, count) for count in (NODES, FEWER)]
        largest = float(np.abs(found[0][:, 0]).max(initial=0.0))
        if largest:
            gap = float(np.abs(found[0][:, 0] - found[1][:, 0]).max()) / largest
            self.doubt = max(self.doubt, gap)
        return found[0]

    def _inner(self, d: int) -> list[float]:
        return [b.position for b in self._analysis.breaks[d] if 0 < b.position < 1]

    def _rule(self, local: Array, centre: Array, cuts: list[float], count: int) -> Array:
        x, weights = gauss(count)
        total = np.zeros((len(local), COLUMNS))
        for low, high in itertools.pairwise(cuts):
            start = np.clip(self._start, low, high)
            half = (np.clip(local[:, self._direction], low, high) - start) / 2
            places = np.repeat(local[:, None], count, axis=1)
            places[..., self._direction] = start + half[:, None] * (1 + x)
            u, v, w = np.moveaxis(places, -1, 0)
            points, *tangents = self._analysis.map.frame(u, v, w)
            density = self._field.at(u, v, w, points)[..., 0]
            r = points @ self._place.turn.T + self._place.offset - centre
            dm = density * _det(tangents) * weights * half[:, None]
            total[:, 0] += dm.sum(axis=1)
            total[:, 1:4] += (dm[..., None] * r).sum(axis=1)
            for k, (i, j) in enumerate(PAIRS):
                total[:, 4 + k] += (dm * r[..., i] * r[..., j]).sum(axis=1)
        return total


def _det(tangents: list[Array]) -> Array:
    return np.asarray((tangents[0] * np.cross(tangents[1], tangents[2])).sum(axis=-1))


def _across(analysis: Analysis, name: str) -> tuple[int, float]:
    """Return a direction and the limit at which sums begin: its other limit is a face all over."""
    for d in (2, 1, 0):
        for limit in (True, False):
            fates = [
                side.fate for side in analysis.boundary.sides
                if normal_direction(side.patch) == d and (side.patch[d] > 0) == limit
            ]  # fmt: skip
            if fates and all(fate == "face" for fate in fates):
                return d, 0.0 if limit else 1.0
    raise NoFaceAcrossError(
        f"{name} ends in a face along none of u, v and w: its density as a field over parts of it "
        "is not summed up; give it a number"
    )
