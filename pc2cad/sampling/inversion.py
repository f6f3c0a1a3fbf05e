"""M inverted: the local parameters of the place of a solid that is nearest to a target.

Inside, damped steps end at the target; outside, the whole boundary is searched.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.map import open_grid
from pc2cad.sampling.nearest import Boundary
from pc2cad.topology.cells import directions_of, normal_direction

#: points of the box from which the inversion starts, per direction
_SEEDS = 32
_MOST_STEPS = 60
#: starts round a collapsed side: values of the parameters ignored there, and distances from it
_ROUND = np.arange(0.5, 12) / 12
_DEPTHS = (1e-4, 1e-3, 1e-2, 0.05)


def seed_points(analysis: Analysis, fewest: int = 3) -> tuple[Array, Array]:
    """Return local places all over the box, its sides included, and their images.

    Along each direction there are so many at least; of lines through the middle they are even.
    """
    nodes = []
    for d in range(3):
        inner = [b.position for b in analysis.breaks[d] if 0 < b.position < 1]
        grid = analysis.map.points(*open_grid(*_line(d)))
        steps = np.sqrt((np.diff(grid.reshape(-1, 3), axis=0) ** 2).sum(axis=1)).sum()
        many = int(np.clip(_SEEDS * steps / max(analysis.size, 1e-300), fewest, 40 * _SEEDS))
        nodes.append(distinct(np.concatenate((np.linspace(0, 1, many), inner))))
    places = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    return places, analysis.map.points(*places.T)


def _line(direction: int) -> list[Array]:
    nodes = [np.array([0.53])] * 3
    nodes[direction] = np.linspace(0, 1, 201)
    return nodes


def closed_directions(analysis: Analysis) -> Booleans:
    """Say along which of u, v and w the two ends are one, place by place (3,)."""
    closed = np.zeros(3, dtype=bool)
    for side in analysis.boundary.sides:
        if side.partner is None or side.symmetry is None:
            continue
        if not (side.symmetry.swap or side.symmetry.reverse_s or side.symmetry.reverse_t):
            for d in range(3):
                if side.patch[d] % 2 == 0 and side.patch[d] != side.partner[d]:
                    closed[d] = True
    return closed


class Inverse:
    """M inverted by Levenberg-Marquardt steps in the box; lives for one call of `locate`."""

    def __init__(self, analysis: Analysis, fewest: int = 3) -> None:
        self._analysis = analysis
        self._places, images = seed_points(analysis, fewest)
        self._tree = cKDTree(images)
        self.tolerance = analysis.scale.search_noise
        self._closed = closed_directions(analysis)
        #: coordinates of the lower and of the upper sides, and which of them (2, 3) bound the solid
        self._limits = np.array([[0.0], [1.0]]) * np.ones(3)
        self._faces = np.zeros((2, 3), dtype=bool)
        #: direction, limit and ignored parameters of the sides that collapse
        self._collapsed: list[tuple[int, float, tuple[int, ...]]] = []
        for side in analysis.boundary.sides:
            d = normal_direction(side.patch)
            limit = float(side.patch[d] > 0)
            if side.fate == "face":
                self._faces[int(limit), d] = True
            elif side.fate in ("curve", "point"):
                ignored = tuple(k for k in directions_of(side.patch) if k != side.along)
                if (d, limit, ignored) not in self._collapsed:
                    self._collapsed.append((d, limit, ignored))

    def __call__(self, targets: Array) -> tuple[Array, Array]:
        """Return the local places (n, 3) nearest to targets (n, 3), and the gaps (n,)."""
        best, residual = self._met(targets, np.inf)
        gaps = np.zeros(len(targets))
        asked = np.flatnonzero(residual > self.tolerance**2)
        if len(asked):
            best[asked], _, gaps[asked] = Boundary(self._analysis).improve(
                targets[asked], best[asked], residual[asked], self._settle, self.tolerance
            )
        return best, gaps

    def inside(self, targets: Array) -> tuple[Array, Array]:
        """Return places (n, 3) of targets (n, 3) that are in the solid, and what is left (n,).

        The boundary is not searched.
        """
        best, residual = self._met(targets, np.inf)
        return best, np.sqrt(residual)

    def holds(self, targets: Array, near: Array) -> Booleans:
        """Say which targets (n, 3) have a place of the solid nearer than `near` (n,)."""
        return np.asarray(self._met(targets, 4.0 * near)[1] <= near**2)

    def _met(self, targets: Array, answer: float | Array) -> tuple[Array, Array]:
        """Return places that descents end at, and the squares of their distances.

        What is far away is not looked for: its distance is infinite. On a face that is nearer than
        `answer` nothing more is looked for.
        """
        near = np.broadcast_to(np.square(answer), len(targets))
        best = np.full_like(targets, 0.5)
        residual = np.full(len(targets), np.inf)
        asked = np.flatnonzero(self._may_be_inside(targets))
        # a few starts for everyone, more for those that are not met: the first ones may end on a
        # face of another strand or wall
        for starts in (range(2), range(2, 6), range(6, 14)):
            if not len(asked):
                break
            ranks = [rank + 1 for rank in starts]
            _, nearest = self._tree.query(targets[asked], k=ranks)
            for column in range(len(ranks)):
                local, square = self.descend(targets[asked], self._places[nearest[:, column]])
                better = square < residual[asked]
                best[asked[better]] = local[better]
                residual[asked[better]] = square[better]
            # a minimum on a face is an answer; one elsewhere at a distance is none
            on_face = ((best[asked] == self._limits[:, None]) & self._faces[:, None]).any(
                axis=(0, 2)
            ) & (residual[asked] <= near[asked])
            missed = residual[asked] > self.tolerance**2
            asked = asked[missed & ~on_face] if starts[0] else asked[missed]
        for direction, limit, ignored in self._collapsed:
            missed = np.isfinite(residual) & (residual > self.tolerance**2)
            asked = np.flatnonzero(missed & (best[:, direction] == limit))
            if len(asked):
                start = self._round_pole(targets[asked], best[asked], direction, limit, ignored)
                local, square = self.descend(targets[asked], start)
                better = square < residual[asked]
                best[asked[better]] = local[better]
                residual[asked[better]] = square[better]
        return best, residual

    def _may_be_inside(self, targets: Array) -> Booleans:
        """Say which targets are not far from the box of the images, by a twentieth of its size."""
        low, high = self._tree.mins, self._tree.maxes
        margin = float(np.linalg.norm(high - low)) / 20
        return np.asarray(((targets >= low - margin) & (targets <= high + margin)).all(axis=1))

    def _settle(self, targets: Array, start: Array) -> tuple[Array, Array]:
        """Descend, then with one parameter held at a time: on a crease, steps across it fail."""
        local, square = self.descend(targets, start)
        for direction in range(3):
            place, lower = self.descend(targets, local, held=direction)
            better = lower < square
            local[better], square[better] = place[better], lower[better]
        return local, square

    def _round_pole(
        self, targets: Array, local: Array, direction: int, limit: float, ignored: tuple[int, ...]
    ) -> Array:
        """Return starts off a collapsed side, the best of many all round it.

        On such a side the direction in which the target lies is one of the parameters that M
        ignores there: descent along the others ends on the side.
        """
        best, least = local.copy(), np.full(len(local), np.inf)
        inwards = 1.0 - 2.0 * limit
        for turn in product(_ROUND, repeat=len(ignored)):
            for depth in _DEPTHS:
                place = local.copy()
                place[:, direction] = limit + inwards * depth
                place[:, list(ignored)] = turn
                square = ((self._analysis.map.points(*place.T) - targets) ** 2).sum(axis=1)
                better = square < least
                best[better], least[better] = place[better], square[better]
        return best

    def descend(self, targets: Array, start: Array, held: int | None = None) -> tuple[Array, Array]:
        """Return local minima (n, 3) of the distance, and its squares, one parameter held as is."""
        local = start.copy()
        damping = np.full(len(local), 1e-3)
        square = np.full(len(local), np.inf)
        active = np.arange(len(local))
        for _ in range(_MOST_STEPS):
            here = local[active]
            point, *tangents = self._analysis.map.frame(*here.T)
            gap = point - targets[active]
            value = (gap * gap).sum(axis=1)
            square[active] = value
            jacobian = np.stack(tangents, axis=-1)
            step, promised = self._step(here, jacobian, gap, damping[active], held)
            moved = self._inside(here + step)
            there = self._analysis.map.points(*moved.T) - targets[active]
            after = (there * there).sum(axis=1)
            better = after < value
            index = active[better]
            local[index], square[index] = moved[better], after[better]
            # Nielsen's rule: where the solid curves away, damping settles at the curvature's share
            gain = np.clip((value - after) / np.maximum(promised, 1e-300), -1.0, 2.0)
            factor = np.clip(1 - (2 * gain - 1) ** 3, 0.1, 2.0)
            damping[active] *= np.where(better, factor, 4.0)
            small = after >= value * (1 - 1e-12)
            done = (square[active] <= (self.tolerance / 100) ** 2) | (
                (better & small) | (damping[active] > 1e8)
            )
            active = active[~done]
            if not len(active):
                break
        return local, square

    def _step(
        self, here: Array, jacobian: Array, gap: Array, damping: Array, fixed: int | None
    ) -> tuple[Array, Array]:
        """Return the damped step and how much it should lower the square of the distance.

        Directions that push out of the box are held, and the fixed one.
        """
        gradient = np.einsum("nij,ni->nj", jacobian, gap)
        held = ((here <= 0) & (gradient > 0)) | ((here >= 1) & (gradient < 0))
        held &= ~self._closed
        if fixed is not None:
            held[:, fixed] = True
        free = ~held
        normal = np.einsum("nij,nik->njk", jacobian, jacobian)
        diagonal = np.einsum("njj->nj", normal)
        scale = diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-300
        both = free[:, :, None] & free[:, None, :]
        normal = np.where(both, normal, 0.0)
        normal += np.eye(3) * np.where(free, damping[:, None] * scale, scale)[:, None, :]
        right = np.where(free, -gradient, 0.0)
        step = np.linalg.solve(normal, right[..., None])[..., 0]
        promised = (step * (damping[:, None] * scale * step - np.where(free, gradient, 0.0))).sum(1)
        return step, promised

    def _inside(self, place: Array) -> Array:
        wrapped = np.where((place < 0) | (place > 1), place - np.floor(place), place)
        return np.where(self._closed, wrapped, np.clip(place, 0.0, 1.0))
