"""Where faces of different bodies touch in the result of a Boolean: in points, or along curves.

Where two faces of a solid's boundary meet, they end, in a common edge or vertex. Faces that come
together elsewhere leave a solid of no thickness there, or one whose crossing the kernel has missed.
So all places are looked for at which the distance between two faces has a smallest value, by
descents from a grid of pairs of places: between the insides of faces, between edges and faces, and
between vertices and faces. What the faces share is left out: there the distance is 0 and may be.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.boxes import meeting
from pc2cad.brep.booleans import NamedEdge, NamedShape, label
from pc2cad.brep.links import Branching, branchings
from pc2cad.brep.pieces import Piece, Pieces, pieces_of
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.errors import KernelError, NotASolidError
from pc2cad.topology.cells import SideKey

#: steps of a descent; where faces are tangent, a step halves what is left
STEPS = 60
#: a descent ends after so many steps that leave more than this of the distance squared
PATIENCE, HELPFUL = 4, 0.98
#: pairs of nearest places from which descents begin, from the nearest to the farthest
STARTS = 60
#: steps to the nearest place of an edge, and places of it from which they begin
ON_EDGE, NEAREST = 12, 6
#: share of the size below which a distance is 0
ZERO = 1e-13
#: share of the size within which a place is on what two pieces share
ON_SHARED = 1e-5
#: sine of the angle from which on faces cross and do not touch
CROSSING = 1e-3
#: share of a face's parameters over which its normal's turn is looked at, and what two normals may
#: turn apart along a length of the part's size where faces touch along it
TURN, STRAIGHT = 1e-4, 1e-3
#: places of two faces at which it is asked whether they touch over a face
MANY = 5
#: share of an edge by which one looks aside of a place
ASIDE = 0.1


class Reach(Protocol):
    """The distance below which two pieces count as touching."""

    def __call__(self, *pieces: Iterable[SideKey]) -> float:
        """Return it for what the pieces are parts of."""


class TouchingBodiesError(NotASolidError):
    """Bodies touch in points or along curves, where the result has no thickness."""


class MissedCrossingError(KernelError):
    """Faces of two bodies cross, and the kernel has made no edge there."""


class Extent(Enum):
    """How two faces that come together lie there."""

    POINT = "in a point"
    CURVE = "along a curve"
    FACE = "over a face"
    CROSSING = "crossing"


@dataclass(frozen=True)
class Contact:
    """Two pieces that come together where they have nothing in common."""

    #: what the faces at both are parts of
    names: tuple[tuple[SideKey, ...], ...]
    point: tuple[float, float, float]
    #: between them there, and what can be told from none (model units)
    distance: float
    reach: float
    extent: Extent


def check_contacts(
    shape: NamedShape,
    edges: Sequence[NamedEdge],
    deviations: Mapping[SideKey, float],
    part: tuple[str, float, str],
) -> None:
    """Raise TouchingBodiesError where faces of different bodies touch, in the result of Booleans.

    `deviations` bound how far the bodies' faces are from their equations'; `part` is the result in
    words, its size and its unit. Raises MissedCrossingError where they cross unseen.
    """
    size = part[1]

    def reach(*pieces: Iterable[SideKey]) -> float:
        return 2 * KERNEL_TOLERANCE + sum(max(deviations[n] for n in names) for names in pieces)

    seen = list(branchings(shape))
    pieces = pieces_of(shape)
    found = [_seen(pieces, branching, reach, size) for branching in seen] or [
        *faint_loops(pieces, edges, reach, size), *contacts(pieces, reach, size)
    ]  # fmt: skip
    if found:
        raise _refusal(found, part)


def check_merged(
    shapes: tuple[NamedShape, NamedShape],
    one: float,
    deviations: Mapping[SideKey, float],
    part: tuple[str, float, str],
) -> None:
    """Raise TouchingBodiesError where the kernel takes faces of two shapes for one that are apart.

    `one` is the length below which it does so; the others are as for `check_contacts`. Faces that
    are as near as what is known of them are one.
    """
    size, found = part[1], []
    here, there = (pieces_of(shape).faces for shape in shapes)
    farthest = max(one, 2 * (KERNEL_TOLERANCE + max(deviations.values())))
    for i, k in _near(here, there, farthest):
        first, second = here[i], there[k]
        known = sum(max(deviations[name] for name in face.names) for face in (first, second))
        far = max(one, 2 * KERNEL_TOLERANCE + known)
        x, y, gaps = nearest_places(first, second, ZERO * size)
        close = np.flatnonzero((gaps <= far) & (gaps > known + ZERO * size))
        close = close[first.holds(x[close]) & second.holds(y[close])] if len(close) else close
        for n in close[:MANY]:
            point, other = first.jet(x[n][None])[0][0], second.jet(y[n][None])[0][0]
            # faces side by side in one plane are no contact
            over = abs(float(_bend(first, x[n])[0] @ (point - other))) > gaps[n] / 2
            if over and _extent(first, second, x[n], y[n], size) is Extent.FACE:
                px, py, pz = point.tolist()
                names = (first.names, second.names)
                found.append(Contact(names, (px, py, pz), float(gaps[n]), far, Extent.FACE))
                break
    if found:
        raise _refusal(found, part)


def _refusal(
    found: Sequence[Contact], part: tuple[str, float, str]
) -> TouchingBodiesError | MissedCrossingError:
    title, size, units = part
    first = min(found, key=lambda contact: contact.distance)
    what = " and ".join(label(names) for names in first.names)
    point = ", ".join(f"{x if abs(x) > 1e-12 * size else 0:.6g}" for x in first.point)
    where = f"at ({point})" + (f" and {len(found) - 1} more places" if len(found) > 1 else "")
    if first.extent is Extent.CROSSING:
        return MissedCrossingError(
            f"{title}: the faces {what} cross {where}, and the CAD kernel has made no edge there; "
            "move one of the bodies a little, or turn its seam away"
        )
    apart = first.distance if first.distance > ZERO * size else 0.0
    return TouchingBodiesError(
        f"{title}: the bodies touch without crossing: the faces {what} come within {apart:.2g} "
        f"{units} of one another {first.extent.value} {where}, and the result has "
        f"no thickness there; a gap or an overlap of more than {first.reach:.2g} {units} is told "
        "from contact: move one of them, or change its size"
    )


def contacts(pieces: Pieces, reach: Reach, size: float) -> Iterator[Contact]:
    """Yield the places at which pieces of different bodies come within reach of one another.

    `size` is that of the part, `reach` gives the length for what two pieces are parts of. There may
    be several of one pair of pieces.
    """
    farthest = max((reach(face.names, face.names) for face in pieces.faces), default=0.0)
    for first, second in _pairs(pieces, farthest):
        far = reach(first.names, second.names)
        if not first.may_meet(second, far):
            continue
        x, y, gaps = nearest_places(first, second, ZERO * size)
        close = np.flatnonzero(gaps <= far)
        if not len(close):
            continue
        points = first.jet(x[close])[0]
        kept = ~_shared(pieces, first, second, points, size)
        kept[kept] = first.holds(x[close[kept]]) & second.holds(y[close[kept]])
        for k in _distinct(points, kept, 1e-3 * size):
            px, py, pz = points[k].tolist()
            extent = _extent(first, second, x[close[k]], y[close[k]], size)
            yield Contact(
                (first.names, second.names), (px, py, pz), float(gaps[close[k]]), far, extent
            )


def faint_loops(
    pieces: Pieces, edges: Sequence[NamedEdge], reach: Reach, size: float
) -> Iterator[Contact]:
    """Yield closed edges inside which two faces part by less than what is known of them.

    Such an edge is as likely a contact: seen from its middle, both faces are at one place.
    """
    for edge in edges:
        one, other = (pieces.faces[face] for face in edge.faces)
        if not one.bodies.isdisjoint(other.bodies) or len(edge.ends) > 1:
            continue
        far = reach(one.names, other.names)
        middle = edge.points[:-1].mean(axis=0)
        feet = [face.jet(_foot(middle, face, size)[None])[0][0] for face in (one, other)]
        apart = float(np.linalg.norm(feet[0] - feet[1]))
        radius = np.linalg.norm(edge.points - middle, axis=1).max()
        inside = np.linalg.norm(edge.points - feet[0], axis=1).min() > radius / 4
        if apart <= far and inside:
            x, y, z = middle.tolist()
            yield Contact((one.names, other.names), (x, y, z), apart, far, Extent.POINT)


def _seen(pieces: Pieces, branching: Branching, reach: Reach, size: float) -> Contact:
    """Return a contact that the kernel has seen, with the distance that it has not minded."""
    faces = [pieces.faces[number] for number in branching.faces]
    pairs = [pair for pair in combinations(faces, 2) if pair[0].bodies.isdisjoint(pair[1].bodies)]
    point, extent = np.array(branching.point), Extent.POINT
    feet = {id(face): face.jet(_foot(point, face, size)[None])[0][0] for face in faces}

    def apart(pair: tuple[Piece, Piece]) -> float:
        return float(np.linalg.norm(feet[id(pair[0])] - feet[id(pair[1])]))

    one, other = max(pairs or [(faces[0], faces[-1])], key=apart)
    far, names = reach(one.names, other.names), (one.names, other.names)
    if branching.is_edge:
        extent = Extent.CURVE
    return Contact(names, branching.point, apart((one, other)), far, extent)


def _foot(point: Array, face: Piece, size: float) -> Array:
    """Return where on a face's surface, (2,), it is nearest to a point."""
    fixed = replace(face, jet=lambda at: (np.broadcast_to(point, (len(at), 3)), ()),
                    low=np.zeros(0), high=np.zeros(0), places=np.zeros((1, 0)))  # fmt: skip
    return np.asarray(nearest_places(fixed, face, ZERO * size)[1][0])


