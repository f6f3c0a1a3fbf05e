"""A face of a file held against a side of the equation: nearness both ways, border and area."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product as pairs
from typing import TypeAlias, get_args

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.tree import Expr, number
from pc2cad.geometry.carriers import Evidence
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import Cell, directions_of
from pc2cad.verify.arc_courses import arc_course
from pc2cad.verify.edges import Edge
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.inversion import closest, nearest
from pc2cad.verify.nearness import SEEN, Nearness
from pc2cad.verify.splines import SplineSurface, knots_in

#: whether the axes are swapped, and which of a surface's own run backwards
Turn: TypeAlias = tuple[bool, bool, bool]
#: samples of a side in each direction, and of a spline per span; at most so many
_SAMPLES, _PER_SPAN, _MOST = 25, 3, 241
#: samples of a border from which a search starts
_BORDER = 129
#: share of a step beside it, at which a step of these samples is none
_TWINS = 0.01
#: uneven places: at even ones a rational circle agrees with any other
_ROUGH = np.array([0.0, 0.0937, 0.2641, 0.4178, 0.5923, 0.7319, 0.9212, 1.0])
#: relative difference of areas that quadrature leaves open
_AREA = 1e-6


def weakest(evidence: Iterable[Evidence]) -> Evidence:
    """Return the weakest of several kinds of evidence."""
    found, kinds = set(evidence), get_args(Evidence)
    return max(found, key=kinds.index, default="sampled")


@dataclass(frozen=True)
class Difference:
    """How far a face is from a side, where that is largest, and what is compared."""

    distance: float
    what: str
    place: str


@dataclass(frozen=True, eq=False)
class Match:
    """A face of the file and the side that it is held against."""

    name: str
    face: JudgedFace
    #: largest distance of the side from the face, and of the face's border from the side's
    surface: Difference
    border: Difference
    #: of the areas, absolute and beyond what is allowed
    area: float
    excess: float
    #: the side's patches that the face covers
    patches: tuple[Cell, ...]
    #: how the face runs over its only patch at equal parameters, so that both cover each other
    turn: Turn | None
    #: whether the face is what other bodies leave of the side
    trimmed: bool = False
    #: how far the side is from the surface, and what that rests on
    nearness: Nearness = SEEN
    #: and the side's edges from those of the face
    edges: Nearness = SEEN

    @property
    def equal_parameters(self) -> bool:
        """Whether places are compared at equal parameters."""
        return self.turn is not None

    @property
    def distance(self) -> float:
        """The largest distance seen or bounded."""
        return max(self.reach, self.border_reach)

    @property
    def border_reach(self) -> float:
        """The largest distance of the edges: a bound where there is one, else what was seen."""
        return max(self.border.distance, self.edges.distance)

    @property
    def evidence(self) -> Evidence:
        """What the distances of surface and edges rest on: the weaker of both."""
        return weakest([self.nearness.rests_on, self.edges.rests_on])

    @property
    def reach(self) -> float:
        """The largest distance of the surface: a bound where there is one, else what was seen."""
        return max(self.surface.distance, self.nearness.distance)


class Sides:
    """The sides of an equation on arrays; of a copy of a body, where it lies."""

    def __init__(
        self, analysis: Analysis, areas: Sequence[float], place: Placement | None = None
    ) -> None:
        self.analysis, self.place = analysis, place
        self.areas = dict(zip((f.patch for f in analysis.complex.faces), areas, strict=True))

    def groups(self) -> dict[str, list[Cell]]:
        """Return the patches of each name: of a whole side too, where it is in pieces."""
        complex_ = self.analysis.complex
        found: dict[str, list[Cell]] = {}
        for face in complex_.faces:
            key = complex_.key(face.patch)
            found.setdefault(key.label, []).append(face.patch)
            if key.is_piece:
                found.setdefault(key.whole.label, []).append(face.patch)
        return found

    def points(self, cell: Cell, *local: Array) -> Array:
        """Return M at broadcastable local parameters of a cell."""
        return self._moved(self.analysis.map.points(*self._places(cell, local)))

    def frame(self, cell: Cell, *local: Array) -> tuple[Array, Array, Array]:
        """Return M of a patch and its derivatives along both local parameters."""
        s, t = directions_of(cell)
        jet = self.analysis.map.frame(*self._places(cell, local))
        slopes = []
        for d in (s, t):
            low, high = self.analysis.span(d, cell[d])
            slopes.append(self._turned(jet[1 + d]) * (high - low))
        return self._moved(jet[0]), slopes[0], slopes[1]

    def trees(self, cell: Cell) -> tuple[tuple[Expr, ...], tuple[str, ...]]:
        """Return the coordinates on a cell as trees of its local parameters, and their names."""
        trees, names = RestrictedMap(self.analysis, cell).trees
        if self.place is None:
            return trees, names
        rows = zip(self.place.turn.tolist(), self.place.offset.tolist(), strict=True)
        return tuple(_combined(row, trees, offset) for row, offset in rows), names

    def _moved(self, points: Array) -> Array:
        return points if self.place is None else self._turned(points) + self.place.offset

    def _turned(self, vectors: Array) -> Array:
        return vectors if self.place is None else np.asarray(vectors @ self.place.turn.T)

    def _places(self, cell: Cell, local: Sequence[Array]) -> list[Array]:
        free = iter(local)
        spans = (self.analysis.span(d, position) for d, position in enumerate(cell))
        return [
            np.asarray(low + (high - low) * next(free) if position % 2 else low)
            for (low, high), position in zip(spans, cell, strict=True)
        ]

    def shown(self, cell: Cell, *local: float) -> str:
        """Return a place as the equation's parameters and as coordinates."""
        places = [float(x) for x in self._places(cell, [np.asarray(x) for x in local])]
        x, y, z = self._moved(self.analysis.map.points(*places))
        return f"{self.analysis.map.shown(places)}, at ({x:.6g}, {y:.6g}, {z:.6g})"

    def curve(self, cell: Cell, t: Array) -> tuple[Array, Array]:
        """Return points and derivatives along an edge."""
        (d,) = directions_of(cell)
        places = self._places(cell, [t])
        low, high = self.analysis.span(d, cell[d])
        points, slope = self.analysis.map.line(d, *places)
        return self._moved(points), self._turned(slope) * (high - low)

    def border(self, patches: Sequence[Cell]) -> list[Cell]:
        """Return the edges round patches, collapsed ones left out."""
        faces = {face.patch: face for face in self.analysis.complex.faces}
        uses = [use for patch in patches for use in faces[patch].uses]
        return list(dict.fromkeys(use.cell for use in uses if use.edge is not None))

    def rim(self, patches: Sequence[Cell]) -> list[Cell]:
        """Return the edges round patches, without seams and what two of the patches share."""
        faces = {face.patch: face for face in self.analysis.complex.faces}
        uses = [use for patch in patches for use in faces[patch].uses if use.edge is not None]
        often = Counter(use.edge for use in uses)
        return [use.cell for use in uses if often[use.edge] == 1]


