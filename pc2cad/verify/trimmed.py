"""Faces that other bodies have cut: parts of sides within the edges of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.topology.cells import Cell, directions_of
from pc2cad.verify.beside import normals_of
from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.faces import JudgedFace, judge_trimmed
from pc2cad.verify.membership import Membership
from pc2cad.verify.patches import Moments, patch_moments
from pc2cad.verify.searching import CLOSED, Jet, Searched, Span
from pc2cad.verify.sides import Difference, Match, Sides, at_equal_parameters, distances

#: pieces of a side that are short enough for Gauss's rule, and samples of a search
_PIECES, _STARTS = 16, 33
#: of its size, by which a side may leave the box of its samples
_BESIDE = 0.05
#: share of a cell that places are looked at before and behind it, and of that where it is doubted
_STEP, _SHORTER = 0.02, 0.1


@dataclass(frozen=True, eq=False)
class SideSurface(Searched):
    """A patch of an equation's side as a surface in its local parameters."""

    sides: Sides
    cell: Cell
    periods: tuple[float | None, float | None]
    limits: tuple[Span, Span] = ((0.0, 1.0), (0.0, 1.0))
    points: tuple[int, int] = (12, 12)

    @classmethod
    def of(cls, sides: Sides, cell: Cell) -> SideSurface:
        """Return a patch, periodic in a direction if its two ends coincide."""
        t, ends = np.linspace(0.0, 1.0, 9), np.array([0.0, 1.0])
        across = sides.points(cell, ends[:, None], t), sides.points(cell, t[:, None], ends)
        size = max(float(np.ptp(part.reshape(-1, 3), axis=0).max()) for part in across)
        gaps = np.abs(across[0][0] - across[0][1]), np.abs(across[1][:, 0] - across[1][:, 1])
        u, v = (1.0 if gap.max() <= CLOSED * size else None for gap in gaps)
        return cls(sides, cell, (u, v))

    def at(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative at pairs of parameters, (len(u), 3) each."""
        return self.sides.frame(self.cell, self._inside(0, u), self._inside(1, v))

    def grid(self, u: Array, v: Array) -> Jet:
        """Return point, u and v derivative on the tensor grid, (len(u), len(v), 3) each."""
        return self.at(u[:, None], v[None, :])

    def locate(self, points: Array) -> tuple[Array, Array]:
        """Return the parameters of the nearest points."""
        return self.search(points)

    def may_hold(self, points: Array) -> Booleans:
        """Say which points are in the box round some samples, or beside it."""
        known = self.grid(self._samples(0), self._samples(1))[0].reshape(-1, 3)
        low, high = known.min(axis=0), known.max(axis=0)
        room = _BESIDE * float(np.linalg.norm(high - low))
        return np.asarray(((points >= low - room) & (points <= high + room)).all(axis=1))

    def breaks(self, axis: int, a: float, b: float) -> Array:
        """Return parameters from a to b between which the side is smooth and short."""
        inner = np.concatenate([self._breaks[axis] + turn for turn in (-1.0, 0.0, 1.0)])
        even = np.linspace(a, b, 1 + max(1, int(np.ceil(_PIECES * (b - a)))))
        return distinct(np.concatenate((even, inner[(inner > a) & (inner < b)])))

    def _samples(self, axis: int) -> Array:
        return distinct(np.concatenate((np.linspace(0.0, 1.0, _STARTS), self._breaks[axis])))

    @cached_property
    def _breaks(self) -> list[Array]:
        """Where M is not smooth along both of the patch's own parameters."""
        rows = []
        for d in directions_of(self.cell):
            low, high = self.sides.analysis.span(d, self.cell[d])
            places = np.array([b.position for b in self.sides.analysis.breaks[d]])
            rows.append((places[(places >= low) & (places <= high)] - low) / (high - low))
        return rows


@dataclass(frozen=True, eq=False)
class Grid:
    """Places in the middle of cells of a patch, and which of them bound the solid."""

    points: Array
    kept: Booleans
    #: rows of the same places, the unit normal there, and a step across
    rows: Array
    #: of all cells, and of those that may be on either side of an edge
    areas: Array
    open: Booleans
    #: and half of those at the rim, which an edge may cut off
    rim: float

    @classmethod
    def of_all(
        cls,
        patches: Sequence[tuple[Sides, Cell]],
        membership: Membership,
        count: int,
        least: float,
    ) -> list[Grid]:
        """Return the places of patches, `count` along both parameters, all looked at together."""
        t = (np.arange(count) + 0.5) / count
        places, areas, rows = [], [], []
        for sides, cell in patches:
            points, along_s, along_t = sides.frame(cell, t[:, None], t[None, :])
            normals = np.cross(along_s, along_t)
            sizes = np.linalg.norm(normals, axis=2)
            short = np.minimum(*(np.linalg.norm(part, axis=2) for part in (along_s, along_t)))
            unit = normals / np.maximum(sizes, 1e-300)[..., None]
            places.append(points)
            areas.append(sizes * (sides.areas[cell] / max(float(sizes.sum()), 1e-300)))
            rows.append(np.dstack((points, unit, short * (_STEP / count))).reshape(-1, 7))
        table = np.concatenate(rows)
        step = np.maximum(table[:, 6], least)
        turns = membership.turns(table[:, :3], table[:, 3:6], step)
        made = zip(places, np.split(turns != 0, len(patches)), rows, areas, strict=True)
        return [cls._made(*row) for row in made]

    def confirmed(self, membership: Membership, least: float) -> Array:
        """Return the places that bound the solid by a shorter step too, (n, 3)."""
        rows = self.rows[self.kept.ravel()]
        step = np.maximum(_SHORTER * rows[:, 6], least)
        return rows[membership.turns(rows[:, :3], rows[:, 3:6], step) != 0, :3]

    @classmethod
    def _made(cls, points: Array, flags: Booleans, rows: Array, areas: Array) -> Grid:
        kept = flags.reshape(areas.shape)
        open_ = np.zeros_like(kept)
        for axis in (0, 1):
            one, other = (np.moveaxis(part, axis, 0) for part in (kept, open_))
            differ = one[1:] != one[:-1]
            other[1:] |= differ
            other[:-1] |= differ
        rim = 0.5 * float(areas.sum() - areas[1:-1, 1:-1].sum())
        return cls(points, kept, rows, areas, open_, rim)


def compare_part(
    sides: Sides, name: str, patches: Sequence[Cell], face: JudgedFace, places: Array,
    tolerance: float,
) -> Match:  # fmt: skip
    """Hold a face that other bodies have cut against the patches of its side.

    `places` (n, 3) are those of the side that the face has to cover, or the faces on it together:
    those that are nearest to this one.
    """
    surface, turn = at_equal_parameters(sides, patches, face, tolerance)
    if turn is None or not surface.distance <= 10.0 * tolerance:
        turn = None
        off = distances(face, places) if len(places) else np.zeros(1)
        k = int(np.argmax(off))
        where = ", ".join(f"{x:.6g}" for x in places[k]) if len(places) else ""
        surface = Difference(float(off[k]), "the surface", f"at ({where})")
    edges = list(face.face.edges.values())
    own_places = (part for e in edges for part in (e.samples, e.places[::4]))
    points = np.concatenate([np.empty((0, 3)), *own_places])
    near = np.full(len(points), np.inf)
    for patch in patches:
        own = SideSurface.of(sides, patch)
        beside = near > 0.01 * tolerance
        if len(patches) > 1:
            beside &= own.may_hold(points)
        open_ = np.flatnonzero(beside)
        if len(open_):
            off = np.linalg.norm(own.at(*own.locate(points[open_]))[0] - points[open_], axis=1)
            near[open_] = np.fmin(near[open_], off)
    border = Difference(0.0, "the border", "")
    if len(points):
        k = int(np.argmax(near))
        x, y, z = points[k]
        border = Difference(float(near[k]), "the border", f"at ({x:.6g}, {y:.6g}, {z:.6g})")
    return Match(name, face, surface, border, 0.0, 0.0, tuple(patches), turn, trimmed=True)


def moments_on(match: Match, sides: Sides, origin: Array) -> Moments | None:
    """Return integrals over the side within the edges of its face, along the face's normal.

    None where they are those of the face, as far as is known: the side has the same surface, or
    cannot be integrated.
    """
    if match.nearness.rests_on == "exact" or (match.trimmed and len(match.patches) > 1):
        return None
    face = match.face
    loop = face.face.loops[0]
    corner = loop.edges[0][0].samples[0] if loop.edges else np.asarray(loop.vertex)
    total: Moments | None = None
    for patch in match.patches:
        own = SideSurface.of(sides, patch)
        if match.trimmed:
            try:
                asked = replace(face.face, same_sense=_same_sense(own, face))
                return judge_trimmed(own, asked, origin, np.inf).moments
            except StepDefectError:
                return None
        part = patch_moments(own, own.limits, origin, corner)
        total = part if total is None else total.plus(part)
    return total if total is None or _agree(total, face.moments) else total.times(-1.0)


def _agree(one: Moments, other: Moments) -> bool:
    """Say whether integrals over the same places are along the same normal.

    The normal's own vanishes where it goes round: of whole turns of a thread.
    """
    alone = float(one.vector @ other.vector)
    return alone + float((one.first * other.first).sum()) / max(other.area, 1e-300) > 0.0


def _same_sense(side: SideSurface, face: JudgedFace) -> bool:
    """Say whether the normal of a side's parameters is that of a face, on an edge of it."""
    edge = face.face.loops[0].edges[0][0]
    place = edge.samples[[len(edge.samples) // 2]]
    _, along_s, along_t = side.at(*side.locate(place))
    return float((np.cross(along_s, along_t) * normals_of(face, place)[1]).sum()) > 0.0