def _pairs(pieces: Pieces, far: float) -> Iterator[tuple[Piece, Piece]]:
    """Yield the pairs of pieces of different bodies of which neither is on the other.

    Pairs whose boxes are farther apart than `far` are left out.
    """
    faces = pieces.faces
    for i, k in _near(faces, faces, far):
        if i < k and faces[i].bodies.isdisjoint(faces[k].bodies):
            yield faces[i], faces[k]
    for kind in ("edges", "vertices"):
        numbered: dict[int, Piece] = getattr(pieces, kind)
        numbers = list(numbered)
        for i, k in _near(faces, list(numbered.values()), far):
            face, piece = faces[i], numbered[numbers[k]]
            if numbers[k] not in getattr(face, kind) and piece.bodies.isdisjoint(face.bodies):
                yield piece, face


def _near(faces: Sequence[Piece], others: Sequence[Piece], far: float) -> list[tuple[int, int]]:
    """Return the numbers of faces and others whose boxes come within a length of one another."""
    if not faces or not others:
        return []
    boxes = np.array([piece.box for piece in (*faces, *others)])
    i, k = meeting(boxes[:, 0], boxes[:, 1], far).T
    mixed = (i < len(faces)) & (k >= len(faces))
    return [*zip(i[mixed].tolist(), (k[mixed] - len(faces)).tolist(), strict=True)]


