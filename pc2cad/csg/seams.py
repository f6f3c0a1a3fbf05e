"""Seams and poles are out of other bodies' way before bodies are joined.

A seam is where a face comes round to itself, and a pole where it is drawn together in a point:
places of its parameters, and the kernel's curves go wrong there. Each body is looked at, with all
of its copies, where they lie: which of its seams and poles does the boundary of another body come
near? Where it does,

    turned   a body that a turn carries onto itself begins elsewhere, where no other comes near
    kept     where a boundary goes all the way round a face, this begins somewhere on its rim: the
             seam may stay, if the rim crosses it at an angle; the rim begins and ends there
    halved   any other is cut in halves: what was a seam is an edge, and poles are at faces' ends

Places are looked for by descents (sampled) from what boxes and nets do not part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array
from pc2cad.arrays.scatter import scattered
from pc2cad.brep.booleans import NamedShape, original
from pc2cad.brep.build import build
from pc2cad.brep.pieces import Piece, boxes_apart, moved_box, pieces_of
from pc2cad.brep.seams import Seam, seams_of
from pc2cad.csg.contacts import CROSSING, ZERO, nearest_places
from pc2cad.csg.moving import places
from pc2cad.part import Body
from pc2cad.representation.turning import Roundness, roundness, turned
from pc2cad.templates.bodies import Tree
from pc2cad.templates.patterns import Placement

#: share of a body's size from which on others are far from its seams and poles
NEAR = 1e-2
#: sine of the angle from which on an edge crosses a seam, and does not run along it
CROSSES = 0.2
#: places at which a face may begin instead, those of them that are looked at closely, and those of
#: a ball, which has poles as well
STARTS, CLOSELY, OF_BALL = 24, 3, 96
#: share of a seam within which a place is its end
AT_END = 1e-9
#: why a body is cut in halves
MET = "another body comes near its seam or a pole"
BORED = "another body bores its face, which goes from pole to pole"


@dataclass(frozen=True, eq=False)
class Turn:
    """A turn (3, 3) about a place (3,) that carries a body onto itself."""

    centre: Array
    matrix: Array

    def of(self, body: Body) -> Body:
        """Return a body that begins elsewhere."""
        model = turned(body.model, self.centre, self.matrix)
        return replace(body, model=model, built=build(model))


@dataclass(frozen=True, eq=False)
class Prepared:
    """Bodies as they are to be joined, which of them are turned, and what was done in words."""

    parts: Mapping[str, Body]
    turns: Mapping[str, Turn] = field(default_factory=dict)
    words: tuple[str, ...] = ()

    def turned(self, name: str, body: Body) -> Body:
        """Return a body that was made anew, as the one of that name is turned."""
        return self.turns[name].of(body) if name in self.turns else body


def prepared(result: Tree, parts: Mapping[str, Body], halve: Callable[[Body], Body]) -> Prepared:
    """Return the bodies of a Boolean tree with seams and poles out of the others' way.

    `halve` returns a body with what closes cut in halves, or as it is.
    """
    outlines = {name: _Outline(body) for name, body in parts.items()}
    lying = list(places(result))
    made, turns, words = dict(parts), {}, []
    for name, body in parts.items():
        about = _About(outlines[name], tuple(_others(name, lying, outlines)))
        way = about.way()
        if isinstance(way, Turn):
            turns[name] = way
            made[name] = way.of(body)
            words.append(f"{name} is turned to begin elsewhere: {MET}")
        elif way:
            made[name] = halve(body)
            if made[name] is not body:
                words.append(f"{name} is cut in halves where it closes: {way}")
    return Prepared(made, turns, tuple(words))


class _Outline:
    """A body's boundary, and the seams and poles of its faces."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self.size = body.report.size
        faces = tuple((face, (key,)) for key, face in body.kernel_sides.items())
        self._shape = NamedShape(body.shape, faces)

    @cached_property
    def seams(self) -> tuple[Seam, ...]:
        """Its seams and poles."""
        return tuple(seams_of(self._shape))

    @cached_property
    def box(self) -> Array:
        """Corners of a box round it, (2, 3)."""
        boxes = np.array([piece.box for piece in self.pieces])
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @cached_property
    def rimless(self) -> tuple[Piece, ...]:
        """Faces from pole to pole: of a hole in one the file has nothing to tell the face from."""
        edges = set().union(*(piece.edges for piece in self.pieces if len(piece.low) == 1))
        poles = {seam.piece.names for seam in self.seams if seam.is_pole}
        return tuple(
            piece for piece in self.pieces
            if len(piece.low) == 2 and piece.names in poles and edges.isdisjoint(piece.edges)
        )  # fmt: skip

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Its faces, and the edges between two of them."""
        found = pieces_of(self._shape)
        uses = [number for face in found.faces for number in face.edges]
        edges = (piece for number, piece in found.edges.items() if uses.count(number) > 1)
        return (*found.faces, *edges)

    @cached_property
    def round(self) -> Roundness | None:
        """What it may be turned about."""
        return roundness(self._body.model)


@dataclass(frozen=True, eq=False)
class _Other:
    """Another body as it lies to one: that one's x is its `turn` x + `offset`."""

    outline: _Outline
    turn: Array
    offset: Array