def _combined(row: Sequence[float], trees: Sequence[Expr], offset: float) -> Expr:
    total = number(offset)
    for factor, tree in zip(row, trees, strict=True):
        if factor:
            total = total + number(factor) * tree
    return total


def compare(
    sides: Sides, name: str, patches: Sequence[Cell], face: JudgedFace, tolerance: float
) -> Match:
    """Hold a face against the patches of a side."""
    surface, turn = _surface(sides, patches, face, tolerance)
    own = sum(sides.areas[patch] for patch in patches)
    off = abs(face.moments.area - own)
    border = sum(edge.length for loop in face.face.loops for edge, _ in loop.edges)
    allowed = _AREA * own + min(face.moments.error, 1e-4) * own + tolerance * border
    # at equal parameters the border is that of the surface, which the edges are held against
    edge = Difference(0.0, "the border", "") if turn else _border(sides, patches, face, tolerance)
    return Match(name, face, surface, edge, off, max(0.0, off - allowed), tuple(patches), turn)


def _surface(
    sides: Sides, patches: Sequence[Cell], face: JudgedFace, tolerance: float
) -> tuple[Difference, Turn | None]:
    """Return the largest distance of a side from the surface of a face, and how both run alike."""
    surface, best = face.surface, None
    if _is_whole(face):
        found, best = at_equal_parameters(sides, patches, face, tolerance)
        if best is not None and found.distance <= 10.0 * tolerance:
            return found, best
    worst = Difference(0.0, "the surface", "")
    for patch in patches:
        line = np.linspace(0.0, 1.0, _SAMPLES)
        points = sides.points(patch, line[:, None], line[None, :]).reshape(-1, 3)
        off = distances(face, points)
        if best is not None and isinstance(surface, SplineSurface):
            off = np.fmin(off, _from_equal(surface, points, line, best))
        k = int(np.argmax(off))
        if not off[k] <= worst.distance:
            place = sides.shown(patch, float(line[k // _SAMPLES]), float(line[k % _SAMPLES]))
            worst = Difference(float(off[k]), "the surface", place)
    return worst, None


def at_equal_parameters(
    sides: Sides, patches: Sequence[Cell], face: JudgedFace, tolerance: float
) -> tuple[Difference, Turn | None]:
    """Return the largest distance of all of a spline from a patch, and how it runs over it.

    It is infinite where both are far apart at some places already; None for how it runs where there
    is no one patch, or no spline.
    """
    surface = face.surface
    nowhere = Difference(np.inf, "the surface", "")
    if not isinstance(surface, SplineSurface) or len(patches) != 1:
        return nowhere, None
    roughly = {turn: _apart(sides, patches[0], surface, turn, True)[0] for turn in _symmetries()}
    best = min(roughly, key=lambda turn: roughly[turn])
    if roughly[best] > 1e3 * tolerance:
        return nowhere, best
    distance, s, t = _apart(sides, patches[0], surface, best, False)
    return Difference(distance, "the surface", sides.shown(patches[0], s, t)), best


def distances(face: JudgedFace, points: Array) -> Array:
    """Return the distances of points from the surface of a face."""
    if face.frame is not None:
        place, axes = face.frame
        return np.abs(product(points - place, axes[2]))
    surface = face.surface
    assert surface is not None
    u, v = surface.search(points) if isinstance(surface, SplineSurface) else surface.locate(points)
    off = np.linalg.norm(surface.at(u, v)[0] - points, axis=1)
    return np.where(np.isfinite(off), off, np.inf)


def _from_equal(surface: SplineSurface, points: Array, line: Array, turn: Turn) -> Array:
    """Return the distances of a grid of points, searched for from equal parameters on."""
    swap, back_u, back_v = turn
    s, t = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    shares = (t, s) if swap else (s, t)
    start = [
        low + (high - low) * (1.0 - share if back else share)
        for share, back, (low, high) in zip(shares, (back_u, back_v), surface.limits, strict=True)
    ]
    u, v = surface.search(points, (start[0], start[1]))
    return np.asarray(np.linalg.norm(surface.at(u, v)[0] - points, axis=1))


def _is_whole(face: JudgedFace) -> bool:
    """Say whether a face covers all of its spline surface."""
    if face.rectangle is None or face.surface is None:
        return False
    spans = zip(face.rectangle, face.surface.limits, strict=True)
    return all(abs((b - a) - (d - c)) <= 1e-6 * (d - c) for (a, b), (c, d) in spans)


def _symmetries() -> Iterator[Turn]:
    yield from pairs((False, True), repeat=3)


def _apart(
    sides: Sides, patch: Cell, surface: SplineSurface, turn: Turn, rough: bool
) -> tuple[float, float, float]:
    """Return the largest distance at equal parameters, and where; by spans if not rough."""
    swap, back_u, back_v = turn
    own = []
    for axis, back in enumerate((back_u, back_v)):
        low, high = surface.limits[axis]
        t = low + (high - low) * _ROUGH if rough else _dense(surface, axis)
        share = (high - t if back else t - low) / (high - low)
        if surface.rational:
            trees, names = sides.trees(patch)
            weights = surface.poles[0, :, 3] if axis else surface.poles[:, 0, 3]
            course = arc_course(trees, names[axis ^ swap], surface.knots[axis], weights)
            share = course.places(share) if course else share
        own.append((t, share))
    (u, s), (v, t) = own
    values = surface.grid(u, v)[0]
    first, second = (t[None, :], s[:, None]) if swap else (s[:, None], t[None, :])
    wanted = sides.points(patch, first, second)
    off = np.linalg.norm(values - wanted, axis=2)
    off = np.where(np.isfinite(off), off, np.inf)
    i, j = np.unravel_index(int(np.argmax(off)), off.shape)
    place = (float(t[j]), float(s[i])) if swap else (float(s[i]), float(t[j]))
    return float(off[i, j]), *place


def _dense(surface: SplineSurface, axis: int) -> Array:
    spans = knots_in(surface.knots[axis], surface.limits[axis])
    per = max(1, min(max(_PER_SPAN, surface.degrees[axis] + 1), _MOST // (len(spans) - 1)))
    return distinct(np.linspace(spans[:-1], spans[1:], per + 1))


def _border(
    sides: Sides, patches: Sequence[Cell], face: JudgedFace, tolerance: float
) -> Difference:
    """Return the largest distance of a face's edges from those of the side, seams left out."""
    uses = Counter(edge.ref for loop in face.face.loops for edge, _ in loop.edges)
    edges = face.face.edges
    own = [edge for ref, edge in edges.items() if uses[ref] == 1]
    cells = sides.border(patches)
    if not own:
        return Difference(0.0, "the border", "")
    if not cells:
        return Difference(np.inf, "the border", "the side has none")
    points = np.concatenate([part for e in own for part in (e.samples, _some(e.places))])
    best = np.full(len(points), np.inf)
    start = _starts(own)
    near = 1e-12 * float(np.ptp(points, axis=0).max())
    held = []
    for cell in cells:
        known = sides.curve(cell, start)[0]
        step = 2.0 * np.linalg.norm(np.diff(known, axis=0), axis=1).max()
        off = np.linalg.norm(known[nearest(known, points)] - points, axis=1)
        best = np.fmin(best, off)
        held.append((cell, known, off <= step))
    # from the ends too: where a curve closes, the nearest sample may be on the other side of its
    # seam, and from a flat place the first step meets a steep one; from a cusp there is no step
    parts = slice(None), slice(1), slice(-1, None), slice(1, -1)
    for part, share in zip(parts, (0.1, 1.0, 1.0, 1.0), strict=True):
        for cell, known, beside in held:
            open_ = np.flatnonzero((best > max(near, share * tolerance)) & beside)
            if len(open_):
                along = partial(sides.curve, cell)
                t = closest(along, (start[part], 0.0, 1.0), points[open_], known[part])
                off = np.linalg.norm(along(t)[0] - points[open_], axis=1)
                best[open_] = np.fmin(best[open_], off)
    k = int(np.argmax(best))
    x, y, z = points[k]
    return Difference(float(best[k]), "the border", f"at ({x:.6g}, {y:.6g}, {z:.6g})")


def _starts(edges: Sequence[Edge]) -> Array:
    """Return places on an edge of the equation: evenly, and where edges of the file have knots."""
    found = [np.linspace(0.0, 1.0, _BORDER)]
    for edge in edges:
        low, high = sorted(edge.interval)
        breaks = edge.curve.breaks(low, high)
        shares = (np.linspace(breaks[:-1], breaks[1:], _PER_SPAN + 2).ravel() - low) / (high - low)
        found += [shares, 1.0 - shares]
    places = distinct(np.clip(np.concatenate(found), 0.0, 1.0))
    # some that nearly meet make the chords beside them short, and what is near them far
    gaps = np.diff(places)
    beside = np.concatenate((gaps[1:2], gaps, gaps[-2:-1]))
    twins = np.flatnonzero(gaps < _TWINS * np.maximum(beside[:-2], beside[2:]))
    return np.delete(places, np.minimum(twins + 1, len(places) - 2))


def _some(places: Array) -> Array:
    return places[:: max(1, len(places) // 32)]


def coarse(sides: Sides, patches: Sequence[Cell], face: JudgedFace) -> float:
    """Return roughly how far a face is from a side, to find the side that a face is on."""
    own = sum(sides.areas[patch] for patch in patches)
    s = np.linspace(0.0, 1.0, 5)
    grids = [sides.points(patch, *(x for x in open_grid(s, s, 0.0)[:2])) for patch in patches]
    off = max(float(distances(face, grid.reshape(-1, 3)).max()) for grid in grids)
    return max(off, float(abs(face.moments.area - own) / max(own, 1e-300) ** 0.5))


def goes_on(sides: Sides, patch: Cell, face: JudgedFace, tolerance: float) -> bool:
    """Say whether a patch lies on the surface of a face."""
    s = np.linspace(0.0, 1.0, 5)
    points = sides.points(patch, s[:, None], s[None, :]).reshape(-1, 3)
    return bool(distances(face, points).max() <= tolerance)
