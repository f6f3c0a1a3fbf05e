"""Closed chains of curves in a plane: that none crosses itself, that they meet nowhere, and nest.

A piece lies in the hull of its control points. Pieces whose steps from control point to control
point all point less than a right angle off one direction go along it one after the other, and meet
at their common ends alone; others are parted by a line. Where neither is found pieces are halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb

import numpy as np

from pc2cad.arrays import Array, Booleans, Integers
from pc2cad.arrays.boxes import meeting

#: steps that turn by less (radians) go along one direction: less than half a turn by a margin
MOST_TURN = 2.6
#: pieces along a chain that are asked for their common direction
WINDOW = 3
#: how often pieces are halved, and how many there may be for each that was given
DEEPEST, MOST_PARTS = 6, 8
#: directions across which boxes are held against one another
_ACROSS = np.array([[1.0, 0.0], [0.0, 1.0], [np.sqrt(0.5)] * 2, [np.sqrt(0.5), -np.sqrt(0.5)]]).T
#: steps that are longer than this share of the largest coordinate have a direction
_STEP = 1e-9


def outer_chain(chains: Sequence[Array], margin: float) -> int | None:
    """Return which of some closed chains has all others inside it, and these nothing.

    None where it is not proved, that each is simple, or that all are further apart than `margin`.

    Args:
        chains: of each the control points (n, d+1, 2) of its pieces, of one degree for all, each
            of which ends where the next one begins, and the last where the first does.
        margin: in the units of the points; ends may be off by far less.

    """
    chains = [_least(nets) for nets in chains]
    nets = np.concatenate(chains)
    chain = np.repeat(np.arange(len(chains)), [len(one) for one in chains])
    most = MOST_PARTS * len(nets) + 64
    for _ in range(DEEPEST):
        wanting = _wanting(nets, chain, margin)
        if wanting is None:
            return None
        if not wanting.any():
            return _outer(nets[:, 0], chain)
        chain = np.repeat(chain, 1 + wanting)
        nets = _halved(nets, wanting)
        if len(nets) > most:
            break
    return None


def turn_of(nets: Array) -> int:
    """Return 1 for a closed chain (n, d+1, 2) around an area counterclockwise, or -1; 0 for none.

    By the area itself, the integral of x dy over pieces.
    """
    nets = nets - nets[0, 0]
    degree = nets.shape[1] - 1
    area = ((nets[..., 0] @ _area_shares(degree)) * np.diff(nets[..., 1], axis=1)).sum()
    # of sums of so many products, each of which is at most the square of the size
    noise = nets.size * degree * np.finfo(float).eps * (nets**2).max()
    return int(np.sign(area)) if abs(area) > noise else 0


@lru_cache(maxsize=16)
def _area_shares(degree: int) -> Array:
    """Return ∫ d B_i^d B_j^(d-1) dt, (d+1, d)."""
    return np.array([
        [comb(degree, i) * comb(degree - 1, j) / (2 * comb(2 * degree - 1, i + j))
         for j in range(degree)]
        for i in range(degree + 1)
    ])  # fmt: skip


def _least(nets: Array) -> Array:
    """Return a chain in as many pieces as it takes for some not to be neighbours."""
    while len(nets) < 4:
        nets = _halved(nets, np.ones(len(nets), bool))
    return nets


def _halved(nets: Array, which: Booleans) -> Array:
    """Return pieces in their order, some of them in two halves."""
    rows, left, right = nets[which], [], []
    while rows.shape[1]:
        left.append(rows[:, 0])
        right.append(rows[:, -1])
        rows = (rows[:, :-1] + rows[:, 1:]) / 2
    place = np.arange(len(nets)) + np.cumsum(which)
    result = np.empty((len(nets) + int(which.sum()), *nets.shape[1:]))
    result[place] = nets
    result[place[which] - 1] = np.stack(left, axis=1)
    result[place[which]] = np.stack(right[::-1], axis=1)
    return result


def _wanting(nets: Array, chain: Integers, margin: float) -> Booleans | None:
    """Return which pieces are neither parted from all others nor go on from them.

    Neighbours meet, so each has to go on from the last. None where halving pieces does not help.
    """
    turns = _turns(nets, chain)
    if turns is None:
        return None
    along = nets @ _ACROSS
    pairs = meeting(along.min(axis=1), along.max(axis=1), margin)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    pairs = pairs[~_parted(nets, pairs, margin)]
    pairs = pairs[~_going_on(turns, chain, pairs)]
    wanting = np.zeros(len(nets), bool)
    wanting[pairs] = True
    return wanting


def _parted(nets: Array, pairs: Integers, margin: float) -> Booleans:
    """Return which pairs lie on two sides of a strip along the chord of one of them."""
    chord = nets[:, -1] - nets[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    normals = np.stack((-chord[:, 1], chord[:, 0]), axis=1) / np.maximum(length, 1e-300)[:, None]
    apart = np.zeros(len(pairs), bool)
    for one in (0, 1):
        normal = normals[pairs[:, one], :, None]
        first, second = ((nets[pairs[:, i]] @ normal)[..., 0] for i in (0, 1))
        apart |= first.max(axis=1) + margin < second.min(axis=1)
        apart |= second.max(axis=1) + margin < first.min(axis=1)
    return apart


def _next(chain: Integers) -> Integers:
    """Return the place of the piece after each."""
    following = np.arange(1, len(chain) + 1)
    last = np.append(chain[1:] != chain[:-1], True)
    first = np.flatnonzero(np.append(True, chain[1:] != chain[:-1]))
    following[last] = first
    return following


def _turns(nets: Array, chain: Integers) -> Array | None:
    """Return within which angle the steps of each piece, and of it and those after it, point.

    (WINDOW + 1, N), radians; None where a step has no direction, or a corner is too sharp.
    """
    steps = np.diff(nets, axis=1)
    if not (np.abs(steps).max(axis=2) > _STEP * np.abs(nets).max()).all():
        return None
    # each step against the one before it, also from piece to piece
    following = _next(chain)
    pieces, each, _ = steps.shape
    inner = _angle(steps[:, :-1].reshape(-1, 2), steps[:, 1:].reshape(-1, 2))
    over = _angle(steps[:, -1], steps[following, 0])
    if np.abs(over).max() > MOST_TURN:
        return None
    within = np.concatenate(
        (np.zeros((pieces, 1)), np.cumsum(inner.reshape(pieces, each - 1), axis=1)), axis=1
    )
    low, high, last = within.min(axis=1), within.max(axis=1), within[:, -1]
    result, least, most, base = [high - low], low, high, np.zeros(pieces)
    at: Integers = np.arange(pieces)
    for _ in range(WINDOW):
        base = base + last[at] + over[at]
        at = following[at]
        least, most = np.minimum(least, base + low[at]), np.maximum(most, base + high[at])
        result.append(most - least)
    return np.asarray(result)


def _angle(one: Array, other: Array) -> Array:
    """Return by how much directions turn, between minus and plus half a turn."""
    across = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.asarray(np.arctan2(across, (one * other).sum(axis=1)))


def _going_on(turns: Array, chain: Integers, pairs: Integers) -> Booleans:
    """Return of which pairs one follows from the other along one direction, within the window."""
    found, following = np.zeros(len(pairs), bool), _next(chain)
    at: Integers = np.arange(len(chain))
    for turn in turns[1:]:
        at = following[at]
        for one, other in (pairs.T, pairs.T[::-1]):
            found |= (turn[one] <= MOST_TURN) & (at[one] == other)
    return found


def _outer(points: Array, chain: Integers) -> int | None:
    """Return which of some polygons has a corner of each other in it, if they have none."""
    count = int(chain[-1]) + 1
    first = np.flatnonzero(np.append(True, chain[1:] != chain[:-1]))
    if count == 1:
        return 0
    ends = points[_next(chain)]
    holds = np.zeros((count, count), bool)
    for i, corner in enumerate(points[first]):
        # the half-line to the right of the corner, which no end lies on both sides of
        above, after = points[:, 1] > corner[1], ends[:, 1] > corner[1]
        turn = (points[:, 0] - corner[0]) * (ends[:, 1] - corner[1])
        turn -= (points[:, 1] - corner[1]) * (ends[:, 0] - corner[0])
        crossing = (above != after) & ((turn > 0) == after)
        holds[:, i] = np.add.reduceat(crossing.astype(int), first) % 2 == 1
        holds[i, i] = False
    outer = np.flatnonzero(holds.any(axis=1))
    return int(outer[0]) if len(outer) == 1 and holds[outer[0]].sum() == count - 1 else None
