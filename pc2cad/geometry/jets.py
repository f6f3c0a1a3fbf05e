"""Curves and surfaces as functions on arrays, whatever holds them, with what a proof needs to know.

Pieces are polynomial or, over a weight, rational; along an angle they are sums of sine and cosine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct

Jet = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Sizes:
    """Bounds that hold all over a curve or a surface (inf where there are none)."""

    #: lengths of its first derivatives, of a curve or along a and b
    first: tuple[float, ...]
    #: lengths of its second derivatives: of a curve, or along aa, ab and bb
    second: tuple[float, ...]
    #: coordinates of its poles, or of the places that it is laid about
    poles: Array
    #: by how much the first derivatives jump where they do
    jumps: tuple[float, ...] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class CurveFunction:
    """A curve in space or in a parameter plane."""

    #: points and derivatives, (n, k) each, at parameters (n,)
    jet: Callable[[Array], tuple[Array, Array]]
    #: parameters where it is not smooth, ascending; None along an angle
    breaks: Array | None
    #: degree of its pieces; 1 along an angle
    degree: int
    #: asked for again and again: it should keep them
    sizes: Callable[[], Sizes]
    #: of a rational curve
    weight: Callable[[Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class SurfaceFunction:
    """A surface with parameters a and b."""

    #: points and both derivatives, (n, 3) each, at places (n,), (n,)
    jet: Callable[[Array, Array], Jet]
    #: parameters where it is not smooth, ascending; None along an angle
    breaks: tuple[Array | None, Array | None]
    #: degree of its pieces along both; 1 along an angle
    degrees: tuple[int, int]
    sizes: Callable[[], Sizes]
    #: it turns about an axis by the angle a: |S_aa| is |S_a| at each place, |S_ab| at most |S_b|
    turns: bool = False
    #: of a rational surface
    weight: Callable[[Array, Array], Array] | None = None
    #: points and normals (of any length), (n, m, 3), on the product of parameters (n,) and (m,)
    product: Callable[[Array, Array], tuple[Array, Array]] | None = None
    #: bounds of the lengths of S_aa, S_ab and S_bb, (n, 3), over boxes of the parameters with these
    #: corners, (n, 2) each; None where they are known all over only, by the sizes
    bends: Callable[[Array, Array], Array] | None = None

    def on_grid(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Return points and normals (of any length), (n, m, 3), on a product of parameters."""
        if self.product is not None:
            return self.product(a, b)
        shape = (len(a), len(b), 3)
        point, along_a, along_b = self.jet(np.repeat(a, len(b)), np.tile(b, len(a)))
        return point.reshape(shape), np.cross(along_a, along_b).reshape(shape)


@dataclass(frozen=True, eq=False)
class Trace:
    """An edge on one of its faces: its curve in the parameter plane of the face's surface."""

    path: CurveFunction
    surface: SurfaceFunction


@dataclass(frozen=True, eq=False)
class EdgeFunction:
    """An edge between two faces: what it holds in space and on both, over one parameter."""

    curve: CurveFunction
    span: tuple[float, float]
    traces: tuple[Trace, Trace]


def cuts_between(span: tuple[float, float], *breaks: Array | None) -> Array:
    """Return the ends of a range of a parameter and all breaks between them, ascending."""
    first, last = span
    found = [b[(b > first) & (b < last)] for b in breaks if b is not None]
    return distinct(np.concatenate([[first, last], *found]))


#: steps in which a value is found at the latest: a third of them halves
_STEPS = 160


def crossings(path: CurveFunction, cuts: Array, axis: int, values: Array) -> Array:
    """Return the parameters at which a coordinate of a curve takes values, as far as they are seen.

    It is looked at between its `cuts`; values that it reaches at their ends only are left out.
    """
    t = distinct(np.concatenate([np.linspace(a, b, 17) for a, b in pairwise(cuts)]))
    at = path.jet(t)[0][:, axis]
    lowest, highest = float(at.min()), float(at.max())
    inner = values[(values > lowest) & (values < highest)]
    side = at[None, :] > inner[:, None]
    rows, columns = np.nonzero(side[:, 1:] != side[:, :-1])
    if not len(rows):
        return np.empty(0)
    low, high, rising = t[columns], t[columns + 1], side[rows, columns + 1]
    enough = 2 * np.finfo(float).eps * float(np.abs(t).max())
    found = (low + high) / 2
    for k in range(_STEPS):
        place, slope = path.jet(found)
        off = place[:, axis] - inner[rows]
        beyond = (off > 0) == rising
        low, high = np.where(beyond, low, found), np.where(beyond, found, high)
        with np.errstate(all="ignore"):
            step = found - off / slope[:, axis]
        # Newton's steps, where they stay between the ends; every third is a halving
        fine = (step >= low) & (step <= high) & (k % 3 < 2)
        step = np.where(fine, step, (low + high) / 2)
        within, found = np.abs(step - found), step
        if (np.minimum(within, high - low) <= enough).all():
            break
    return np.asarray(found)
