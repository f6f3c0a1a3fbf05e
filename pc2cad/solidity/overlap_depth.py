"""How deep an overlap is that was found: how far a face runs into the solid on the other side.

From a place where the boundary meets itself each of the two faces is followed to where its points
have a second place of the box. The depth of a place is its distance from the boundary, of which
places near it in the box are no part; faces between layers are taken as the boundary's are. There
may be deeper ones: it is no bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.pieces import span_at
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.solidity.nearest_places import descended
from pc2cad.solidity.self_intersection import TOUCHING

#: a face (its index) and a place of it
_Place = tuple[int, Array]
#: samples of every face along both of its parameters, and about where it meets another
_PLACES = 41
_ABOUT = np.concatenate(([0.0], *[(x, -x) for x in np.geomspace(1e-4, 0.2, 8)]), axis=None)
#: steps of a search
_FEW = 12
#: first steps away from the contact, and how often the step of the deepest of them is halved
_STEPS, _HALVINGS = (1e-6, 1e-4, 1e-3, 1e-2, 0.05, 0.2), 6
#: how far in the box the second place of a point may be from that of the point before
_REACH = 0.3
#: places along each parameter of the box whose images are looked at beside samples of the faces
#: (every fifth), how many of the nearest, and how far in the box a second place has to be
_INNER, _FIFTH, _CLOSE, _FAR = 12, 5, 40, 0.25
_WAYS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of one face on a grid of its own parameters."""

    face: int
    function: RestrictedMap
    nodes: tuple[Array, Array]

    @cached_property
    def points(self) -> Array:
        return self.function(*self.nodes)

    @cached_property
    def boxed(self) -> Array:
        """The places in the box, (n, m, 3)."""
        s, t = self.nodes
        places = self.function.places(s[:, None], t)
        return np.stack(np.broadcast_arrays(*places), axis=-1)

    @cached_property
    def cell(self) -> float:
        """How far a place may be from the nearest sample."""
        steps = [np.diff(self.points, axis=k) for k in (0, 1)]
        return max(float(np.linalg.norm(step, axis=-1).max()) for step in steps)


@dataclass(frozen=True, eq=False)
class _Boundary:
    """All faces with samples, denser about the places where two of them meet."""

    analysis: Analysis
    contact: Sequence[_Place]

    @cached_property
    def functions(self) -> list[RestrictedMap]:
        return [RestrictedMap(self.analysis, face.patch) for face in self.analysis.complex.faces]

    @cached_property
    def samples(self) -> list[_Samples]:
        even = np.linspace(0.0, 1.0, _PLACES)
        found = [_Samples(k, f, (even, even)) for k, f in enumerate(self.functions)]
        for face, place in self.contact:
            s, t = (distinct(np.clip(x + _ABOUT, 0.0, 1.0)) for x in place)
            found.append(_Samples(face, self.functions[face], (s, t)))
        return found

    @cached_property
    def closed(self) -> Array:
        """Which directions end where they begin."""
        result = []
        places = np.array(np.meshgrid(*[[0.1, 0.4, 0.8]] * 2)).reshape(2, -1)
        for d in range(3):
            ends = [
                self.analysis.map.points(*np.insert(places, d, end, axis=0)) for end in (0.0, 1.0)
            ]
            result.append(np.abs(ends[0] - ends[1]).max() <= self.analysis.scale.same_point)
        return np.array(result)

    def apart(self, one: Array, other: Array) -> Array:
        """Return how far places of the box are from one another, the short way round."""
        steps = np.abs(one - other)
        return np.asarray(np.where(self.closed, np.minimum(steps, 1 - steps), steps).max(axis=-1))

    def depth(self, from_: Array, point: Array, away: float, known: Sequence[_Place] = ()) -> float:
        """Return how far a point is from the boundary further than `away` from a place of the box.

        `known` are first guesses.
        """
        starts: list[tuple[float, _Place]] = []
        for each in self.samples:
            gap = each.points - point
            square = np.einsum("ijk,ijk->ij", gap, gap)
            square[self.apart(each.boxed, from_) < away] = np.inf
            i, j = np.unravel_index(int(square.argmin()), square.shape)
            if np.isfinite(square[i, j]):
                near = max(0.0, float(np.sqrt(square[i, j])) - each.cell)
                starts.append((near, (each.face, np.array([each.nodes[0][i], each.nodes[1][j]]))))
        starts.sort(key=lambda each: each[0])
        best = np.inf
        for near, (index, start) in [*((0.0, each) for each in known), *starts]:
            if near > best:
                break
            function = self.functions[index]

            def gap_at(x: Array, function: RestrictedMap = function) -> Array:
                return function.at(x[..., 0], x[..., 1]) - point

            found = descended(gap_at, start, 2 / _PLACES, _FEW)
            best = min(best, float(np.linalg.norm(function.at(*found) - point)))
        return best

    def beside(self, place: Array) -> _Place:
        """Return the place of a face that is nearest to a place of the box, in the box."""
        best, found = np.inf, (0, np.zeros(2))
        for k, function in enumerate(self.functions):
            step, local = 0.0, []
            for x, row, position in zip(place, self.analysis.bounds, function.cell, strict=True):
                low, high = span_at(row, position)
                near = min(max(float(x), low), high)
                step = max(step, abs(float(x) - near))
                if position % 2:
                    local.append((near - low) / (high - low))
            if step < best:
                best, found = step, (k, np.array(local))
        return found

    def inside(self, point: Array, start: Array) -> Array | None:
        """Return the place of the box that has a point, near another place, or None."""
        place = start.copy()
        for _ in range(_FEW):
            here, *ways = self.analysis.map.frame(*place)
            gap = point - here
            if np.linalg.norm(gap) <= self.analysis.scale.same_point:
                return place if (place >= 0).all() and (place <= 1).all() else None
            if not np.isfinite(ways).all():
                return None  # it is a root's limit: no way leads on from there
            place = place + np.linalg.lstsq(np.stack(ways, axis=-1), gap, rcond=None)[0]
            if not (np.abs(place - start) < _REACH).all():
                return None
        return None


