"""The orient stage: det J keeps one sign (spec 4.1).

Input: Mapping3. Output: Orientation.

det J is compared with |M_u||M_v||M_w|: the quotient is the volume of the parallelepiped of the unit
tangents and free of scale. Where a tangent vanishes, rounding leaves a vector of any direction; so
what rounding can make of det J, given the largest tangents in the box, is added to the divisor.
Zeros on collapsed sides and along tangent edges are normal; both signs are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.map import Mapping3, open_grid
from pc2cad.errors import NotASolidError
from pc2cad.expression.identity import Verdict
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.solidity.jacobian_proof import proved_sign

#: a quotient below this is rounding
ROUNDING = 1e-11
#: relative rounding of a derivative, in terms of the largest one
_ERROR = 64 * float(np.finfo(float).eps)
#: places per direction of the first sweep, its ends included
SWEEP = 11
#: starts and steps of the search for the smallest value
STARTS, STEPS = 12, 30
#: a smallest value that hardly falls any more is clear of zero above this
CLEAR = 0.02


class FlatMapError(NotASolidError):
    """det J vanishes everywhere: the image has no volume."""


class FoldedMapError(NotASolidError):
    """det J changes its sign inside the box: the map folds the solid over itself."""


@dataclass(frozen=True)
class Orientation:
    """The sign of det J, and where inside the box it is zero all the same."""

    #: +1 where (u, v, w) is right-handed in the solid, -1 where it is left-handed
    sign: int
    #: PROVED (see `certificate`), or UNDECIDED where it only held wherever it was looked at
    verdict: Verdict
    #: a sentence on an inner place where det J vanishes without changing its sign, or nothing
    warning: str = ""

    @property
    def axes(self) -> tuple[int, int, int]:
        """u, v and w in an order that is right-handed in the solid."""
        return (0, 1, 2) if self.sign > 0 else (1, 0, 2)


def find_orientation(mapping: Mapping3) -> Orientation:
    """Return the sign of det J.

    Where it is not proved, a sweep over the closed box is followed by a search for the smallest
    value from the worst places. Raises FlatMapError or FoldedMapError.
    """
    proved = proved_sign(mapping)
    if proved:
        return Orientation(proved, Verdict.PROVED, _inner_zero(JacobianWatch(mapping), proved))
    nodes = (np.polynomial.legendre.leggauss(SWEEP - 2)[0] + 1) / 2
    axis = np.concatenate(([0.0], nodes, [1.0]))
    watch = JacobianWatch(mapping)
    grid = open_grid(axis, axis, axis)
    sine = watch.see(*grid)
    watch.check()
    sign = 1 if watch.extremes[1] > watch.extremes[-1] else -1
    places = np.array([np.broadcast_to(g, sine.shape).ravel() for g in grid])
    order = np.argsort(np.where(np.isfinite(sine), sign * sine, np.inf).ravel())[:STARTS]
    place = _search(watch, places[:, order], sign)
    # a zero on a side is normal; moved inside along it, it has to be gone
    return Orientation(sign, Verdict.UNDECIDED, _zero_near(watch, sign, np.clip(place, 0.05, 0.95)))


def _inner_zero(watch: JacobianWatch, sign: int) -> str:
    """Return a warning where one of a few inner places has det J = 0."""
    axis = np.array([0.21, 1 / 3, 0.5, 2 / 3, 0.83])
    grid = open_grid(axis, axis, axis)
    sine = sign * watch.see(*grid)
    index = np.unravel_index(np.argmin(sine), sine.shape)
    return _zero_near(watch, sign, np.array([axis[i] for i in index]))


def _zero_near(watch: JacobianWatch, sign: int, place: Array) -> str:
    if float(sign * watch.see(*place)) >= 100 * ROUNDING:
        return ""
    return (
        f"det J vanishes inside the box, near {watch.mapping.shown(place)}, without changing its "
        "sign: the solid is sound, but its parameters are singular there"
    )


def _search(watch: JacobianWatch, places: Array, sign: int) -> Array:
    """Walk from each place (3, n) to smaller sign·sine, on a stencil that halves where it stands.

    The walk ends early where the smallest value is clear of zero and hardly falls any more. The
    last place of the smallest value is returned, (3,).
    """
    stencil = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij")).reshape(3, -1)
    centre = stencil.shape[1] // 2
    step = np.full(places.shape[1], 0.5 / SWEEP)
    before = np.inf
    for _ in range(STEPS):
        around = np.clip(places[:, :, None] + step[:, None] * stencil[:, None, :], 0.0, 1.0)
        values = sign * watch.see(*around)
        values = np.where(np.isfinite(values), values, np.inf)
        watch.check()
        best = values.argmin(axis=1)
        step = np.where(best == centre, step / 2, step)
        places = np.take_along_axis(around, best[None, :, None], axis=2)[:, :, 0]
        smallest = float(values.min())
        if smallest > CLEAR and before - smallest < 0.05 * smallest:
            break
        before = smallest
    return np.asarray(places[:, values.min(axis=1).argmin()])


class JacobianWatch:
    """Watches the extremes of det J / |M_u||M_v||M_w| wherever the map is looked at."""

    def __init__(self, mapping: Mapping3) -> None:
        self.mapping = mapping
        #: largest value of +sine and of -sine seen
        self.extremes = {1: 0.0, -1: 0.0}
        self._places: dict[int, Array] = {}
        inside = np.array([0.03, 0.24, 0.52, 0.79, 0.97])
        # a derivative is a difference of terms as large as the coordinates
        points, *tangents = mapping.frame(*open_grid(inside, inside, inside))
        coordinates = float(np.nanmax(np.abs(points)))
        self._largest = [max(float(np.nanmax(_lengths(m))), coordinates) for m in tangents]

    def see(self, u: Array, v: Array, w: Array) -> Array:
        """Look at broadcastable places; return the quotient there (nan where M has no tangent)."""
        tangents = self.mapping.tangents((0, 1, 2), u, v, w)
        return self.note(tangents, (u, v, w))[2]

    def note(self, tangents: list[Array], places: tuple[Array, ...]) -> tuple[Array, Array, Array]:
        """Take in M_u, M_v, M_w at some places; return det J, |M_u||M_v||M_w| and the quotient."""
        x, y, z = self._largest
        with np.errstate(all="ignore"):
            determinant = _determinant(*tangents)
            a, b, c = (_lengths(m) for m in tangents)
            size = a * b * c
            rounding = _ERROR * (x * b * c + a * y * c + a * b * z)
            sine = np.where(size > 0, determinant / (size + rounding / ROUNDING), 0.0)
        seen = np.where(np.isfinite(sine), sine, 0.0)
        for sign in (1, -1):
            index = np.unravel_index(np.argmax(sign * seen), seen.shape)
            if sign * seen[index] > self.extremes[sign]:
                self.extremes[sign] = float(sign * seen[index])
                self._places[sign] = np.array(
                    [np.broadcast_to(p, seen.shape)[index] for p in places]
                )
        return np.asarray(determinant), np.asarray(size), np.asarray(sine)

    def check(self) -> None:
        """Raise FlatMapError or FoldedMapError where what was seen shows one."""
        if max(self.extremes.values()) <= ROUNDING:
            raise FlatMapError(
                "det J is zero everywhere: the image is flat and has no volume (for a simplex: "
                "the points lie in one plane, or two of them coincide; for a truncated body: "
                "nothing is left between its ends)"
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

    def _advice(self, sign: int) -> str:
        """Say how far each parameter can run before the fold, where that is from a whole side."""
        found = []
        fine, coarse = np.linspace(0.0, 1.0, 65), np.linspace(0.01, 0.99, 21)
        for d, name in enumerate(PARAMETERS):
            axes = [coarse] * 3
            axes[d] = fine
            tangents = self.mapping.tangents((0, 1, 2), *open_grid(*axes))
            lines = np.moveaxis(sign * self.note(tangents, open_grid(*axes))[2], d, 0)
            bad = np.nan_to_num(lines, nan=-1.0) < -ROUNDING
            reach = int(bad.any(axis=(1, 2)).argmax())
            back = int(bad[::-1].any(axis=(1, 2)).argmax())
            if reach > 1:
                found.append(f"{name} up to about {self.mapping.value(d, fine[reach - 1]):.3g}")
            elif back > 1:
                found.append(f"{name} from about {self.mapping.value(d, 1 - fine[back - 1]):.3g}")
        wall = "a thinner wall or a smaller section may be valid"
        return f"it keeps its sign for {' or for '.join(found)}; {wall}" if found else wall


def _determinant(a: Array, b: Array, c: Array) -> Array:
    """Return a·(b × c) of vectors (…, 3), coordinate by coordinate: np.cross is slower."""
    return np.asarray(
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    )


def _lengths(vectors: Array) -> Array:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))
