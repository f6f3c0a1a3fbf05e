"""Closed chains of curves that wind round one place of a plane: simple, apart and nested at once.

A sufficient test in few steps, for one chain or for two, an outer and an inner one; what it does
not prove may still be so (`geometry.plane_chains`).

With control points P_i and steps D_j of a piece, about the place c, (p - c) × p' is a sum of
B_i B_j (P_i - c) × D_j with the same shares as p - c and p' have. Where each of these is at least
κ |P_i - c| |D_j|, it is at least κ |p - c| |p'|: the chain goes round c one way, and is simple if
it does so once. Two of its points that are near one another are then so in their angle about c, and
between them tangents turn by less than 2 acos κ and that angle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array

#: κ: tangents are within 1.25 (radians) of what is square to the way from the place
_LEAST_SINE = 0.3154
#: how much nearer than the chain's place its points may be taken for one another: within an angle
#: of 0.1 tangents turn by 2.6 at most, as `plane_chains.MOST_TURN` allows
_NEAR = 0.09
#: steps that are longer than this share of the largest coordinate have a direction
_STEP = 1e-9


def round_chains(chains: Sequence[Array], margin: float) -> tuple[int, tuple[int, ...]] | None:
    """Return which chain is around the other, and whether they run counterclockwise (1) or not.

    None where it is not proved that each is simple, that near points of it follow one another
    along one direction, that both are further apart than `margin`, and one is inside the other.

    Args:
        chains: one or two, with the control points (n, d+1, 2) of their pieces, each of which ends
            where the next one begins, and the last where the first does.
        margin: in the units of the points; ends may be off by far less.

    """
    if len(chains) > 2:
        return None
    reach = [float(np.ptp(nets[:, 0], axis=0).max()) for nets in chains]
    outer = reach.index(max(reach))
    inner = chains[1 - outer] if len(chains) == 2 else chains[0]
    centre = inner[:, 0].sum(axis=0) / len(inner)
    about = [nets - centre for nets in chains]
    senses = tuple(_sense(nets) for nets in about)
    if 0 in senses:
        return None
    for nets, sense in zip(about, senses, strict=True):
        normals, distances = _outwards(nets, sense)
        if not distances.min() * _NEAR > margin:
            return None
        if len(chains) == 2 and nets is about[outer]:
            # all of the inner one is on this side of a line that each piece is beyond
            inside = about[1 - outer].reshape(-1, 2) @ normals.T
            if not (inside.max(axis=0) < distances - margin).all():
                return None
    return outer, senses


def _sense(nets: Array) -> int:
    """Return 1 for a chain once counterclockwise round the origin, -1 for clockwise, else 0."""
    x, y = nets[..., 0], nets[..., 1]
    dx, dy = x[:, 1:] - x[:, :-1], y[:, 1:] - y[:, :-1]
    lengths = np.sqrt(dx * dx + dy * dy)
    if not lengths.min() > _STEP * np.abs(nets).max():
        return 0
    turns = x[:, :, None] * dy[:, None] - y[:, :, None] * dx[:, None]
    sense = 1 if turns[0, 0, 0] > 0 else -1
    far = np.sqrt(x * x + y * y)
    if not (sense * turns - _LEAST_SINE * far[:, :, None] * lengths[:, None]).min() > 0:
        return 0
    # each piece goes by less than half a turn
    a, b = x[:, 0], y[:, 0]
    c, d = (np.concatenate((row[1:], row[:1])) for row in (a, b))
    return sense if abs(float(np.arctan2(a * d - b * c, a * c + b * d).sum())) < 3 * np.pi else 0


def _outwards(nets: Array, sense: int) -> tuple[Array, Array]:
    """Return a direction (n, 2) for each piece, and how far along it the piece is at least, (n,).

    That is square to its chord, away from the origin.
    """
    chords = sense * (nets[:, -1] - nets[:, 0])
    normals = np.stack((chords[:, 1], -chords[:, 0]), axis=1)
    normals /= np.sqrt((normals * normals).sum(axis=1))[:, None]
    return normals, np.asarray((nets @ normals[:, :, None])[..., 0].min(axis=1))
