"""Whether a map covers a place twice, by brute force and from nothing but its values.

The boundary of the box is sampled densely and made into triangles. Rays through them tell how often
the boundary winds about every place on their way: 1 inside and 0 outside, or there is an overlap or
a fold. Pairs of samples far from one another in the box say how near the boundary comes to itself;
where it comes nearest, samples and rays are denser, in steps of eight. Shares no code with pc2cad.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

#: rays of a lattice along both directions; scales of the lattices about a near place
RAYS, FINE_RAYS, SCALES = 128, 32, 6
#: samples that are compared with all others, and how many near places are looked into
COMPARED, LOOKED_INTO = 500, 3
#: places further from one another than this share of the size are not near
NEAR = 0.02
#: pairs nearer than this in the box are neighbours
NEIGHBOURS = 0.1

#: half of a step in the box, for differences
DIFFERENCE = 1e-6

Array = np.ndarray
Function = Callable[[Array, Array, Array], tuple]


@dataclass(frozen=True)
class Seen:
    """What was seen of a map."""

    size: float
    #: longest way along a ray that is wound about neither once nor not at all, beyond all errors
    depth: float
    place: tuple[float, float, float]
    #: whether space is turned inside out somewhere
    folds: bool
    #: how near boundary places come that are no neighbours in the box
    gap: float
    volume: float
    #: how far the volume may be off
    slack: float


@dataclass
class Oracle:
    """A map of the unit box, with the places where samples have to be dense."""

    function: Function
    #: parameters (u, v, w) near which the map changes, as place and width
    features: Sequence[Sequence[tuple[float, float]]]
    #: directions whose two ends are one
    closed: tuple[bool, bool, bool] = (False, False, False)
    even: int = 49
    seed: int = 0
    nodes: list[Array] = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.nodes = []
        for features in self.features:
            rows = [np.linspace(0, 1, self.even)]
            rows += [place + width * np.linspace(-4, 4, 49) for place, width in features]
            self.nodes.append(_merged(np.concatenate(rows)))

    def at(self, places: Array) -> Array:
        u, v, w = np.moveaxis(np.asarray(places, dtype=float), -1, 0)
        columns = [
            np.broadcast_to(np.asarray(x, dtype=float), u.shape) for x in self.function(u, v, w)
        ]
        return np.stack(columns, axis=-1)

    def see(self) -> Seen:
        places = np.concatenate([self.side(d, e).reshape(-1, 3) for d, e in self.sides()])
        points = self.at(places)
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        near = self.near_places(places, points, size)
        gap = min((distance for _, _, distance in near), default=np.inf)
        triangles, errors = self.triangles()
        middle = points.mean(axis=0)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        volume = abs(np.einsum("ni,ni->", normals, triangles[:, 0] - middle)) / 6
        slack = float(np.linalg.norm(normals, axis=1) @ errors) / 2
        depth, place = self.look_through(triangles, errors, middle, [0.6 * size], RAYS, size)
        for one, other, distance in near:
            if depth > 0:
                break
            if distance < NEAR * size:
                nodes = list(self.nodes)
                self.denser(one)
                self.denser(other)
                triangles, errors = self.triangles()
                reaches = [size * 8.0**-k for k in range(1, SCALES + 1)]
                depth, place = self.look_through(
                    triangles, errors, self.at(one), reaches, FINE_RAYS, size
                )
                self.nodes = nodes
        x, y, z = (float(t) for t in place)
        return Seen(size, depth, (x, y, z), self.folds(), gap, float(volume), slack)

    def sides(self) -> list[tuple[int, int]]:
        return [(d, e) for d in range(3) if not self.closed[d] for e in (0, 1)]

    def side(self, direction: int, end: int) -> Array:
        """Places of one side of the box, (n, m, 3), along the two directions that follow."""
        a, b = (direction + 1) % 3, (direction + 2) % 3
        result = np.empty((len(self.nodes[a]), len(self.nodes[b]), 3))
        result[..., direction] = end
        result[..., a], result[..., b] = self.nodes[a][:, None], self.nodes[b]
        return result

    # -- pairs -------------------------------------------------------------------------------------

    def steps(self, one: Array, other: Array, direction: int) -> Array:
        steps = np.abs(one - other)
        return np.minimum(steps, 1 - steps) if self.closed[direction] else steps

    def apart(self, one: Array, other: Array) -> float:
        return float(np.linalg.norm([self.steps(one[d], other[d], d) for d in range(3)]))

    def near_places(self, places: Array, points: Array, size: float) -> list:
        """Pairs of boundary places, no neighbours, that are nearest, with their distance."""
        chosen = self.rng.choice(len(places), min(COMPARED, len(places)), replace=False)
        best, partner = [], []
        # columns: the squares of some hundred thousand ways at a time are what this costs
        x, q = np.ascontiguousarray(points.T), np.ascontiguousarray(places.T)
        for row in chosen:
            gap = sum((each - each[row]) ** 2 for each in x)
            ways = sum(self.steps(each, each[row], d) ** 2 for d, each in enumerate(q))
            share = np.where(ways > NEIGHBOURS**2, gap, np.inf) / (ways + 1e-300)
            index = int(share.argmin())
            best.append(share[index])
            partner.append(index)
        result = []
        taken: list[Array] = []
        for k in np.argsort(best):
            one, other = places[chosen[k]], places[partner[k]]
            both = np.concatenate((one, other))
            if any(np.abs(both - each).max() < NEIGHBOURS / 2 for each in taken):
                continue
            taken.append(both)
            result.append(self.approached(one, other, size))
            if len(result) == LOOKED_INTO:
                break
        return [each for each in result if self.apart(each[0], each[1]) > NEIGHBOURS / 2]

    def approached(self, one: Array, other: Array, size: float) -> tuple[Array, Array, float]:
        """Move two places of the boundary along their sides to where they are nearest."""
        start = np.concatenate((one, other))
        closed = self.closed + self.closed
        free = [k for k in range(6) if closed[k] or 0 < start[k] < 1]

        def both(x: Array) -> Array:
            result = start.copy()
            result[free] = x
            return result.reshape(2, 3)

        def distance(x: Array) -> float:
            first, second = self.at(both(x))
            return float(np.linalg.norm(first - second))

        def share(x: Array) -> float:
            # two places that run together are no nearer for it
            way = self.apart(*both(x))
            return (distance(x) / (size * (way + 1e-300))) ** 2

        if not free:
            return one, other, distance(start[:0])
        found = minimize(share, start[free], method="Nelder-Mead",
                         bounds=[(max(0, x - 0.1), min(1, x + 0.1)) for x in start[free]],
                         options={"maxfev": 800, "xatol": 1e-9, "fatol": 1e-20})  # fmt: skip
        first, second = both(found.x)
        return first, second, distance(found.x)

    def denser(self, place: Array) -> None:
        steps = np.concatenate([8.0**-k * np.linspace(-1, 1, 9) for k in range(1, SCALES + 1)])
        for d, x in enumerate(place):
            if 0 < x < 1 or self.closed[d]:
                self.nodes[d] = _merged(np.concatenate((self.nodes[d], x + 0.5 * steps)))

    def folds(self) -> bool:
        """Say whether three differences are left-handed somewhere and right-handed elsewhere."""
        rows = [*self.nodes[:2], np.linspace(0, 1, 9)]
        places = np.stack(np.meshgrid(*rows, indexing="ij"), axis=-1)
        steps = []
        for d in range(3):
            low, high = places.copy(), places.copy()
            low[..., d] = np.maximum(low[..., d] - DIFFERENCE, 0)
            high[..., d] = np.minimum(high[..., d] + DIFFERENCE, 1)
            steps.append(self.at(high) - self.at(low))
        volume = np.einsum("...i,...i->...", steps[0], np.cross(steps[1], steps[2]))
        lengths = [np.linalg.norm(step, axis=-1) for step in steps]
        # a step next to a side without speed is rounding
        known = np.min(lengths, axis=0) > 1e-12 * np.max(lengths) / DIFFERENCE
        whole = np.where(known, np.prod(lengths, axis=0), np.inf)
        volume = volume * np.sign(np.median(volume))
        return bool((volume < -1e-3 * whole).any())

    # -- rays --------------------------------------------------------------------------------------

    def triangles(self) -> tuple[Array, Array]:
        """Triangles of the whole boundary, turned one way, and how far each is from the map."""
        corners, errors = [], []
        for d, e in self.sides():
            places = self.side(d, e)
            p = self.at(places)
            middle = self.at((places[1:, 1:] + places[:-1, :-1]) / 2)
            a, b, c, f = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
            off = np.linalg.norm(middle - (a + c) / 2, axis=-1)
            for first, second in ((p[:-1], p[1:]), (p[:, :-1], p[:, 1:])):
                along = 0 if first.shape[0] < p.shape[0] else 1
                half = (
                    (places[:-1] + places[1:]) / 2
                    if along == 0
                    else (places[:, :-1] + places[:, 1:]) / 2
                )
                bow = np.linalg.norm(self.at(half) - (first + second) / 2, axis=-1)
                off = np.maximum(off, np.maximum(bow[:, 1:], bow[:, :-1]) if along == 0
                                 else np.maximum(bow[1:], bow[:-1]))  # fmt: skip
            for three in ((a, b, c), (a, c, f)):
                ways = three if e == 1 else three[::-1]
                corners.append(np.stack(ways, axis=-2).reshape(-1, 3, 3))
                errors.append(off.ravel())
        return np.concatenate(corners), np.concatenate(errors)

    def look_through(
        self,
        triangles: Array,
        errors: Array,
        centre: Array,
        reaches: Sequence[float],
        count: int,
        size: float,
    ) -> tuple[float, Array]:
        """Send lattices of rays through squares about a place, each within the one before it.

        Returns the worst way of all rays, and where it is.
        """
        frame = np.linalg.qr(self.rng.normal(size=(3, 3)))[0]
        local = (triangles - centre) @ frame
        for reach in reaches:
            low, high = local[..., :2].min(axis=1), local[..., :2].max(axis=1)
            near = ((low <= reach) & (high >= -reach)).all(axis=1)
            local, errors, low, high = local[near], errors[near], low[near], high[near]
            found, place = self.rays(local, errors, low, high, reach, count, size)
            if found > 0:
                return found, centre + frame @ place
        return 0.0, centre

    def rays(self, local, errors, low, high, reach, count, size) -> tuple[float, Array]:
        step = 2 * reach / count
        start = np.ceil((np.maximum(low, -reach) + reach) / step).astype(int)
        stop = np.floor((np.minimum(high, reach) + reach) / step).astype(int)
        numbers = np.maximum(stop - start + 1, 0)
        total = numbers[:, 0] * numbers[:, 1]
        rows = np.repeat(np.arange(len(local)), total)
        if len(rows) == 0:
            return 0.0, np.zeros(3)
        rank = np.arange(len(rows)) - np.repeat(np.cumsum(total) - total, total)
        i = start[rows, 0] + rank // numbers[rows, 1]
        j = start[rows, 1] + rank % numbers[rows, 1]
        place = np.stack((i, j), axis=1) * step - reach
        a, b, c = (local[rows, k] for k in range(3))
        sides = [_cross(q[:, :2] - p[:, :2], place - p[:, :2]) for p, q in ((b, c), (c, a), (a, b))]
        inside = np.all([s > 0 for s in sides], axis=0) | np.all([s < 0 for s in sides], axis=0)
        a, b, c = a[inside], b[inside], c[inside]
        sides = [s[inside] for s in sides]
        whole = sum(sides)
        heights = sum(s * p[:, 2] for s, p in zip(sides, (a, b, c), strict=True)) / whole
        # a triangle seen at a flat angle is off by more along the ray
        normal = np.cross(b - a, c - a)
        flat = np.linalg.norm(normal, axis=1) / np.maximum(np.abs(normal[:, 2]), 1e-300)
        off = errors[rows[inside]] * flat + 1e-13 * size
        return worst_way((i * (count + 2) + j)[inside], heights, np.sign(whole), off, place[inside])


def worst_way(
    ray: Array, heights: Array, turn: Array, off: Array, place: Array
) -> tuple[float, Array]:
    """Return the longest way along rays, less what samples are off, that is not wound about once.

    `ray` numbers the ray of each crossing, `turn` says to which side the crossed triangle looks.
    """
    if len(ray) == 0:
        return 0.0, np.zeros(3)
    order = np.lexsort((heights, ray))
    ray, heights, turn, off, place = (x[order] for x in (ray, heights, turn, off, place))
    running = np.cumsum(turn)
    first = np.flatnonzero(np.concatenate(([True], ray[1:] != ray[:-1])))
    lengths = np.diff(np.append(first, len(ray)))
    winding = running - np.repeat(running[first] - turn[first], lengths)
    # rays through the edge of two triangles may miss both
    whole = np.repeat(winding[first + lengths - 1] == 0, lengths)
    inner = whole & (winding != 0)
    sign = np.sign(winding[inner].sum()) or 1.0
    bad = inner & (sign * winding != 1)
    way = np.diff(heights, append=0.0) - 4 * (off + np.append(off[1:], 0.0))
    worst = int(np.where(bad, way, 0.0).argmax())
    if not bad[worst] or way[worst] <= 0:
        return 0.0, np.zeros(3)
    return float(way[worst]), np.append(place[worst], (heights[worst] + heights[worst + 1]) / 2)


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _merged(nodes: Array) -> Array:
    nodes = np.unique(np.concatenate((nodes[(nodes > 0) & (nodes < 1)], [0.0, 1.0])))
    return nodes[np.concatenate(([True], np.diff(nodes) > 1e-9))]
