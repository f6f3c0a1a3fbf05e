"""How deep the layers of a part can go before they fold, and where.

Along each line u, v = const from w = 0, the place is sought where det J changes its sign; beyond
w = 1 the outermost layer goes on. What is found is a witness, found by search (sampled).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.channels.limits import Limit
from pc2cad.equation.point_equation import LayersError, PointEquation, over_unit_box
from pc2cad.errors import NotASolidError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import substitute

#: places in u and v, steps of w over a part, and how many times its depth is looked at
PLACES, STEPS, FARTHEST = 33, 16, 8
#: rounds in which the first fold is looked at more closely, and halvings of w
ZOOMS, HALVINGS = 5, 32


#: share of the thickest layer's thickness that rounding can leave of none
ROUNDING = 1e-12


class LayersTooDeepError(NotASolidError):
    """The layers of a part are so deep that they fold over themselves; the message says where."""


def find_depth(equation: PointEquation) -> tuple[Limit, ...]:
    """Return the depth at which layers fold first; none where that is not known, or far off.

    Raises LayersError for a layer without thickness.

    Only equations that know the depth of their layers are looked at.
    """
    if equation.depth is None or len(equation.layers) < 2:
        return ()
    search = _Search(equation)
    _check_thickness(search, equation.layers)
    with np.errstate(all="ignore"):
        found = search.first_fold()
    if found is None:
        return ()
    u, v, w = found
    depth, whole = search.depth(u, v, np.array([w, 1.0])).tolist()
    if not (np.isfinite(depth) and depth > 0 and whole > 0):
        return ()
    place = ", ".join(
        f"{name} = {low + (high - low) * x:.5g}"
        for name, (low, high), x in zip(PARAMETERS[:2], equation.limits, (u, v), strict=False)
    )
    sentence = (
        f"the layers fold at {place} at a depth of {depth:.4g} {equation.units}, and they are "
        f"{whole:.4g} {equation.units} deep there"
    )
    return (Limit("depth", whole, depth, w > 1, sentence),)


def _check_thickness(search: _Search, names: Sequence[str]) -> None:
    """Raise LayersError for a layer that has no thickness at any of some lines across it."""
    limits = np.linspace(0.0, 1.0, len(names) + 1)
    share = np.linspace(0.03, 0.97, 5)
    depths = np.array([search.depth(u, v, limits) for u in share for v in share])
    largest = np.abs(np.diff(depths, axis=1)).max(axis=0)
    for name, thickness in zip(names, largest, strict=True):
        if thickness <= ROUNDING * largest.max():
            raise LayersError(
                f"the layer {name} has no thickness; leave it out, or give it a thickness above 0"
            )


def check_depth(limits: tuple[Limit, ...]) -> None:
    """Raise LayersTooDeepError where layers fold."""
    for limit in limits:
        if not limit.holds:
            raise LayersTooDeepError(f"{limit.sentence}; take thinner ones")


class _Search:
    def __init__(self, equation: PointEquation) -> None:
        assert equation.depth is not None
        local = over_unit_box(equation.domain)
        M = substitute(equation.coordinates, local)
        self._tangents = Program(tuple(t for name in PARAMETERS for t in derivatives(M, name)))
        self._depth = Program(substitute((equation.depth,), local))

    def depth(self, u: float, v: float, w: Array) -> Array:
        """Return the depth at places of one line across the layers."""
        (found,) = self._depth({"u": u, "v": v, "w": w})
        return np.broadcast_to(found, w.shape)

    def _determinant(self, u: Array, v: Array, w: Array) -> Array:
        shape = np.broadcast_shapes(u.shape, v.shape, w.shape)
        columns = [np.broadcast_to(c, shape) for c in self._tangents({"u": u, "v": v, "w": w})]
        (a, b, c), (d, e, f), (g, h, i) = columns[:3], columns[3:6], columns[6:]
        return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))

    def first_fold(self) -> tuple[float, float, float] | None:
        """Return the place with the least w where det J changes its sign; None where none does."""
        along, across = np.linspace(0.0, 1.0, PLACES), np.linspace(0.0, 1.0, PLACES)
        steps = np.concatenate((
            np.linspace(0.0, 1.0, STEPS + 1), 1 + np.geomspace(0.05, FARTHEST, STEPS)
        ))  # fmt: skip
        best: tuple[float, float, float] | None = None
        for _ in range(ZOOMS):
            u, v, w = np.ix_(along, across, steps)
            values = self._determinant(u, v, w)
            turned = ~(values * np.sign(values[:, :, :1]) > 0)
            turned[:, :, 0] = False
            first = np.where(turned.any(axis=2), turned.argmax(axis=2), len(steps))
            if first.min() == len(steps):
                return best
            rows, columns = np.nonzero(first == first.min())
            ends = float(steps[first.min() - 1]), float(steps[first.min()])
            folds = self._halved(along[rows], across[columns], ends)
            least = int(folds.argmin())
            i, j, place = int(rows[least]), int(columns[least]), float(folds[least])
            best = (float(along[i]), float(across[j]), place)
            along, across = (
                np.linspace(x[max(k - 1, 0)], x[min(k + 1, len(x) - 1)], 9)
                for x, k in ((along, i), (across, j))
            )
            steps = np.concatenate(([0.0], np.linspace(0.8 * place, 1.02 * place, 9)))
        return best

    def _halved(self, u: Array, v: Array, ends: tuple[float, float]) -> Array:
        """Return where det J changes its sign on lines, between two values of w."""
        low, high = (np.full(len(u), end) for end in ends)
        sign = np.sign(self._determinant(u, v, np.zeros(len(u))))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            fold = ~(sign * self._determinant(u, v, middle) > 0)
            low, high = np.where(fold, low, middle), np.where(fold, middle, high)
        return low
