"""det J wherever the map is looked at: whether it is zero, and whether it changes its sign.

It is compared with |M_u||M_v||M_w|: the quotient is the volume of the parallelepiped of the unit
tangents and free of scale. Where a tangent vanishes, rounding leaves a vector of any direction; so
what rounding can make of det J, given the largest tangents in the box, is added to the divisor.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from math import ceil, floor, log10

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.errors import NotASolidError
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.parameters import PARAMETERS

#: a quotient below this is rounding
ROUNDING = 1e-11
#: relative rounding of a derivative, in terms of the largest one
ERROR = 64 * float(np.finfo(float).eps)

#: places in a piece, of its length along each direction, that tell whether it is flat
WITHIN = np.array((0.13, 0.31, 0.47, 0.66, 0.81))

#: whether det J is proved to have a sign where one direction runs from one local place to another
Proves = Callable[[int, float, float, int], bool]


class FlatMapError(NotASolidError):
    """det J vanishes everywhere: the image has no volume."""


class FoldedMapError(NotASolidError):
    """det J changes its sign inside the box: the map folds the solid over itself."""


class JacobianWatch:
    """Watches the extremes of det J / |M_u||M_v||M_w| wherever the map is looked at."""

    def __init__(
        self,
        mapping: Mapping3,
        proves: Proves | None = None,
        speeds: tuple[float, float, float] | None = None,
    ) -> None:
        """Watch a map, whose `speeds` may have been found along with something else."""
        self.mapping, self._proves, self._found_speeds = mapping, proves, speeds
        #: largest value of +sine and of -sine seen
        self.extremes = {1: 0.0, -1: 0.0}
        self._places: dict[int, Array] = {}

    @property
    def _speeds(self) -> tuple[float, float, float]:
        return self._found_speeds or self.mapping.speeds

    def see(self, u: Array, v: Array, w: Array) -> Array:
        """Look at broadcastable places; return the quotient there (nan where M has no tangent)."""
        tangents = self.mapping.tangents((0, 1, 2), u, v, w)
        return self.note(tangents, (u, v, w))[2]

    def volume(self, u: Array, v: Array, w: Array) -> Array:
        """Look at broadcastable places; return det J there, in terms of the largest tangents."""
        tangents = self.mapping.tangents((0, 1, 2), u, v, w)
        return self.note(tangents, (u, v, w))[0] / float(np.prod(self._speeds))

    def note(self, tangents: list[Array], places: tuple[Array, ...]) -> tuple[Array, Array, Array]:
        """Take in M_u, M_v, M_w at some places; return det J, |M_u||M_v||M_w| and the quotient."""
        x, y, z = self._speeds
        determinant, size, (a, b, c) = volumes(tangents)
        with np.errstate(all="ignore"):
            rounding = ERROR * (x * b * c + a * y * c + a * b * z)
            sine = np.where(size == 0, 0.0, determinant / (size + rounding / ROUNDING))
        seen = np.where(np.isfinite(sine), sine, 0.0)
        for sign in (1, -1):
            index = np.unravel_index(np.argmax(sign * seen), seen.shape)
            if sign * seen[index] > self.extremes[sign]:
                self.extremes[sign] = float(sign * seen[index])
                self._places[sign] = np.array(
                    [np.broadcast_to(p, seen.shape)[index] for p in places]
                )
        return determinant, size, np.asarray(sine)

    def check(self) -> None:
        """Raise FlatMapError or FoldedMapError where what was seen shows one."""
        if max(self.extremes.values()) <= ROUNDING:
            why = self._why_flat()
            raise FlatMapError(
                f"det J is zero everywhere: the image is flat and has no volume ({why})"
            )
        if min(self.extremes.values()) > ROUNDING:
            minor = 1 if self.extremes[1] < self.extremes[-1] else -1
            place = self._places[minor]
            point = self.mapping.points(*place)
            raise FoldedMapError(
                "det J changes its sign: the map folds the solid over itself near "
                f"{self.mapping.shown(place)}, at ({', '.join(f'{x:.6g}' for x in point)}); "
                f"{self._advice(-minor)}"
            )

    def _why_flat(self) -> str:
        """Say what takes the volume away."""
        used = {name for tree in self.mapping.coordinates for name in tree.symbols}
        names = [name for name in PARAMETERS if name not in used]
        if names:
            last = names[-1]
            return (
                f"M does not depend on {' or '.join(names)}; a wall runs along {last} from face to "
                f"face, what is filled from its axis outwards: r + wall*{last}, r*{last}"
            )
        return (
            "for a simplex: the points lie in one plane, or two of them coincide; for a truncated "
            "body: nothing is left between its ends"
        )

    def _advice(self, sign: int) -> str:
        """Say how far each parameter can run before the fold, where that is from a whole side."""
        found = []
        fine = np.linspace(0.0, 1.0, 65)
        for d, name in enumerate(PARAMETERS):
            for places in (fine, fine[::-1]):
                first = int(self._folds(d, places, sign).argmax())
                if first > 1:
                    good, bad = (float(places[first + step]) for step in (-1, 0))
                    found.append(f"{name} {self._limit(d, float(places[0]), good, bad, sign)}")
                    break
        wall = "a thinner wall or a smaller section may be valid"
        return f"it keeps its sign for {' or for '.join(found)}; {wall}" if found else wall

    def _folds(self, direction: int, places: Array, sign: int) -> Array:
        """Say at which places of one direction a grid of the others, ends included, has a fold."""
        axes = [np.linspace(0.0, 1.0, 21)] * 3
        axes[direction] = places
        grid = open_grid(*axes)
        lines = sign * self.note(self.mapping.tangents((0, 1, 2), *grid), grid)[2]
        bad = np.nan_to_num(np.moveaxis(lines, direction, 0), nan=-1.0) < -ROUNDING
        return np.asarray(bad.any(axis=(1, 2)))

    def _limit(self, direction: int, end: float, good: float, bad: float, sign: int) -> str:
        """Return in words how far one direction may run from an end: a short number, proved if so.

        `good` and `bad` are local places between which a fold begins.
        """
        for _ in range(24):
            middle = (good + bad) / 2
            fold = bool(self._folds(direction, np.array([middle]), sign)[0])
            good, bad = (good, middle) if fold else (middle, bad)
        value = self.mapping.value
        low, high = sorted((value(direction, 0.0), value(direction, 1.0)))
        step = 10.0 ** (floor(log10(high - low)) - 3)
        word, away, rounded = ("up to", -1, floor) if end == 0.0 else ("from", 1, ceil)
        first = rounded(value(direction, bad) / step)
        for short in (first, first + away):
            limit = short * step
            place = self._local(direction, limit)
            span = (end, place) if end == 0.0 else (place, end)
            if self._proves is not None and 0 < place < 1 and self._proves(direction, *span, sign):
                return f"{word} {limit:.6g}"
        return f"{word} about {value(direction, good):.3g}"

    def _local(self, direction: int, limit: float) -> float:
        """Return the local place of a value of the equation's own parameter."""
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (
                (middle, high) if self.mapping.value(direction, middle) < limit else (low, middle)
            )
        return (low + high) / 2


