"""Does the boundary meet itself: the sharp half of the global test.

A map whose det J keeps its sign and whose boundary nowhere meets itself is injective inside: the
number of preimages is the boundary's winding number, which changes by one across one sheet. So all
pairs of cells of the boundary are compared, from whole faces down to cells and on to ever smaller
parts, and a pair is done with as soon as something parts it:

- `blocks` says what parts blocks of cells, an axis of one of two cells may part them;
- across a wall M's tangents do.

Samples bound a cell together with what its own bow leaves between them. What cannot be parted when
the parts are a billionth of the solid is contact or overlap, and both are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.boxes import meeting
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import cross, unit
from pc2cad.domain.analysis import Analysis
from pc2cad.solidity.bounding_volumes import (
    BETWEEN,
    Cones,
    Level,
    adjoining,
    bow,
    build_levels,
    cannot_return,
    children,
    independent,
    may_vanish,
    meet,
    opposite_faces,
    overshoots,
    spread,
)
from pc2cad.solidity.face_mesh import FaceMesh

#: parts nearer than this share of the part's size count as touching
TOUCHING = 1e-9
#: pairs that axes are tried on at once
_SLAB = 8192
#: halvings of the cells, and pairs that are followed at once
DEEPEST, MOST_PAIRS = 48, 400_000
#: where the faces themselves are compared afterwards
FEW_PAIRS = 20_000
#: of those some are followed to the end first: in all, and at least of every two faces
FIRST, FIRST_OF_FACES = 64, 16


@dataclass(frozen=True)
class Contact:
    """Two places of the boundary that are one place of space."""

    #: faces (indices in the boundary complex) and their own parameters
    faces: tuple[int, int]
    places: tuple[tuple[float, float], tuple[float, float]]
    point: tuple[float, float, float]


@dataclass(frozen=True)
class Clearance:
    """That the boundary was not found to meet itself."""

    #: an overlap would be no deeper than this (model units)
    apart: float
    #: two parts that could not be told from touching when the effort ended
    undecided: Contact | None = None


def find_contact(
    analysis: Analysis,
    face_meshes: Sequence[FaceMesh],
    share: float = TOUCHING,
    most_pairs: int = MOST_PAIRS,
) -> Contact | Clearance:
    """Return a place where the boundary meets itself, or how deep that could be and not be seen.

    `share` of the part's size is what counts as touching; the effort ends with `most_pairs`.
    """
    opposite = opposite_faces(face_meshes)
    levels = build_levels(face_meshes, opposite)
    top = levels[-1].start
    # a plane face is injective where its edges are, and those belong to other faces too
    flat = np.array([face_mesh.flat for face_mesh in face_meshes])
    faces = meeting(levels[-1].low[top], levels[-1].high[top])
    pairs = top[faces[(faces[:, 0] != faces[:, 1]) | ~flat[faces[:, 0]]]]
    for level, coarser in zip(reversed(levels), [None, *reversed(levels)], strict=False):
        if coarser is not None:
            pairs = children(level, coarser, pairs)
            pairs = pairs[meet(level, pairs)]
        pairs = pairs[~cannot_return(level, pairs, opposite)]
    leaf = levels[0]
    pairs = pairs[~adjoining(face_meshes, leaf, pairs)]
    rounding = analysis.scale.sampling_noise
    touching = share * analysis.size + rounding
    return _Descent(face_meshes, opposite, touching, rounding, most_pairs).follow(leaf, pairs)


@dataclass(frozen=True, eq=False)
class _Parts:
    """Parts of cells by their face and its own parameters, with nine samples each."""

    face: Integers
    #: lowest parameters and extents along s and t, (N, 2) each
    low: Array
    step: Array
    samples: Array  # (N, 3, 3, 3)

    def take(self, rows: Integers) -> _Parts:
        return _Parts(self.face[rows], self.low[rows], self.step[rows], self.samples[rows])

    def cones(self) -> Cones:
        """Return the unit tangents along s and t (N, 2, 3), and how far any is from its axis."""
        g = self.samples
        along = unit(g[:, 1:] - g[:, :-1]).reshape(-1, 6, 3)
        across = unit(g[:, :, 1:] - g[:, :, :-1]).reshape(-1, 6, 3)
        return spread(np.stack((along, across), axis=1))


@dataclass(frozen=True, eq=False)
class _Descent:
    """Follows pairs of cells that nothing has parted into ever smaller parts."""

    face_meshes: Sequence[FaceMesh]
    opposite: Integers
    #: lengths (model units): what counts as touching, and rounding
    touching: float
    rounding: float
    most_pairs: int

    def follow(self, leaf: Level, pairs: Integers) -> Contact | Clearance:
        """Return a contact of paired cells, or how deep one may be that was not seen."""
        if len(pairs) == 0:
            return Clearance(self.touching)
        rows, pairs = np.unique(pairs, return_inverse=True)
        pairs = pairs.reshape(-1, 2)
        parts = self._cells(leaf, rows)
        for depth in range(DEEPEST):
            pairs, depths = self._unparted(parts, pairs)
            if len(pairs) == 0:
                break
            if len(pairs) <= 4 * FIRST or depth % 3 == 0:
                contact, all_parted = self._dive(parts, pairs)
                if contact is not None:
                    return contact
                if all_parted:
                    break
            if len(pairs) > self.most_pairs or depth + 1 == DEEPEST:
                deepest = int(depths.argmax())
                return Clearance(float(depths[deepest]), self._contact(parts, pairs[deepest]))
            parts, pairs = self._finer(parts, pairs)
        return Clearance(self.touching)

    def _dive(self, parts: _Parts, pairs: Integers) -> tuple[Contact | None, bool]:
        """Follow the nearest pairs to the end; say whether that parted all there were.

        Of every two faces some are followed: two walls that run side by side have more pairs than
        all others, and may be near without meeting where a third face crosses one of them.
        """
        complete = True
        for _ in range(DEEPEST):
            if len(pairs) > 4 * FIRST:
                complete = False
                pairs = self._nearest(parts, pairs)
            extent = np.abs(parts.samples - parts.samples[:, 1:2, 1:2]).max(axis=(1, 2, 3))
            small = extent[pairs].max(axis=1) <= self.touching
            if small.any():
                return self._contact(parts, pairs[small.argmax()]), False
            parts, pairs = self._finer(parts, pairs)
            pairs, _ = self._unparted(parts, pairs)
            if len(pairs) == 0:
                return None, complete
        return None, False

    def _nearest(self, parts: _Parts, pairs: Integers) -> Integers:
        """Return the nearest pairs of every two faces."""
        faces = np.sort(parts.face[pairs], axis=1)
        group = faces[:, 0] * len(self.face_meshes) + faces[:, 1]
        order = np.lexsort((self._distances(parts, pairs), group))
        _, start, counts = np.unique(group[order], return_index=True, return_counts=True)
        rank = np.arange(len(order)) - np.repeat(start, counts)
        return np.asarray(pairs[order[rank < max(FIRST // len(counts), FIRST_OF_FACES)]])

    def _contact(self, parts: _Parts, pair: Integers) -> Contact:
        a, b = (int(x) for x in pair)
        middle = parts.low + parts.step / 2
        x, y, z = (parts.samples[a, 1, 1] + parts.samples[b, 1, 1]) / 2
        return Contact(
            (int(parts.face[a]), int(parts.face[b])),
            (
                (float(middle[a, 0]), float(middle[a, 1])),
                (float(middle[b, 0]), float(middle[b, 1])),
            ),
            (float(x), float(y), float(z)),
        )

    def _cells(self, leaf: Level, rows: Integers) -> _Parts:
        face, place = leaf.face[rows], leaf.place[rows]
        shape = leaf.shape[face]
        samples = np.empty((len(rows), 3, 3, 3))
        for here in _together(face):
            i, j = 2 * place[here].T
            own = self.face_meshes[face[here[0]]].samples
            for k in range(3):
                for m in range(3):
                    samples[here, k, m] = own[i + k, j + m]
        return _Parts(face, place / shape, 1.0 / shape, samples)

    def _finer(self, parts: _Parts, pairs: Integers) -> tuple[_Parts, Integers]:
        """Cut the larger parts of all pairs in two along their longer side, or both sides."""
        extent = np.abs(parts.samples - parts.samples[:, 1:2, 1:2]).max(axis=(1, 2, 3))[pairs]
        # of a large and a small part only the large one is cut
        cut = extent >= 0.5 * extent[:, ::-1]
        whole, chosen = distinct(pairs[~cut]), distinct(pairs[cut])
        finer, children = self._cut(parts.take(chosen))
        row = np.full((len(parts.face), 4), -1)
        row[chosen] = np.where(children >= 0, children + len(whole), -1)
        kept = np.full((len(parts.face), 4), -1)
        kept[whole, 0] = np.arange(len(whole))
        options = [np.where(cut[:, k, None], row[pairs[:, k]], kept[pairs[:, k]]) for k in (0, 1)]
        blocks = []
        for i in range(4):
            for j in range(4):
                both = np.stack((options[0][:, i], options[1][:, j]), axis=1)
                blocks.append(both[(both >= 0).all(axis=1)])
        return _joined([parts.take(whole), finer]), np.concatenate(blocks)

    def _cut(self, parts: _Parts) -> tuple[_Parts, Integers]:
        """Return the parts of parts, and the rows of each one's (-1 where it has fewer than 4)."""
        g = parts.samples
        lengths = [
            np.sqrt(((g[:, 2] - g[:, 0]) ** 2).sum(axis=-1)).max(axis=1),
            np.sqrt(((g[:, :, 2] - g[:, :, 0]) ** 2).sum(axis=-1)).max(axis=1),
        ]
        cut = np.stack((lengths[0] >= 0.6 * lengths[1], lengths[1] >= 0.6 * lengths[0]), axis=1)
        # a direction in which cells may overshoot is not resolved, however short they are there
        cut |= np.stack([overshoots(g), overshoots(g.swapaxes(1, 2))], axis=1)
        children = np.full((len(g), 4), -1)
        pieces: list[_Parts] = []
        count = 0
        # of each face those that are cut in both directions, along one, along the other
        for rows in _together(4 * parts.face + (2 * ~cut[:, 0] + ~cut[:, 1])):
            if not cut[rows[0]].any():
                continue
            n, m = (1 + cut[rows[0]]).tolist()
            grid = self._evaluate(int(parts.face[rows[0]]), parts.low[rows], parts.step[rows], n, m)
            for i in range(n):
                for j in range(m):
                    step = parts.step[rows] / (n, m)
                    pieces.append(
                        _Parts(
                            parts.face[rows],
                            parts.low[rows] + step * (i, j),
                            step,
                            grid[:, 2 * i : 2 * i + 3, 2 * j : 2 * j + 3],
                        )
                    )
                    children[rows, i * m + j] = count + np.arange(len(rows))
                    count += len(rows)
        return _joined(pieces), children

    def _evaluate(self, face: int, low: Array, step: Array, n: int, m: int) -> Array:
        s = low[:, 0, None, None] + step[:, 0, None, None] * np.linspace(0, 1, 2 * n + 1)[:, None]
        t = low[:, 1, None, None] + step[:, 1, None, None] * np.linspace(0, 1, 2 * m + 1)
        return self.face_meshes[face].function.at(s, t)

    def _distances(self, parts: _Parts, pairs: Integers) -> Array:
        g = parts.samples
        gap = g[pairs[:, 0], 1, 1] - g[pairs[:, 1], 1, 1]
        return np.asarray(np.sqrt(np.einsum("...i,...i->...", gap, gap)))

    def _unparted(self, parts: _Parts, pairs: Integers) -> tuple[Integers, Array]:
        """Return the pairs that neither balls, nor axes, nor the wall between them part.

        With them, how far each would have to move along the best of the axes to be parted.
        """
        g = parts.samples.reshape(-1, 9, 3)
        centre = g[:, 4]
        slack = BETWEEN * bow(parts.samples)[:, 0, 0] + self.rounding
        radius = slack + np.sqrt(((g - centre[:, None]) ** 2).sum(axis=-1).max(axis=1))
        reach = radius[pairs].sum(axis=1)
        pairs = pairs[self._distances(parts, pairs) <= reach]
        if len(pairs) == 0:
            return pairs, np.zeros(0)
        cones = parts.cones()
        # few at a time stay in a processor's own memory
        slabs = [pairs[k : k + _SLAB] for k in range(0, len(pairs), _SLAB)]
        normal = unit(cross(cones[0][:, 0], cones[0][:, 1]))
        found = [self._along_axes(parts, slab, cones, normal, slack) for slab in slabs]
        return np.concatenate([kept for kept, _ in found]), np.concatenate([d for _, d in found])

    def _along_axes(
        self, parts: _Parts, pairs: Integers, cones: Cones, normal: Array, slack: Array
    ) -> tuple[Integers, Array]:
        """Return the pairs that neither axes nor the wall between them part, as `_unparted`."""
        g, (axes, _) = parts.samples.reshape(-1, 9, 3), cones
        a, b = pairs[:, 0], pairs[:, 1]
        s, t = axes[:, 0], axes[:, 1]
        left = np.arange(len(pairs))
        # a wall without width may come to a point between samples
        thin = self._thin(parts, pairs)
        gap = (slack[a] + slack[b]) / np.where(thin, BETWEEN, 1.0)
        depth = np.full(len(pairs), np.inf)
        # samples first: what lies along all pairs is in one piece
        first, second = (g[k].transpose(1, 2, 0).copy() for k in (a, b))
        tries: list[Callable[[Integers, Integers], Array]] = [
            lambda i, _: normal[i],
            lambda _, j: normal[j],
            lambda i, j: unit(g[i, 4] - g[j, 4]),
            lambda i, _: s[i], lambda i, _: t[i], lambda _, j: s[j], lambda _, j: t[j],
            *(lambda i, j, p=p, q=q: unit(cross(p[i], q[j])) for p in (s, t) for q in (s, t)),
        ]  # fmt: skip
        for axis_of in tries:
            axis = axis_of(a[left], b[left])
            low_a, high_a = _extent(first, axis)
            low_b, high_b = _extent(second, axis)
            over = gap[left] - np.maximum(low_b - high_a, low_a - high_b)
            depth[left] = np.minimum(depth[left], np.where(axis.any(axis=1), over, np.inf))
            near = over >= 0
            if not near.all():
                left, first, second = left[near], first[..., near], second[..., near]
        kept = left[thin[left] | ~self._walled(parts, cones, pairs[left])]
        return pairs[kept], depth[kept]

    def _walled(self, parts: _Parts, cones: Cones, pairs: Integers) -> Booleans:
        """Say which pairs lie on two sides of a wall that M's tangents cannot cross back."""
        result = np.zeros(len(pairs), dtype=bool)
        a, b = pairs[:, 0], pairs[:, 1]
        steps = (parts.low[b] - parts.low[a]) / parts.step[a]
        near = (np.abs(steps) < 1.5).all(axis=1)
        near &= (np.abs(parts.step[b] / parts.step[a] - 1) < 1e-6).all(axis=1)
        rows = np.flatnonzero(near & (self.opposite[parts.face[a]] == parts.face[b]))
        if len(rows) == 0:
            return result
        a, b = a[rows], b[rows]
        # both have a sample at one place of their parameters: the way across the wall
        i, j = np.rint(steps[rows]).astype(np.int64).T
        across = parts.samples[b, 1 - i, 1 - j] - parts.samples[a, 1 + i, 1 + j]
        wall = unit(across)[:, None]
        axes, radii = cones
        first, second = (
            (
                np.concatenate((axes[k], wall), axis=1),
                np.concatenate((radii[k], radii[k].max(axis=1, keepdims=True)), axis=1),
            )
            for k in (a, b)
        )
        result[rows] = independent(first, second, crossing=True)
        return result

    def _thin(self, parts: _Parts, pairs: Integers) -> Booleans:
        """Say which pairs are over one another on a wall that may have no width there."""
        result = np.zeros(len(pairs), dtype=bool)
        a, b = pairs[:, 0], pairs[:, 1]
        over = self.opposite[parts.face[a]] == parts.face[b]
        for own in (parts.low, parts.step):
            over &= (np.abs(own[b] - own[a]) < 1e-6 * parts.step[a]).all(axis=1)
        rows = np.flatnonzero(over)
        ways = parts.samples[b[rows]] - parts.samples[a[rows]]
        result[rows] = may_vanish(ways, self.rounding)[:, 0, 0]
        return result


def _together(keys: Integers) -> list[Integers]:
    """Return the rows of each key, both in ascending order."""
    order = np.argsort(keys, kind="stable")
    return [rows for rows in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1) if len(rows)]


def _joined(pieces: list[_Parts]) -> _Parts:
    return _Parts(
        np.concatenate([piece.face for piece in pieces]),
        np.concatenate([piece.low for piece in pieces]),
        np.concatenate([piece.step for piece in pieces]),
        np.concatenate([piece.samples for piece in pieces]),
    )


def _extent(samples: Array, axis: Array) -> tuple[Array, Array]:
    """Return the limits of samples (9, 3, n) along axes (n, 3)."""
    x, y, z = axis.T
    values = samples[:, 0] * x + samples[:, 1] * y + samples[:, 2] * z
    return values.min(axis=0), values.max(axis=0)
