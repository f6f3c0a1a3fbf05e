"""Mass of pieces of bodies whose density is a field, from the pieces' faces.

In the box of its body, a density times det J is the derivative along one direction of what it sums
up to from a side there. So by the divergence theorem in the box the mass of a piece is the flux of
that sum G through its faces: ∫ G (M_d · n) / det J dA, with M inverted at the faces' places. Along
the direction the far side has to be a face; the sum begins at the other one, seam or pole or not.

As a parameter changes, so does the density times det J at a place of the box: the same flux of its
derivative. Where another body cuts the piece, its faces run ahead of the body by (W - V)·n besides.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.brep.booleans import unplaced
from pc2cad.brep.forms import PAIRS, Form
from pc2cad.brep.integrals import face_integrals, solid_integrals
from pc2cad.csg.moving import Moving
from pc2cad.csg.regions import Piece
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.field_rates import FieldRate
from pc2cad.domain.fields import local_field
from pc2cad.domain.velocity import LOOK
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
#: places of the box (…, 3) -> columns (…, columns)
Weights = Callable[[Array], Array]


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
            form = self._form(own, centre, self._weights(centre), 1.0)
            total += face_integrals(face, centre, form)[5:]
        mass, way = float(total[0]), total[1:4] / total[0]
        rows = zip(PAIRS, total[4:], strict=True)
        second = symmetric(PAIRS, (value - mass * way[i] * way[j] for (i, j), value in rows))
        x, y, z = (centre + way).tolist()
        source = "B-rep (divergence theorem, the density summed up along the equation)"
        return made(
            mass, (x, y, z), second, max(error, self.doubt), source, mass / whole.volume
        )  # fmt: skip

    def change(self, piece: Piece, moving: Moving, centre: Array) -> Array:
        """Return how mass, first and second moments of a piece about a centre change (columns,)."""
        copy, total = moving.copy(self.name), np.zeros(COLUMNS)
        rate = FieldRate(self._field, copy.variation, self._largest)
        changes = self._changes(centre, moving, rate)
        grid = np.ix_(LOOK, LOOK, LOOK)
        points, speed = self._analysis.map.points(*grid), copy.velocity.frame(*grid)[0]
        fades = float(np.abs(rate(grid[0], grid[1], grid[2], points, speed)[1]).max())
        own_rate = copy.rate / self._analysis.scale.size + fades
        for face, keys in piece.faces:
            own = next((key for key in keys if key.body == self.name), None)
            if own_rate:
                form = self._form(own, centre, changes, own_rate)
                total += face_integrals(face, centre, form)[5:]
            if own is None and (copy.rate or moving.copy(keys[0].body).rate):
                form = self._ahead(keys[0], moving, centre)
                total += face_integrals(face, centre, form)[5:]
        return total

    def _form(self, own: SideKey | None, centre: Array, weights: Weights, rate: float) -> Form:
        """Return the flux of what weights sum up to, which are at most `rate` of the density's."""

        def columns(points: Array, normals: Array) -> Array:
            place = self._place
            local = self._local(points, centre, own)
            across = (self._tangent(local) * (normals @ place.turn)).sum(axis=1)
            parts = range(0, len(local), CHUNK)
            sums = np.concatenate([self._sums(local[k : k + CHUNK], weights) for k in parts])
            return np.asarray(sums * across[:, None])

        return Form(columns, self._most(rate * self._analysis.scale.size))

    def _ahead(self, key: SideKey, moving: Moving, centre: Array) -> Form:
        """Return the density's moments times (W - V)·n on a face where another body cuts."""
        copy, at = moving.copy(self.name), moving.copy(key.body).side(key)

        def columns(points: Array, normals: Array) -> Array:
            local = self._local(points, centre, None)
            before = self._analysis.map.points(*local.T)
            speed = copy.placed(before, copy.velocity.frame(*local.T)[0])
            ahead = ((at(points + centre)[0] - speed) * normals).sum(axis=1)
            density = self._field.at(local[:, 0], local[:, 1], local[:, 2], before)[..., 0]
            return np.asarray((density * ahead)[:, None] * _moments(points))

        return Form(columns, self._most(copy.rate + moving.copy(key.body).rate))

    def _most(self, height: float) -> Callable[[float], Array]:
        """Return what columns are at most, for a density of so much height."""

        def most(reach: float) -> Array:
            return self._largest * height * np.repeat([1.0, reach, reach * reach], [1, 3, 6])

        return most

    def _local(self, about: Array, centre: Array, own: SideKey | None) -> Array:
        """Return where places of a face lie in the box, on a side of the body or inside."""
        points = (about + centre - self._place.offset) @ self._place.turn
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

    def _sums(self, local: Array, weights: Weights) -> Array:
        """Return the integrals of weights from the start to places, (n, columns)."""
        d = self._direction
        cuts = sorted({0.0, 1.0, *self._field.breaks[d], *self._inner(d)})
        found = [self._rule(local, weights, cuts, count) for count in (NODES, FEWER)]
        largest = float(np.abs(found[0][:, 0]).max(initial=0.0))
        if largest:
            gap = float(np.abs(found[0][:, 0] - found[1][:, 0]).max()) / largest
            self.doubt = max(self.doubt, gap)
        return found[0]

    def _inner(self, d: int) -> list[float]:
        return [b.position for b in self._analysis.breaks[d] if 0 < b.position < 1]

    def _rule(self, local: Array, weights: Weights, cuts: list[float], count: int) -> Array:
        x, shares = gauss(count)
        total = np.zeros((len(local), COLUMNS))
        for low, high in itertools.pairwise(cuts):
            start = np.clip(self._start, low, high)
            half = (np.clip(local[:, self._direction], low, high) - start) / 2
            places = np.repeat(local[:, None], count, axis=1)
            places[..., self._direction] = start + half[:, None] * (1 + x)
            total += np.einsum("nk,nkc->nc", half[:, None] * shares, weights(places))
        return total

    def _weights(self, centre: Array) -> Weights:
        """Return what gives ρ (1, r, r r) det J at places."""

        def at(places: Array) -> Array:
            u, v, w = np.moveaxis(places, -1, 0)
            points, *tangents = self._analysis.map.frame(u, v, w)
            dm = self._field.at(u, v, w, points)[..., 0] * _det(tangents)
            return dm[..., None] * _moments(self._there(points) - centre)

        return at

    def _changes(self, centre: Array, moving: Moving, rate: FieldRate) -> Weights:
        """Return what gives the derivative of that at places of the box."""
        copy = moving.copy(self.name)

        def at(places: Array) -> Array:
            u, v, w = np.moveaxis(places, -1, 0)
            points, *tangents = self._analysis.map.frame(u, v, w)
            speed, *speeds = copy.velocity.frame(u, v, w)
            density, fade = (self._largest * x for x in rate(u, v, w, points, speed))
            a, b, c = tangents
            terms = (speeds[0], b, c), (a, speeds[1], c), (a, b, speeds[2])
            det = _det(tangents)
            dm, change = density * det, fade * det + density * sum(_det([*t]) for t in terms)
            r, moved = self._there(points) - centre, copy.placed(points, speed)
            turned = _moments(r, moved)
            return np.asarray(change[..., None] * _moments(r) + dm[..., None] * turned)

        return at

    def _there(self, points: Array) -> Array:
        return np.asarray(points @ self._place.turn.T + self._place.offset)


def _moments(r: Array, moved: Array | None = None) -> Array:
    """Return 1, r and r r of places (…, 3), or how these change as the places move, (…, 10)."""
    if moved is None:
        rows = [np.ones(r.shape[:-1])[..., None], r]
        second = [r[..., i] * r[..., j] for i, j in PAIRS]
    else:
        rows = [np.zeros(r.shape[:-1])[..., None], moved]
        second = [moved[..., i] * r[..., j] + r[..., i] * moved[..., j] for i, j in PAIRS]
    return np.concatenate((*rows, np.stack(second, axis=-1)), axis=-1)


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