def check_thickness(mapping: Mapping3, place: list[float]) -> None:
    """Raise FlatMapError where det J is zero all over the piece between breaks that has a place."""
    rows = find_breaks(mapping.coordinates)
    limits = [[0.0, *(b.position for b in row if 0 < b.position < 1), 1.0] for row in rows]
    pieces = [bisect_right(row, x, 1, len(row) - 1) for row, x in zip(limits, place, strict=True)]
    spans = [(row[k - 1], row[k]) for row, k in zip(limits, pieces, strict=True)]
    watch = JacobianWatch(mapping)
    watch.see(*open_grid(*(low + (high - low) * WITHIN for low, high in spans)))
    if max(watch.extremes.values()) <= ROUNDING:
        where = ", ".join(
            f"{name} = {mapping.value(d, low):.4g} to {mapping.value(d, high):.4g}"
            for d, (name, (low, high)) in enumerate(zip(PARAMETERS, spans, strict=True))
            if (low, high) != (0.0, 1.0)
        )
        raise FlatMapError(
            f"det J is zero all over {where}: that part of the image is flat and has no volume; "
            "leave it out of the domain, or give it a thickness"
        )


def volumes(tangents: list[Array]) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return det J, |M_u||M_v||M_w| and its three factors, of tangents (…, 3)."""
    with np.errstate(all="ignore"):
        determinant = determinants(*tangents)
        a, b, c = (np.sqrt(squares(m)) for m in tangents)
        return determinant, np.asarray(a * b * c), (a, b, c)


def determinants(a: Array, b: Array, c: Array) -> Array:
    """Return a·(b × c) of vectors (…, 3), coordinate by coordinate: np.cross is slower."""
    return np.asarray(
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    )
