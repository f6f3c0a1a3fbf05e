"""Gauss rules on cells that are halved until two orders agree: what does not settle is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pc2cad.arrays import Array
from pc2cad.errors import KernelError

#: integrals (k, m) of an integrand over cells (k, …), by Gauss rules of some orders along the axes
#: of a cell; a cell's first columns are the two limits along each axis in turn
Rule = Callable[[Array, tuple[int, ...]], Array]

#: orders that are compared: the lower two settle most cells, the higher two the others
ORDERS = (4, 8, 12)
#: halvings of a cell, and cells that are looked at in one round
DEEPEST, MOST_CELLS = 40, 20_000
#: what may be left open in the end, by the accuracy that each cell is settled to
LEFT_OPEN = 100


def settled(
    rule: Rule, cells: Array, axes: int, accuracy: float, scale: Callable[[Array], Array]
) -> Array:
    """Return the integrals (m,) over all cells, each settled to `accuracy` times a scale.

    `scale` tells from the sums (m,) of the integrals' sizes what each of them (m,) is worth.
    Raises KernelError where halving does not settle them.
    """
    low, many = (rule(cells, (order,) * axes) for order in ORDERS[:2])
    sizes = np.abs(many).sum(axis=0)
    gaps = _gaps(low, many, scale(sizes))
    total = many[gaps <= accuracy].sum(axis=0)
    cells = cells[~(gaps <= accuracy)]  # what is no number has not settled
    for _ in range(DEEPEST):
        if len(cells) == 0:
            return np.asarray(total)
        if len(cells) > MOST_CELLS:
            break
        high = rule(cells, ORDERS[2:] * axes)
        # what each axis leaves open by itself tells along which a cell is halved
        fewer = [
            rule(cells, tuple(ORDERS[1] if axis == k else ORDERS[2] for axis in range(axes)))
            for k in range(axes)
        ]
        open_ = np.stack([_gaps(few, high, scale(sizes)) for few in fewer])
        gaps = open_.max(axis=0)
        right = gaps <= accuracy
        total = total + high[right].sum(axis=0)
        cells, open_ = cells[~right], open_[:, ~right]
        for axis in range(axes):
            # an axis that is settled, or far better than the other, stays whole
            cells, open_ = _halved(cells, open_, axis, accuracy)
    gaps = _gaps(rule(cells, ORDERS[1:2] * axes), rule(cells, ORDERS[2:] * axes), scale(sizes))
    if not gaps.sum() <= LEFT_OPEN * accuracy:
        raise KernelError(
            "the integrals over a face do not settle: after halving its cells "
            f"{DEEPEST} times or into {MOST_CELLS}, {gaps.sum():.2g} of them is left open"
        )
    return np.asarray(total + rule(cells, ORDERS[2:] * axes).sum(axis=0))


def _gaps(few: Array, many: Array, scale: Array) -> Array:
    """Return by how much two rules differ on each cell, (k,)."""
    return np.asarray((np.abs(few - many) / scale).max(axis=1, initial=0.0))


def _halved(cells: Array, open_: Array, axis: int, accuracy: float) -> tuple[Array, Array]:
    """Return cells with those halved that are open along an axis."""
    which = (open_[axis] > accuracy) & (open_[axis] > 1e-3 * open_.max(axis=0))
    first, second = cells[which], cells[which]
    middle = cells[which][:, 2 * axis : 2 * axis + 2].mean(axis=1)
    first[:, 2 * axis + 1] = second[:, 2 * axis] = middle
    parts = np.concatenate((cells[~which], first, second))
    return parts, np.concatenate((open_[:, ~which], open_[:, which], open_[:, which]), axis=1)
