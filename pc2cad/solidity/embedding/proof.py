"""The proof itself: pairs of parts, from whole sheets down, until each pair is done with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.geometry.sheets import Sheet
from pc2cad.solidity.embedding.blocks import near_pairs
from pc2cad.solidity.embedding.cells import Cells, cells_of, joints
from pc2cad.solidity.embedding.near_joints import NEAR, Joints, crosses
from pc2cad.solidity.embedding.separation import Separation, boxes
from pc2cad.solidity.embedding.surfaces import Surfaces
from pc2cad.solidity.embedding.windows import parted_beside

#: parts smaller than this share of the size that nothing separates count as meeting
TOUCHING = 1e-9
#: halvings; pairs that are followed at once, those joined somewhere, and how often these are halved
DEEPEST, MOST_PAIRS, MOST_JOINED, DEEPEST_JOINED = 40, 200_000, 8_000, 16
#: parts whose bow is less than this share of their length hardly turn
STRAIGHT = 0.02
#: control points of the pairs that are compared in all
MOST_WORK = 30_000_000
#: parts that are made in all
MOST_CELLS = 150_000
#: pairs at a time, for a processor's own memory
_SLAB = 4096
#: pairs near a joint that are looked at whether they cross there
SEEN = 8
#: of many pairs some are followed to the end first
FIRST = 48
#: halvings after which most of what meets nowhere is done with
SOON = 2


@dataclass(frozen=True)
class Meeting:
    """Two places of the built faces that are one, or could not be told apart."""

    #: sheets and their parameters (patches have length 1)
    sheets: tuple[int, int]
    places: tuple[tuple[float, float], tuple[float, float]]
    point: tuple[float, float, float]


@dataclass(frozen=True)
class Outcome:
    """What became of the proof."""

    #: parts that were looked at
    cells: int
    #: an overlap would be no deeper than this (model units): 0 where there is none
    depth: float = 0.0
    #: where two faces meet, or two parts that nothing has separated
    meeting: Meeting | None = None
    #: whether they do meet
    meets: bool = False


@dataclass(eq=False)
class Doubt:
    """What is asked, once, where two parts that are not joined are not told apart soon, or near."""

    ask: Callable[[], object] = lambda: None
    #: how near (model units), nothing once it was asked
    near: float = 0.0

    def raised(self) -> None:
        """Ask: it may raise."""
        if self.near:
            self.near = 0.0
            self.ask()


def prove(
    sheets: Sequence[Sheet],
    lines: Array,
    size: float,
    noise: float,
    every: bool = False,
    doubt: Doubt | None = None,
) -> Outcome:
    """Return whether sheets meet nowhere but where they are joined.

    `lines` are start and step of straight edges; `noise` is what rounding leaves open of a point.
    Of several solids, each closed, the sides of each are compared with one another, and those of
    the outside: where they meet nowhere, all of them wind once about their insides, so that no two
    solids overlap, and no other faces meet. Where that is not shown, or `every` pair is asked for,
    all are compared.
    """
    surfaces = Surfaces(sheets, lines)
    descent = _Descent(surfaces, Separation(noise), Joints(surfaces), size, noise, doubt or Doubt())
    every = every or surfaces.beside.max() == 0
    outcome = descent.run(every)
    if every or outcome.meets or outcome.depth <= TOUCHING * size:
        return outcome
    return replace(descent, count=0, work=0).run(every=True)


@dataclass(eq=False)
class _Descent:
    surfaces: Surfaces
    tests: Separation
    joints: Joints
    size: float
    noise: float
    doubt: Doubt = field(default_factory=Doubt)
    count: int = 0
    work: int = 0

    @property
    def touching(self) -> float:
        """Parts that are smaller and not separated are one place."""
        return TOUCHING * self.size + 4 * self.noise

    def run(self, every: bool) -> Outcome:
        surfaces = self.surfaces
        pairs, self.count, thin = near_pairs(surfaces, self.noise, every, self.doubt.near)
        if thin <= self.doubt.near:
            self.doubt.raised()
        if len(pairs) == 0:
            return Outcome(self.count)
        patches, index = np.unique(pairs, return_inverse=True)
        zero = np.zeros((len(patches), 2))
        cells = cells_of(surfaces, patches, zero, zero + 1)
        return self._follow(cells, index.reshape(-1, 2))

    def _follow(self, cells: Cells, pairs: Integers) -> Outcome:
        stuck: Meeting | None = None
        stuck_depth = 0.0
        for level in range(DEEPEST):
            # limits of whole patches have parted what they can before
            pairs, joined, depth = self._undone(cells, pairs, limits=level > 0)
            if len(pairs) == 0:
                break
            dive = level % 3 == 1 and len(pairs) > FIRST
            if (dive or level >= SOON) and not joined.all():
                self.doubt.raised()
            cells, pairs = cells.of(pairs)
            hopeless = joined & (joined.sum() > MOST_JOINED or level >= DEEPEST_JOINED)
            meeting, small = self._met(cells, pairs, joined)
            if meeting is not None:
                return Outcome(self.count, 0.0, meeting, True)
            hopeless |= small
            if hopeless.any():
                stuck = self._meeting(cells, pairs[hopeless][0])
                stuck_depth = max(stuck_depth, float(cells.extent[pairs[hopeless]].max()))
                pairs, depth, joined = pairs[~hopeless], depth[~hopeless], joined[~hopeless]
            if len(pairs) == 0:
                break
            free = np.flatnonzero(~joined)
            if len(free) and dive:
                found = self._dive(cells, pairs[free], depth[free])
                if found is not None:
                    return Outcome(self.count, 0.0, found, True)
            if self._is_spent(len(pairs)) or level + 1 == DEEPEST:
                worst = pairs[int(np.where(joined, -np.inf, depth).argmax())]
                left = max(stuck_depth, float(cells.extent[pairs[joined]].max(initial=0.0)))
                return Outcome(
                    self.count, float(depth[~joined].max(initial=left)), self._meeting(cells, worst)
                )
            cells, pairs = self._finer(cells, pairs, joined, depth)
        return Outcome(self.count, stuck_depth, stuck)

    def _is_spent(self, pairs: int) -> bool:
        return pairs > MOST_PAIRS or self.count > MOST_CELLS or self.work > MOST_WORK

    def _dive(self, cells: Cells, pairs: Integers, depth: Array) -> Meeting | None:
        """Follow the pairs that overlap most to the end."""
        for _ in range(2 * DEEPEST):
            if len(pairs) > FIRST:
                deepest = np.argsort(-depth, kind="stable")[:FIRST]
                pairs, depth = pairs[deepest], depth[deepest]
            cells, pairs = cells.of(pairs)
            none = np.zeros(len(pairs), dtype=bool)
            meeting, small = self._met(cells, pairs, none)
            if meeting is not None:
                return meeting
            pairs, depth = pairs[~small], depth[~small]
            if len(pairs) == 0:
                return None
            cells, pairs = self._finer(cells, pairs, none[~small], depth)
            pairs, joined, depth = self._undone(cells, pairs)
            pairs, depth = pairs[~joined], depth[~joined]
            if len(pairs) == 0:
                return None
        return None

    def _met(
        self, cells: Cells, pairs: Integers, joined: Booleans
    ) -> tuple[Meeting | None, Booleans]:
        """Return a meeting, or which pairs are as small as they can be and may be none.

        Near to where their sheets are joined two cells may be nearer than what counts as touching.
        """
        extent = cells.extent[pairs].max(axis=1)
        result = np.zeros(len(pairs), dtype=bool)
        rows = np.flatnonzero(~joined & (extent <= self.touching))
        if len(rows) == 0:
            return None, result
        away = self.joints.distance(cells, pairs[rows])
        for row in rows[away > NEAR * self.size]:
            if not self._is_one_place(cells, pairs[row]):
                return self._meeting(cells, pairs[row]), result
            result[row] = True
        small = np.maximum(NEAR * NEAR * away, 64 * self.tests.noise)
        chosen = extent[rows] <= small
        for row, distance in zip(rows[chosen][:SEEN], away[chosen][:SEEN], strict=True):
            if crosses(cells, pairs[row], float(distance)):
                return self._meeting(cells, pairs[row]), result
        result[rows[chosen]] = True
        return None, result

    def _is_one_place(self, cells: Cells, pair: Integers) -> bool:
        """Say whether all that lies between two parts of one sheet is as small as they are.

        Beside a corner where both sides leave in one direction the sheet is as narrow as one likes.
        """
        sheet, *other = cells.sheet[pair].tolist()
        low, high = (x[pair] for x in cells.limits)
        low, high = low.min(axis=0), high.max(axis=0)
        first, last = low.astype(int), np.ceil(high).astype(int)
        if other != [sheet] or (last - first).max() > 2:
            return False
        places = first + np.argwhere(np.ones(last - first, dtype=bool))
        start, (_, across) = self.surfaces.start[sheet], self.surfaces.shapes[sheet]
        between = cells_of(
            self.surfaces, start + places[:, 0] * across + places[:, 1],
            np.maximum(low - places, 0.0), np.minimum(high - places, 1.0),
        )  # fmt: skip
        flat = between.points.reshape(-1, 3)
        return bool(np.ptp(flat, axis=0).max() <= 2 * self.touching)

    def _undone(
        self, cells: Cells, pairs: Integers, limits: bool = True
    ) -> tuple[Integers, Booleans, Array]:
        """Return pairs that nothing separates, which of them are joined, how deep others are.

        Their limits are compared first, where those are to be.
        """
        kept, joined, depth = [], [], []
        if len(pairs) == 0:
            return pairs, np.zeros(0, dtype=bool), np.zeros(0)
        low, high = boxes(cells.points.reshape(len(cells), -1, 3)) if limits else (None, None)
        for start in range(0, len(pairs), _SLAB):
            part = pairs[start : start + _SLAB]
            if low is not None and high is not None:
                a, b = part[:, 0], part[:, 1]
                gap = np.maximum(low[a] - high[b], low[b] - high[a]).max(axis=1)
                meet = gap <= 2 * self.noise
                if (~meet & (gap <= self.doubt.near)).any():
                    self.doubt.raised()
                part = part[meet]
            self.work += len(part) * (self.surfaces.degree + 1) ** 2
            found = self._undone_slab(cells, part)
            kept.append(found[0])
            joined.append(found[1])
            depth.append(found[2])
        return np.concatenate(kept), np.concatenate(joined), np.concatenate(depth)

    def _undone_slab(self, cells: Cells, pairs: Integers) -> tuple[Integers, Booleans, Array]:
        alone = pairs[:, 0] == pairs[:, 1]
        own, pairs = pairs[alone], pairs[~alone]
        own = own[cells.surfaces.plane[cells.sheet[own[:, 0]]] < 0]
        if len(own):
            own = own[self.tests.self_meeting(cells, own[:, 0])]
        if len(pairs) == 0:
            return own, np.ones(len(own), dtype=bool), np.zeros(len(own))
        where = joints(cells, pairs)
        done = self.tests.beside_plane(cells, pairs)
        for kind, test in (("along", self.tests.joined_along), ("at", self.tests.joined_at)):
            # most are not joined at all
            index = np.flatnonzero(getattr(where, kind) & ~done) if where.any.any() else ()
            if len(index):
                part = type(where)(where.sides[index], where.corners[index])
                done[index] = test(cells, pairs[index], part)
        depth = np.zeros(len(pairs))
        index = np.flatnonzero(~where.any & (~done | (self.doubt.near > 0)))
        if len(index):
            parted, depth[index] = self.tests.apart(cells, pairs[index], self.doubt.near)
            done[index] |= parted
            if (done[index] & (depth[index] >= -self.doubt.near)).any():
                self.doubt.raised()
        index = np.flatnonzero(~done)
        if len(index):
            done[index] = parted_beside(cells, pairs[index], self.noise)
            one, other = cells.sheet[pairs[index]].T
            if (done[index] & (one != other) & ~where.any[index]).any():
                self.doubt.raised()
        left = ~done
        return (
            np.concatenate((own, pairs[left])),
            np.concatenate((np.ones(len(own), dtype=bool), where.any[left])),
            np.concatenate((np.zeros(len(own)), depth[left])),
        )

    def _finer(
        self, cells: Cells, pairs: Integers, joined: Booleans, depth: Array
    ) -> tuple[Cells, Integers]:
        """Halve cells of pairs: both of joined ones, of others what is most in the way.

        Where their bows keep two cells from being separated, those are to be less; elsewhere the
        cells are to be shorter.
        """
        bows = cells.bows + self.tests.noise
        extent, bow = cells.extent[pairs], cells.bows.sum(axis=1)[pairs] + self.tests.noise
        bent = ~joined & (depth <= 4 * bow.sum(axis=1))
        large = np.where(bent[:, None], bow, extent)
        cut = joined[:, None] | (large >= 0.5 * large[:, ::-1])
        whole, chosen = distinct(pairs[~cut]), distinct(pairs[cut])
        shorter, straighter = np.zeros((2, len(cells)), dtype=bool)
        shorter[pairs[~bent]] = True
        straighter[pairs[joined]] = True
        finer, parents = self._halved(
            cells.take(chosen), bows[chosen], shorter[chosen], straighter[chosen]
        )
        kept = cells.take(whole)
        result = Cells(
            self.surfaces, np.concatenate((kept.patch, finer.patch)),
            np.concatenate((kept.low, finer.low)), np.concatenate((kept.high, finer.high)),
            np.concatenate((kept.points, finer.points)),
        )  # fmt: skip
        table = np.full((len(cells), 4), -1)
        table[chosen] = np.where(parents >= 0, parents + len(whole), -1)
        same = np.full((len(cells), 4), -1)
        same[whole, 0] = np.arange(len(whole))
        options = [np.where(cut[:, k, None], table[pairs[:, k]], same[pairs[:, k]]) for k in (0, 1)]
        alone = pairs[:, 0] == pairs[:, 1]
        blocks = []
        for i in range(4):
            for j in range(4):
                both = np.stack((options[0][:, i], options[1][:, j]), axis=1)
                blocks.append(both[(both >= 0).all(axis=1) & (~alone | (i <= j))])
        return result, np.concatenate(blocks)

    def _halved(
        self, cells: Cells, bows: Array, shorter: Booleans, straighter: Booleans
    ) -> tuple[Cells, Integers]:
        """Halve cells where they are long, or, of those that need not be `shorter`, bow most.

        Those that are joined to another are to turn less: halved where they turn, if they do.
        """
        lengths = cells.lengths
        turn = bows / (lengths + self.noise)
        turning = straighter & (turn.max(axis=1) > STRAIGHT)
        cut = np.where(
            shorter[:, None], lengths >= 0.6 * lengths[:, ::-1], bows >= 0.25 * bows[:, ::-1]
        )
        cut = np.where(turning[:, None], turn >= 0.3 * turn[:, ::-1], cut)
        middle = (cells.low + cells.high) / 2
        rows = np.arange(len(cells))
        low, high, owner, slot = [], [], [], []
        for i in (0, 1):
            for j in (0, 1):
                here = rows[(cut[:, 0] | (i == 0)) & (cut[:, 1] | (j == 0))]
                lo, hi = cells.low[here].copy(), cells.high[here].copy()
                for axis, k in ((0, i), (1, j)):
                    split = cut[here, axis]
                    if k:
                        lo[split, axis] = middle[here[split], axis]
                    else:
                        hi[split, axis] = middle[here[split], axis]
                low.append(lo)
                high.append(hi)
                owner.append(here)
                slot.append(np.full(len(here), 2 * i + j))
        owners = np.concatenate(owner)
        children = np.full((len(cells), 4), -1)
        children[owners, np.concatenate(slot)] = np.arange(len(owners))
        self.count += len(owners)
        return cells_of(
            self.surfaces, cells.patch[owners], np.concatenate(low), np.concatenate(high)
        ), children

    def _meeting(self, cells: Cells, pair: Integers) -> Meeting:
        a, b = (int(x) for x in pair)
        low, high = cells.limits
        middle = (low + high) / 2
        n = cells.surfaces.degree // 2
        x, y, z = (cells.points[a, n, n] + cells.points[b, n, n]) / 2
        return Meeting(
            (int(cells.sheet[a]), int(cells.sheet[b])),
            (
                (float(middle[a, 0]), float(middle[a, 1])),
                (float(middle[b, 0]), float(middle[b, 1])),
            ),
            (float(x), float(y), float(z)),
        )