def overlap_depth(
    analysis: Analysis, functions: Sequence[RestrictedMap], places: Sequence[Sequence[float]]
) -> float:
    """Return how deep the boundary runs into the solid near where it meets itself.

    `functions` are the two faces that meet, `places` their own parameters there. 0 where nothing
    deeper than a touch is found.
    """
    cells = [face.patch for face in analysis.complex.faces]
    contact = [
        (cells.index(f.cell), np.array(place, dtype=float))
        for f, place in zip(functions, places, strict=True)
    ]
    boundary = _Boundary(analysis, contact)
    ends = [np.array(f.place(*place)) for f, place in zip(functions, places, strict=True)]
    away = float(boundary.apart(ends[0], ends[1])) / 2
    if away == 0:
        return 0.0
    deepest = max(_followed(boundary, contact[k], contact[1 - k], away) for k in (0, 1))
    if deepest <= analysis.scale.same_point:
        deepest = _elsewhere(boundary)  # ends may touch there, and turns lie in one another
    return deepest if deepest > analysis.scale.same_point else 0.0


def _elsewhere(boundary: _Boundary) -> float:
    """Return how deep samples of the faces lie that have a second place far from their own."""
    from scipy.spatial import cKDTree  # late: only what is refused needs it

    nodes = (np.arange(_INNER) + 0.5) / _INNER
    inner = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    images = boundary.analysis.map.points(*inner.T)
    tree, deepest = cKDTree(images), 0.0
    for each in boundary.samples[: len(boundary.functions)]:
        points, places = (x[::_FIFTH, ::_FIFTH].reshape(-1, 3) for x in (each.points, each.boxed))
        near = tree.query(points, k=_CLOSE)[1]
        for point, place, row in zip(points, places, near, strict=True):
            far = row[boundary.apart(inner[row], place) >= _FAR]
            second = boundary.inside(point, inner[far[0]]) if len(far) else None
            if second is None:
                continue
            away = float(boundary.apart(second, place)) / 2
            if away >= _FAR / 2:
                deepest = max(
                    deepest, boundary.depth(place, point, away, [boundary.beside(second)])
                )
    return deepest


def told_depth(depth: float, analysis: Analysis) -> str:
    """Say that the map covers itself, and how deep where that is known."""
    if depth <= TOUCHING * analysis.size:  # what is searched for and found to that is none
        return "the map covers itself, or touches"
    return f"the map covers itself, {depth:.2g} {analysis.equation.units} deep or more"


def _followed(boundary: _Boundary, start: _Place, other: _Place, away: float) -> float:
    """Return how deep a face runs, from a place where it meets another.

    A place counts if it has another place of the box, found from that of the last one.
    """
    function = boundary.functions[start[0]]
    best, place, step = 0.0, start[1], 0.0
    twin = np.array(boundary.functions[other[0]].place(*other[1]))

    def look(middle: Array, reach: float) -> None:
        nonlocal best, place, twin, step
        for way in _WAYS:
            tried = np.clip(middle + reach * way, 0.0, 1.0)
            point, here = function.at(*tried), np.array(function.place(*tried))
            second = boundary.inside(point, twin)
            if second is None or boundary.apart(second, here) < away:
                continue
            found = boundary.depth(here, point, away, [other, boundary.beside(second)])
            if found > best:
                best, place, twin, step = found, tried, second, reach

    for reach in _STEPS:
        look(place, reach)
    for _ in range(_HALVINGS if best > 0 else 0):
        half = step / 2
        look(place, half)
        step = half
    return best
