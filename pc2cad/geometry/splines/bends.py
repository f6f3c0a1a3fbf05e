"""Bounds of a spline surface's second derivatives over boxes of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.geometry.carriers import SplineSurface
from pc2cad.geometry.sheets import projected, restriction, spans, surface_patches
from pc2cad.geometry.splines.bernstein import bernstein_values, chebyshev_nodes

#: parts that a rational piece is cut in along both parameters
PARTS = 4

#: what the bounds are enlarged by for their rounding
_OUTWARDS = 1 + 1e-9


@dataclass(frozen=True, eq=False)
class Bends:
    """The largest lengths of S_ss, S_st and S_tt on each polynomial piece, (n, m, 3)."""

    #: ends of the pieces along s and t
    breaks: tuple[Array, Array]
    pieces: Array
    _tables: dict[tuple[int, int], Array] = field(default_factory=dict, repr=False)

    def over(self, low: Array, high: Array) -> Array:
        """Return the largest lengths over boxes with these corners (k, 2), (k, 3)."""
        (i, rows), (j, columns) = (self._range(d, low[:, d], high[:, d]) for d in (0, 1))
        found = np.empty((len(low), 3))
        # two windows of the largest power of two cover a range
        a, b = np.frexp(rows)[1] - 1, np.frexp(columns)[1] - 1
        for level in {*zip(a.tolist(), b.tolist(), strict=True)}:
            (some,) = np.nonzero((a == level[0]) & (b == level[1]))
            table = self._table(*level)
            starts = [
                (first[some], first[some] + count[some] - 2**k)
                for first, count, k in ((i, rows, level[0]), (j, columns, level[1]))
            ]
            found[some] = np.max([table[x, y] for x in starts[0] for y in starts[1]], axis=0)
        return found

    def _range(self, axis: int, low: Array, high: Array) -> tuple[Integers, Integers]:
        """Return the first piece of each range of a parameter, and how many there are in it."""
        breaks, last = self.breaks[axis], self.pieces.shape[axis] - 1
        first = np.clip(np.searchsorted(breaks, low, side="right") - 1, 0, last)
        end = np.clip(np.searchsorted(breaks, high, side="left") - 1, first, last)
        return first, end - first + 1

    def _table(self, a: int, b: int) -> Array:
        """Return the largest of windows of 2**a by 2**b pieces, by their first ones."""
        if (a, b) not in self._tables:
            if a:
                whole, step = self._table(a - 1, b), 2 ** (a - 1)
                found = np.maximum(whole[:-step], whole[step:])
            elif b:
                whole, step = self._table(a, b - 1), 2 ** (b - 1)
                found = np.maximum(whole[:, :-step], whole[:, step:])
            else:
                found = self.pieces
            self._tables[a, b] = found
        return self._tables[a, b]


def spline_bends(poles: Array, knots: tuple[Array, Array], degrees: tuple[int, int]) -> Bends:
    """Return them from homogeneous poles (n, m, 3 or 4): rational pieces are cut in parts first."""
    rational = poles.shape[2] > 3
    weights = poles[..., 3] if rational else None
    places = poles[..., :3] / poles[..., 3:] if rational else poles
    nets = surface_patches(SplineSurface(degrees, knots, places, weights)).nets
    breaks = [spans(knots) for knots in knots]
    if rational:
        nets = _cut(nets)
        share = np.arange(PARTS) / PARTS
        breaks = [
            np.append((b[:-1, None] + np.diff(b)[:, None] * share).ravel(), b[-1]) for b in breaks
        ]
    steps = (np.diff(breaks[0])[:, None], np.diff(breaks[1])[None])
    first = [_derived(nets, d, steps[d]) for d in (0, 1)]
    second = [_derived(first[d], e, steps[e]) for d, e in ((0, 0), (0, 1), (1, 1))]
    found = _rational(nets, first, second) if rational else [_longest(net) for net in second]
    return Bends((breaks[0], breaks[1]), np.stack(found, axis=-1) * _OUTWARDS)


def _cut(nets: Array) -> Array:
    """Return the control points of pieces (n, m, p+1, q+1, 4) cut in parts along both."""
    n, m, p, q, _ = nets.shape
    low = np.arange(PARTS) / PARTS
    one, other = (restriction(degree - 1, low, low + 1 / PARTS) for degree in (p, q))
    found = np.einsum("aij,bkl,nmjlc->nambikc", one, other, nets, optimize=True)
    return np.asarray(found.reshape(n * PARTS, m * PARTS, p, q, 4))


def _rational(nets: Array, first: Sequence[Array], second: Sequence[Array]) -> list[Array]:
    """Return bounds for N/W, where W³ S_ss = W² N_ss - W (2 N_s W_s + N W_ss) + 2 N W_s².

    And so on. These are polynomials of three times the degrees, bounded by their own control
    points. Places count from the middle of a piece's.
    """
    p, q = nets.shape[2] - 1, nets.shape[3] - 1
    middle = projected(nets).mean(axis=(2, 3), keepdims=True)
    shifted = [
        np.concatenate((net[..., :3] - middle * net[..., 3:], net[..., 3:]), axis=-1)
        for net in (nets, *first, *second)
    ]
    at, to = zip(*(_nodes(degree) for degree in (3 * p, 3 * q)), strict=True)
    whole, s, t, ss, st, tt = (
        np.einsum("ai,bk,nmikc->nmabc", *_bases(net, at), net, optimize=True) for net in shifted
    )
    point, weight = whole[..., :3], whole[..., 3:]
    least = nets[..., 3].min(axis=(2, 3)) ** 3
    found = []
    for (a, b), ab in zip(((s, s), (s, t), (t, t)), (ss, st, tt), strict=True):
        mixed = a[..., :3] * b[..., 3:] + b[..., :3] * a[..., 3:] + point * ab[..., 3:]
        top = weight**2 * ab[..., :3] - weight * mixed + 2 * point * a[..., 3:] * b[..., 3:]
        net = np.einsum("ai,bk,nmikc->nmabc", *to, top, optimize=True)
        found.append(_longest(net) / least)
    return found


def _nodes(degree: int) -> tuple[Array, Array]:
    """Return nodes, and the matrix from values there to Bernstein coefficients."""
    at = chebyshev_nodes(max(degree, 1))
    return at, np.asarray(np.linalg.inv(bernstein_values(len(at) - 1, at)))


def _bases(net: Array, at: Sequence[Array]) -> list[Array]:
    return [bernstein_values(net.shape[2 + d] - 1, x) for d, x in enumerate(at)]


def _derived(nets: Array, axis: int, steps: Array) -> Array:
    """Return control points of the derivative of pieces that are so long, constant ones as 0."""
    degree = nets.shape[2 + axis] - 1
    if not degree:
        return np.zeros_like(nets)
    return np.asarray(np.diff(nets, axis=2 + axis) * (degree / steps)[..., None, None, None])


def _longest(nets: Array) -> Array:
    places = nets[..., :3]
    return np.asarray(np.sqrt((places * places).sum(axis=-1)).max(axis=(2, 3)))
