"""Bounds of what splines and their derivatives are at most, from nets of control points."""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.spline_integrals import differences
from pc2cad.geometry.jets import Sizes


def net_sizes(
    poles: Array, knots: tuple[Array, Array], degrees: tuple[int, int], dimension: int = 3
) -> Sizes:
    """Return bounds from the nets of homogeneous poles (n, m, …) and of their derivatives."""
    (u, v), (p, q) = knots, degrees
    with np.errstate(all="ignore"):
        a, b = differences(poles, u, p, 0), differences(poles, v, q, 1)
        joints = poles if poles.shape[-1] > dimension else None
        (aa, jumps_a), (bb, jumps_b) = _second(a, u, p, 0, joints), _second(b, v, q, 1, joints)
        nets = (a, b, aa, differences(a, v, q, 1), bb, jumps_a, jumps_b)
        na, nb, naa, nab, nbb, ja, jb = (_longest(net[..., :dimension]) for net in nets)
        places = np.abs(poles[..., :dimension]).max(axis=(0, 1))
        if poles.shape[-1] == dimension:
            return Sizes((na, nb), (naa, nab, nbb), places, (ja, jb))
        # S = N/W, so W S_a = N_a - S W_a, and so on
        wa, wb, waa, wab, wbb, va, vb = (_longest(net[..., dimension:]) for net in nets)
        least = float(poles[..., dimension].min())
        s = _longest(poles[..., :dimension] / poles[..., dimension:])
        sa, sb = (na + s * wa) / least, (nb + s * wb) / least
        second = (naa + 2 * sa * wa + s * waa, nab + sa * wb + sb * wa + s * wab,
                  nbb + 2 * sb * wb + s * wbb)  # fmt: skip
        jumps = (ja + s * va) / least, (jb + s * vb) / least
    return Sizes((sa, sb), tuple(x / least for x in second), places / least, jumps)


def _second(
    net: Array, knots: Array, degree: int, axis: int, rational: Array | None
) -> tuple[Array, Array]:
    """Return the net of second derivatives, and the jumps of the first at knots without one.

    A jump that is the same multiple of all homogeneous poles there (of a `rational` surface) leaves
    the derivative of the point as it is.
    """
    net = np.moveaxis(net, axis, 0)
    inner, rows = knots[1:-1], len(net)
    gaps = inner[degree : degree + rows - 1] - inner[1:rows]
    steps, smooth = np.diff(net, axis=0), gaps > 0
    second = steps[smooth] * ((degree - 1) / gaps[smooth])[:, None, None]
    jumps = steps[~smooth]
    if rational is None:
        return second, jumps
    there = np.moveaxis(rational, axis, 0)[1:-1][~smooth]
    share = (jumps * there).sum(axis=(1, 2)) / (there * there).sum(axis=(1, 2))
    return second, jumps - share[:, None, None] * there


def _longest(net: Array) -> float:
    """Return the largest length; inf where a spline has a crease."""
    largest = float(np.sqrt((net * net).sum(axis=-1)).max(initial=0.0))
    return largest if np.isfinite(largest) else np.inf