def _others(
    name: str, lying: Sequence[tuple[str, Placement]], outlines: Mapping[str, _Outline]
) -> Iterator[_Other]:
    """Yield the bodies and copies that come near a body or a copy of it, as they lie to that."""
    rows = [
        moved_box(outlines[original(other)].box, place.turn, place.offset) for other, place in lying
    ]
    boxes, near = np.array(rows), NEAR * outlines[name].size
    for k, (own, place) in enumerate(lying):
        if original(own) != name:
            continue
        gaps = np.maximum(boxes[k, 0] - boxes[:, 1], boxes[:, 0] - boxes[k, 1]).max(axis=1)
        for other, there in (lying[i] for i in np.flatnonzero(gaps <= near).tolist()):
            if other != own:
                turn = there.turn.T @ place.turn
                offset = there.turn.T @ (place.offset - there.offset)
                yield _Other(outlines[original(other)], turn, offset)


@dataclass(frozen=True, eq=False)
class _Meeting:
    """A place of a seam, (k,), that is near a piece of another body, and where on that, (m,)."""

    other: _Other
    piece: Piece
    at: Array
    there: Array


@dataclass(frozen=True, eq=False)
class _About:
    """A body, and the others about it."""

    outline: _Outline
    others: tuple[_Other, ...]

    def way(self) -> Turn | str:
        """Return what becomes of the body: a turn, why it is halved, or nothing."""
        seams = self.outline.seams if self.others else ()
        if self._are_clear(seams):
            return BORED if self._is_bored() else ""
        turns = [] if self.outline.round is None else self._turns(self.outline.round)
        turns = sorted(turns, key=self._room, reverse=True)[:CLOSELY]
        clear = [turn for turn in turns if self._are_clear(_turned(seams, turn))]
        if clear and not self.outline.rimless:
            return clear[0]
        for way in (None, *(turn for turn in turns if turn not in clear)):
            if all(map(self._may_stay, _turned(seams, way))):
                return way or ""
        return MET

    # -- what is met ---------------------------------------------------------------------------

    def _is_bored(self) -> bool:
        """Say whether others come near a face that no edge bounds, and not near its seam."""
        faces = (Seam(face) for face in self.outline.rimless)
        return any(True for face in faces for _ in self._meetings(face))

    def _meetings(self, seam: Seam) -> Iterator[_Meeting]:
        """Yield the places of a seam or a pole that other bodies come near, by descents."""
        near = NEAR * self.outline.size
        for other in self.others:
            here = seam.piece.moved(other.turn, other.offset)
            if boxes_apart(here.box, other.outline.box) > near:
                continue
            for piece in other.outline.pieces:
                if not here.may_meet(piece, near):
                    continue
                x, y, gaps = nearest_places(here, piece, ZERO * self.outline.size)
                close = np.flatnonzero(gaps <= near)
                if len(close):  # many descents end in one place
                    ends = np.round(np.hstack((x, y))[close], 6)
                    close = close[np.unique(ends, axis=0, return_index=True)[1]]
                    close = close[piece.holds(y[close])]
                yield from (_Meeting(other, piece, x[k], y[k]) for k in close)

    def _are_clear(self, seams: Sequence[Seam]) -> bool:
        return not any(True for seam in seams for _ in self._meetings(seam))

    def _may_stay(self, seam: Seam) -> bool:
        """Say whether nothing is near a seam, or it would be wherever the face began."""
        if not any(True for _ in self._meetings(seam)):
            return True
        if seam.at is None or not self._is_crossed(seam):
            return False
        lines = [seam.at(share) for share in _shares()]
        lines = sorted(lines, key=lambda line: self._distance([line]), reverse=True)[:CLOSELY]
        return not any(self._are_clear([line]) for line in lines)

    def _is_crossed(self, seam: Seam) -> bool:
        """Say whether all that is near a seam crosses it at an angle, or touches its face there."""
        return all(self._crosses(seam, meeting) for meeting in self._meetings(seam))

    def _crosses(self, seam: Seam, meeting: _Meeting) -> bool:
        assert seam.normal is not None
        low, high, turn = seam.piece.low[0], seam.piece.high[0], meeting.other.turn
        if min(meeting.at[0] - low, high - meeting.at[0]) <= AT_END * (high - low):
            return True  # what is met there is the face's own edge
        at, there = meeting.at[None], meeting.there[None]
        way = _unit(seam.piece.jet(at)[1][0][0] @ turn.T)
        slopes = meeting.piece.jet(there)[1]
        if len(slopes) == 1:
            return bool(np.linalg.norm(np.cross(way, _unit(slopes[0][0]))) >= CROSSES)
        normal = _unit(np.cross(slopes[0][0], slopes[1][0]))
        if abs(float(normal @ way)) >= CROSSES:
            return True
        # tangent faces: one face, or a place at which curves end
        own = seam.normal(at)[0] @ turn.T
        return float(np.linalg.norm(np.cross(own, normal))) <= CROSSING

    # -- where it may begin instead ------------------------------------------------------------

    def _turns(self, about: Roundness) -> list[Turn]:
        if about.axis is not None:
            return [Turn(about.centre, about.turn(2 * np.pi * share)) for share in _shares()]
        return [Turn(about.centre, _matrix(row)) for row in scattered(OF_BALL, 3)]

    def _room(self, turn: Turn) -> float:
        return self._distance(_turned(self.outline.seams, turn))

    def _distance(self, seams: Sequence[Seam]) -> float:
        """Return how far places of seams are from places of the others, at the nearest."""
        if self._tree is None:
            return np.inf
        places = np.concatenate([seam.piece.jet(seam.piece.places)[0] for seam in seams])
        return float(self._tree.query(places)[0].min())

    @cached_property
    def _tree(self) -> cKDTree | None:
        """Places of the others that may be near, in the coordinates of the body."""
        found, own = [], self.outline.box
        for other in self.others:
            there = moved_box(own, other.turn, other.offset)
            for piece in other.outline.pieces:
                if boxes_apart(there, piece.box) <= NEAR * self.outline.size:
                    found.append((piece.net[0] - other.offset) @ other.turn)
        return cKDTree(np.concatenate(found)) if found else None


def _turned(seams: Sequence[Seam], turn: Turn | None) -> tuple[Seam, ...]:
    """Return seams and poles where they lie after a turn of their body."""
    if turn is None:
        return tuple(seams)
    offset = turn.centre - turn.matrix @ turn.centre
    return tuple(seam.moved(turn.matrix, offset) for seam in seams)


def _matrix(shares: Array) -> Array:
    """Return the turn (3, 3) of three numbers between 0 and 1; even ones give turns all over.

    *Source:* K. Shoemake, Uniform random rotations, Graphics Gems III (1992).
    """
    a, b, c = shares.tolist()
    (p, q), (r, s) = (np.array([np.sin(2 * np.pi * x), np.cos(2 * np.pi * x)]) for x in (b, c))
    x, y, z, w = np.sqrt(1 - a) * p, np.sqrt(1 - a) * q, np.sqrt(a) * r, np.sqrt(a) * s
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def _shares() -> list[float]:
    """Return shares of a period, in no regular row."""
    found: list[float] = scattered(STARTS, 1)[:, 0].tolist()
    return found


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector
