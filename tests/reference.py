"""The channel solids of the paper (Figs. 6 to 8), evaluated without the compiler under test.

Written from the formulas: the guide N(u) = (A-D)u³ + (B-D)(1-u)³ + (C-D) sin u + D, the frame whose
normal points from N towards a fixed point E, the section (x, y) in that frame, and the wall
M = K + (K-N)(δ/|KN|)(w-s). Derivatives are analytic, so that every integral converges to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: a section coordinate with its derivative, over v: (x, y, x_v, y_v)
Section = Callable[[Array], tuple[Array, Array, Array, Array]]
#: wall thickness and its derivative, over u
Thickness = Callable[[Array], tuple[Array, Array]]

GUIDES = {
    "G1": ((10, 0, 0), (0, 10, 0), (0, 0, 10), (0, 0, 0)),
    "G2": ((9, 1, 2), (-2, 8, 1), (1, -1, 11), (1, 2, -1)),
}
CONTOUR_NODES = ((2, 0), (1, 1.5), (-1, 1.8), (-2.2, 0.2), (-1.2, -1.4), (0.8, -1.7))


def ellipse(a: float, b: float) -> Section:
    """Section 8a: x = a cos φ, y = b sin φ, φ = 2πv."""

    def at(v: Array) -> tuple[Array, Array, Array, Array]:
        phi = 2 * np.pi * v
        cos, sin = np.cos(phi), np.sin(phi)
        return a * cos, b * sin, -2 * np.pi * a * sin, 2 * np.pi * b * cos

    return at


def sine_wave(radius: float, amplitude: float, waves: int) -> Section:
    """Section 8b: r = R + h sin nφ, φ = 2πv."""

    def at(v: Array) -> tuple[Array, Array, Array, Array]:
        phi = 2 * np.pi * v
        cos, sin = np.cos(phi), np.sin(phi)
        r = radius + amplitude * np.sin(waves * phi)
        slope = amplitude * waves * np.cos(waves * phi)
        x_phi, y_phi = slope * cos - r * sin, slope * sin + r * cos
        return r * cos, r * sin, 2 * np.pi * x_phi, 2 * np.pi * y_phi

    return at


def contour(nodes: tuple[tuple[float, float], ...], handle: float) -> Section:
    """Section 8c: one cubic Bézier arc per node, each taking the same share of v."""
    p = np.array(nodes, dtype=float)
    after, second, before = np.roll(p, -1, 0), np.roll(p, -2, 0), np.roll(p, 1, 0)
    arcs = np.stack((p, p + handle * (after - before), after - handle * (second - p), after))
    k = len(p)

    def at(v: Array) -> tuple[Array, Array, Array, Array]:
        local = np.asarray(v) * k
        index = np.clip(np.floor(local).astype(int), 0, k - 1)
        t = (local - index)[..., None]
        b0, b1, b2, b3 = (arcs[i][index] for i in range(4))
        c = 1 - t
        xy = b0 * c**3 + 3 * b1 * t * c**2 + 3 * b2 * t**2 * c + b3 * t**3
        slope = 3 * k * ((b1 - b0) * c**2 + 2 * (b2 - b1) * t * c + (b3 - b2) * t**2)
        return xy[..., 0], xy[..., 1], slope[..., 0], slope[..., 1]

    return at


def constant(delta: float) -> Thickness:
    """One wall thickness everywhere."""
    return lambda u: (np.full_like(u, delta), np.zeros_like(u))


def linear(start: float, growth: float) -> Thickness:
    """δ(u) = start + growth·u."""
    return lambda u: (start + growth * u, np.full_like(u, growth))


SECTIONS = {
    "8a": ellipse(2.0, 1.2),
    "8b": sine_wave(2.0, 0.3, 7),
    "8c": contour(CONTOUR_NODES, 1 / 6),
    "circle": ellipse(2.0, 2.0),
}
THICKNESS = {"8a": 0.4, "8b": 0.3, "8c": 0.3, "circle": 0.4}
#: v is smooth between these
BREAKS = {"8a": 1, "8b": 1, "8c": 6, "circle": 1}


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1)[..., None]


@dataclass(frozen=True)
class Integrals:
    """Volume, centroid and the areas of the four faces."""

    volume: float
    centroid: tuple[float, float, float]
    areas: dict[str, float]

    @property
    def area(self) -> float:
        """The whole surface."""
        return sum(self.areas.values())


@dataclass(frozen=True)
class Channel:
    """One channel solid; `share` is the s of the formula: 1/2 centred, 1 inside, 0 outside."""

    guide: tuple[tuple[float, float, float], ...]
    section: Section
    thickness: Thickness
    share: float = 0.5
    #: number of equal shares of v within which the section is analytic
    arcs: int = 1
    #: what the normal refers to: E=D, E=A, C-D, frenet, or rmf (which starts as E=D)
    kind: str = "E=D"

    @cached_property
    def points(self) -> Array:
        """A, B, C, D."""
        return np.array(self.guide, dtype=float)

    def guide_point(self, u: Array) -> tuple[Array, Array, Array]:
        """Return N, N' and N'' at u, shape (..., 3)."""
        A, B, C, D = self.points
        u = np.asarray(u, dtype=float)[..., None]
        a, b, c = A - D, B - D, C - D
        point = a * u**3 + b * (1 - u) ** 3 + c * np.sin(u) + D
        first = 3 * a * u**2 - 3 * b * (1 - u) ** 2 + c * np.cos(u)
        second = 6 * a * u + 6 * b * (1 - u) - c * np.sin(u)
        return point, first, second

    def reference(self, u: Array) -> tuple[Array, Array]:
        """Return the vector q that the normal is taken from, and q'."""
        A, B, C, D = self.points
        N, d1, d2 = self.guide_point(u)
        if self.kind == "frenet":
            return d2, 6 * (A - D) - 6 * (B - D) - (C - D) * np.cos(np.asarray(u)[..., None])
        if self.kind == "C-D":
            return np.broadcast_to(C - D, N.shape), np.zeros_like(N)
        return (A if self.kind == "E=A" else D) - N, -d1

    def frame(self, u: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array]]:
        """Return the unit vectors T, e1, e2 at u, and the derivatives of e1 and e2."""
        (T, e1, e2), (de1, de2) = self.referred(u)
        if self.kind != "rmf":
            return (T, e1, e2), (de1, de2)
        # turned back by the integral of its rate, by one Gauss rule from 0 to each u
        x, weight = gauss(40)
        (_, _, f2), (df1, _) = self.referred(np.asarray(u, dtype=float)[..., None] * x)
        angle = -(u * (_dot(df1, f2)[..., 0] @ weight))[..., None]
        rate = -_dot(de1, e2)
        c, s = np.cos(angle), np.sin(angle)
        r1, r2 = c * e1 + s * e2, c * e2 - s * e1
        return (T, r1, r2), (c * de1 + s * de2 + rate * r2, c * de2 - s * de1 - rate * r1)

    def referred(self, u: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array]]:
        """Return the frame whose normal is taken from the reference, as `frame` does."""
        _, d1, d2 = self.guide_point(u)
        speed = np.sqrt(_dot(d1, d1))
        T = d1 / speed
        dT = (d2 - T * _dot(T, d2)) / speed
        q, dq = self.reference(u)
        g = q - T * _dot(q, T)
        dg = dq - dT * _dot(q, T) - T * (_dot(dq, T) + _dot(q, dT))
        size = np.sqrt(_dot(g, g))
        e1 = g / size
        de1 = (dg - e1 * _dot(e1, dg)) / size
        e2 = np.cross(T, e1)
        return (T, e1, e2), (de1, np.cross(dT, e1) + np.cross(T, de1))

    def point(self, u: Array, v: Array, w: Array) -> Array:
        """Return M(u, v, w); arguments broadcast, the result has one more axis of 3."""
        return self.point_and_tangents(u, v, w)[0]

    def point_and_tangents(self, u: Array, v: Array, w: Array) -> tuple[Array, ...]:
        """Return M, M_u, M_v and M_w."""
        # the guide and its frame are found once per u, the section once per v
        u, v, w = (np.asarray(x, dtype=float) for x in (u, v, w))
        N, dN, _ = self.guide_point(u)
        (_, e1, e2), (de1, de2) = self.frame(u)
        X, Y, X_v, Y_v = self.section(v)
        r = np.hypot(X, Y)
        r_v = (X * X_v + Y * Y_v) / r
        delta, growth = self.thickness(u)
        outward = w - self.share
        factor = 1 + delta * outward / r
        factor_v = -delta * outward * r_v / r**2
        x, y = X * factor, Y * factor
        x_u, y_u = X * growth * outward / r, Y * growth * outward / r
        x_v, y_v = X_v * factor + X * factor_v, Y_v * factor + Y * factor_v

        def place(p: Array, q: Array) -> Array:
            return p[..., None] * e1 + q[..., None] * e2

        M_u = dN + x[..., None] * de1 + y[..., None] * de2 + place(x_u, y_u)
        return (
            N + place(x, y),
            M_u,
            place(x_v, y_v),
            place(X * delta / r, Y * delta / r),
        )

    def integrals(self, nodes_u: int = 60, nodes_v: int = 480) -> Integrals:
        """Integrate with Gauss rules; v with one rule per arc, or with equal steps where smooth."""
        u, wu = gauss(nodes_u)
        v, wv = gauss_per_arc(nodes_v // self.arcs, self.arcs)
        w, ww = gauss(4)
        U, V, W = u[:, None, None], v[None, :, None], w[None, None, :]
        M, M_u, M_v, M_w = self.point_and_tangents(U, V, W)
        det = np.einsum("...i,...i->...", M_u, np.cross(M_v, M_w))
        weights = wu[:, None, None] * wv[None, :, None] * ww * det
        volume = weights.sum()
        centroid = np.tensordot(weights, M, axes=3) / volume
        return Integrals(
            abs(float(volume)),
            (float(centroid[0]), float(centroid[1]), float(centroid[2])),
            self._areas((u, wu), (v, wv), (w, ww)),
        )

    def _areas(self, *rules: tuple[Array, Array]) -> dict[str, float]:
        (u, wu), (v, wv), (w, ww) = rules
        areas = {}
        for limit in (0.0, 1.0):
            _, M_u, M_v, _ = self.point_and_tangents(u[:, None], v[None, :], np.array(limit))
            normal = np.linalg.norm(np.cross(M_u, M_v), axis=-1)
            areas[f"w={limit:g}"] = float(wu @ normal @ wv)
            _, _, M_v, M_w = self.point_and_tangents(np.array(limit), v[:, None], w[None, :])
            normal = np.linalg.norm(np.cross(M_v, M_w), axis=-1)
            areas[f"u={limit:g}"] = float(wv @ normal @ ww)
        return areas


def gauss(count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, weight / 2


def gauss_per_arc(count: int, arcs: int) -> tuple[Array, Array]:
    """Equal steps where v is periodic and analytic, else one Gauss rule per arc of v."""
    if arcs == 1:
        return (np.arange(count) + 0.5) / count, np.full(count, 1 / count)
    x, weight = gauss(count)
    return ((x + np.arange(arcs)[:, None]) / arcs).ravel(), np.tile(weight / arcs, arcs)


def channel(
    case: str,
    guide: str,
    share: float = 0.5,
    thickness: Thickness | None = None,
    kind: str = "E=D",
) -> Channel:
    """Return a channel of the reference table: 8a, 8b, 8c or the circle, on G1 or G2."""
    return Channel(
        GUIDES[guide],
        SECTIONS[case],
        thickness or constant(THICKNESS[case]),
        share,
        BREAKS[case],
        kind,
    )
