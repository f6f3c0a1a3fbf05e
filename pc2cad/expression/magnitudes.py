"""What terms of normal forms are worth over the unit box: proved bounds, and what is seen.

A term is rounding if its *value* is, wherever it is looked at: its coefficient times a proved bound
of its function. A coefficient by itself says nothing: 1e-15 exp(34.5 - 1e6 (u - a)²) is a needle of
height 0.9. What it is compared with is the extent that is seen at samples, which neither wide
enclosures nor coefficients that cancel can make larger than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.scatter import scattered
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import ULP, Interval
from pc2cad.expression.normal_form import Monomial
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.sign_changes import PARTS, on_parts
from pc2cad.expression.tree import Expr

#: what rounding leaves, as a share of the extent that is seen
ROUNDING: Final = 1e-13
#: the most that it may leave where large terms cancel, as a share of the same
MOST_LOST: Final = 1e-10
#: roundings of the largest term
ROUNDINGS: Final = 16
#: samples per parameter: both ends and irrational places
PLACES: Final = np.sort(np.append(scattered(17, 1, 0.0), (0.0, 1.0)))


def rounding(seen: float, largest: float) -> float:
    """Return the value up to which terms are rounding, all of them together.

    `seen` is the extent of the whole at samples, `largest` a bound of its largest term: where terms
    cancel, what their own rounding leaves may be more than `ROUNDING` of the extent.
    """
    return max(ROUNDING * seen, min(ROUNDINGS * ULP * largest, MOST_LOST * seen))


def bound(monomial: Monomial) -> float:
    """Return a proved bound of a monomial's size over the unit box; inf where none was found."""
    return float(bounds(monomial).max())


def bounds(monomial: Monomial) -> Array:
    """Return proved bounds of a monomial's size over the parts of the unit box.

    Shape (PARTS or 1) per parameter; atoms without symbols are left out.
    """
    result: Array = np.ones((1,) * len(PARAMETERS))
    with np.errstate(all="ignore"):
        for atom, exponent in monomial:
            if atom.symbols:
                result = result * _sizes(atom)[1] ** exponent * (1 + 8 * ULP)
    # zero times an unbounded factor is not known
    return np.where(np.isnan(result), np.inf, result)


def least(root: Expr) -> Array:
    """Return proved lower bounds of a tree's size over the parts of the unit box."""
    return _sizes(root)[0]


@lru_cache(maxsize=4096)
def _sizes(root: Expr) -> tuple[Array, Array]:
    """Return the least and the largest size of a tree over the parts of the unit box."""
    shape = [PARTS if name in root.symbols else 1 for name in PARAMETERS]
    # sums of waves are products of matrices, whose last bits depend on how many places there are
    if len(root.symbols) == 1 and "fourier" not in root.ops:
        size = on_parts(root, *root.symbols).magnitude()
        lower, upper = (np.broadcast_to(x, PARTS) for x in (size.lower, size.upper))
        return lower.reshape(shape), upper.reshape(shape)
    ends = np.linspace(0.0, 1.0, PARTS + 1)
    boxes = {}
    for axis, name in enumerate(PARAMETERS):
        open_shape = [1] * len(PARAMETERS)
        open_shape[axis] = PARTS
        boxes[name] = Interval(ends[:-1].reshape(open_shape), ends[1:].reshape(open_shape))
    size = IntervalProgram((root,))(boxes)[0].magnitude()
    return np.broadcast_to(size.lower, shape), np.broadcast_to(size.upper, shape)


def extent(roots: Sequence[Expr], names: Sequence[str]) -> float:
    """Return how far apart values of a point are that are seen: a lower bound of its extent."""
    return spread(_samples(roots, names))


def spread(values: Array) -> float:
    """Return how far apart points (n, d) are, those aside that are not finite."""
    finite = values[np.isfinite(values).all(axis=1)]
    return float(np.linalg.norm(np.ptp(finite, axis=0))) if len(finite) else 0.0


def largest_seen(root: Expr) -> float:
    """Return the largest size of a tree that is seen at samples of the unit box."""
    values = np.abs(_samples((root,), sorted(root.symbols)))
    return float(values[np.isfinite(values)].max(initial=0.0))


def _samples(roots: Sequence[Expr], names: Sequence[str]) -> Array:
    """Return values (n, len(roots)) at samples of the unit box."""
    places = dict(zip(names, np.ix_(*(PLACES for _ in names)), strict=True))
    values = np.empty((len(roots), *(len(PLACES) for _ in names)))
    for k, column in enumerate(Program(tuple(roots))(places)):
        values[k] = column
    return values.reshape(len(roots), -1).T