def nearest_places(first: Piece, second: Piece, enough: float) -> tuple[Array, Array, Array]:
    """Return places of both at which their distance is smallest, and the distances.

    Levenberg and Marquardt's steps within the bounds, all descents at once. One ends below the
    length `enough`, or where steps no longer help.
    """
    points, others = (piece.jet(piece.places)[0] for piece in (first, second))
    far, near = cKDTree(others).query(points)
    chosen = np.argsort(far)[:: -(-len(far) // STARTS)]
    k = len(first.low)
    z = np.hstack((first.places[chosen], second.places[near[chosen]]))
    low, high = np.append(first.low, second.low), np.append(first.high, second.high)

    def look(z: Array) -> tuple[Array, Array]:
        here, along = first.jet(z[:, :k])
        there, across = second.jet(z[:, k:])
        return here - there, np.stack([*along, *(-d for d in across)], axis=2)

    gap, slopes = look(z)
    square, damping = (gap**2).sum(axis=1), np.full(len(z), 1e-3)
    idle = np.zeros(len(z), dtype=int)
    for _ in range(STEPS):
        (live,) = np.nonzero((square > enough**2) & (idle < PATIENCE))
        if not len(live):
            break
        step = _step(z[live], gap[live], slopes[live], damping[live], low, high)
        tried = np.clip(z[live] - step, low, high)
        gap_there, slopes_there = look(tried)
        there = (gap_there**2).sum(axis=1)
        better = there < square[live]
        idle[live] = np.where(there < HELPFUL * square[live], 0, idle[live] + 1)
        damping[live] *= np.where(better, 0.2, 4.0)
        kept = live[better]
        z[kept], square[kept] = tried[better], there[better]
        gap[kept], slopes[kept] = gap_there[better], slopes_there[better]
    return z[:, :k], z[:, k:], np.sqrt(square)


def _step(z: Array, gap: Array, slopes: Array, damping: Array, low: Array, high: Array) -> Array:
    pull = np.einsum("nki,nk->ni", slopes, gap)
    # a bound that a step would leave holds its parameter
    stuck = ((z <= low) & (pull > 0)) | ((z >= high) & (pull < 0))
    free = np.where(stuck[:, None, :], 0.0, slopes)
    normal = np.einsum("nki,nkj->nij", free, free)
    scale = np.einsum("nii->ni", normal)
    scale = np.maximum(scale, 1e-12 * scale.max(axis=1, keepdims=True) + 1e-300)
    matrix = normal + (np.clip(damping, 1e-14, 1e6)[:, None] * scale)[:, :, None] * np.eye(
        z.shape[1]
    )
    wanted = np.where(stuck, 0.0, pull)
    return np.asarray(np.linalg.solve(matrix, wanted[:, :, None])[:, :, 0])


def _shared(pieces: Pieces, first: Piece, second: Piece, points: Array, size: float) -> Booleans:
    """Say which points lie on edges and vertices that two pieces have in common."""
    edges = (pieces.edges[i] for i in first.edges & second.edges if i in pieces.edges)
    vertices = (pieces.vertices[i] for i in first.vertices & second.vertices)
    found = np.zeros(len(points), dtype=bool)
    for piece in (*edges, *vertices):
        found |= _distances(points, piece) <= ON_SHARED * size
    return found


def _distances(points: Array, piece: Piece) -> Array:
    """Return the distance of points from an edge or a vertex, (n,)."""
    at = piece.jet(piece.places)[0]
    # a closed edge begins and ends at one place
    nearest = np.argsort(np.linalg.norm(at - points[:, None], axis=2), axis=1)[:, :NEAREST]
    here, to = piece.places[nearest.ravel()], np.repeat(points, nearest.shape[1], axis=0)
    for _ in range(ON_EDGE if len(piece.low) else 0):
        there, (along,) = piece.jet(here)
        move = ((to - there) * along).sum(axis=1) / (along**2).sum(axis=1)
        here = np.clip(here + move[:, None], piece.low, piece.high)
    gaps = np.linalg.norm(piece.jet(here)[0] - to, axis=1)
    return np.asarray(gaps.reshape(nearest.shape).min(axis=1))


def _distinct(points: Array, kept: Booleans, apart: float) -> list[int]:
    """Return the numbers of the kept points, one of several that are near each other."""
    found: list[int] = []
    for k in np.flatnonzero(kept).tolist():
        if all(np.linalg.norm(points[k] - points[other]) > apart for other in found):
            found.append(k)
    return found


def _extent(first: Piece, second: Piece, x: Array, y: Array, size: float) -> Extent:
    """Return how two pieces lie where they come together, at places (k,) of both.

    Their distance grows from there as the difference of their curvatures says: in both directions,
    in one, or in none.
    """
    if len(x) < 2:
        return _along(first, second, x, size)
    (normal, bend), (other, unbend) = (_bend(*at) for at in ((first, x), (second, y)))
    if float(np.linalg.norm(np.cross(normal, other))) > CROSSING:
        return Extent.CROSSING
    turns = np.linalg.eigvalsh(bend - np.sign(normal @ other) * unbend)
    # one is 0, across the faces
    bent = int((np.abs(turns) * size > STRAIGHT).sum())
    return (Extent.FACE, Extent.CURVE, Extent.POINT)[min(bent, 2)]


def _along(piece: Piece, face: Piece, at: Array, size: float) -> Extent:
    """Return how a vertex or an edge lies to a face that it comes near at a place."""
    if not len(at):
        return Extent.POINT
    step = ASIDE * (piece.high - piece.low)
    places = np.clip(at, piece.low + step, piece.high - step) + np.outer([-1, 0, 1], step)
    points, (along,) = piece.jet(places)
    apart = [float(np.linalg.norm(face.jet(_foot(p, face, size)[None])[0][0] - p)) for p in points]
    length = float(np.linalg.norm(along[1])) * float(step[0])
    near = max(apart) - min(apart) <= STRAIGHT * length**2 / size + ZERO * size
    return Extent.CURVE if near else Extent.POINT


def _bend(face: Piece, at: Array) -> tuple[Array, Array]:
    """Return a face's unit normal at a place, and how it turns along each direction, (3, 3)."""
    step = TURN * (face.high - face.low)
    # no place of these is beyond a bound
    middle = np.clip(at, face.low + step, face.high - step)
    places = middle + np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * step
    _, (along, across) = face.jet(places)
    normals = np.cross(along, across)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    slopes = np.stack((along[0], across[0]))
    turns = np.stack((normals[1] - normals[2], normals[3] - normals[4])) / (2 * step[:, None])
    bend = np.linalg.pinv(slopes) @ turns
    return normals[0], (bend + bend.T) / 2
