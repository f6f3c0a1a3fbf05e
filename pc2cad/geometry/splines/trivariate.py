"""Trivariate splines: volumes as tensor products of three univariate spline spaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import along
from pc2cad.geometry.splines.rational import Parametrisation
from pc2cad.geometry.splines.spline_basis import spline_values
from pc2cad.geometry.splines.spline_space import SplineSpace

#: values on the product of three parameter arrays: shape (len, len, len, 3), of a field (…, k)
GridSampler = Callable[[Array, Array, Array], Array]
#: Gauss nodes beyond the polynomial's need where there are weights
_RATIONAL_NODES = 10


@dataclass(frozen=True, eq=False)
class SplineVolume:
    """A clamped tensor-product spline on [0, 1]³, right-handed.

    `poles` have the shape (n, m, k, 3), first index along the first axis (of a field, as many
    components as it has); `weights` (n, m, k) are positive, None for a polynomial one.
    """

    axes: tuple[Parametrisation, Parametrisation, Parametrisation]
    poles: Array
    weights: Array | None

    @property
    def degrees(self) -> tuple[int, int, int]:
        """Degree along each axis."""
        a, b, c = (axis.space.degree for axis in self.axes)
        return a, b, c

    @property
    def knots(self) -> tuple[Array, Array, Array]:
        """Flat clamped knots along each axis."""
        a, b, c = (axis.space.knots for axis in self.axes)
        return a, b, c

    def __call__(self, x: Array, y: Array, z: Array) -> Array:
        """Return points on the product of three arrays of spline parameters."""
        bases = [
            axis.space.basis(t).toarray() for axis, t in zip(self.axes, (x, y, z), strict=True)
        ]
        return self._project(_contract(self._homogeneous, *bases))

    @property
    def _homogeneous(self) -> Array:
        if self.weights is None:
            return self.poles
        return np.concatenate(
            (self.poles * self.weights[..., None], self.weights[..., None]), axis=-1
        )

    def _project(self, values: Array) -> Array:
        return values if self.weights is None else values[..., :-1] / values[..., -1:]

    def split(self, axis: int, parts: int) -> list[SplineVolume]:
        """Return the same volume in pieces of equal numbers of knot spans, or of equal length.

        Knots that lie symmetrically are cut symmetrically.
        """
        space = self.axes[axis].space
        points, multiplicity = (
            space.points,
            dict(zip(space.points[1:-1].tolist(), space.multiplicities.tolist(), strict=True)),
        )
        spans = len(points) - 1
        cuts = np.linspace(0, 1, parts + 1)
        if spans >= parts:
            first = [round(k * spans / parts) for k in range((parts + 1) // 2)]
            middle = [] if parts % 2 else [spans / 2]
            at = [*first, *middle, *(spans - k for k in reversed(first))]
            cuts = np.interp(at, np.arange(spans + 1), points)
        pieces = []
        for low, high in pairwise(cuts):
            inner = [x for x in points.tolist() if low < x < high]
            local = [0.0, *((x - low) / (high - low) for x in inner), 1.0]
            part = SplineSpace(space.degree, local, [multiplicity[x] for x in inner])
            values = space.basis(low + (high - low) * part.sites) @ np.moveaxis(
                self._homogeneous, axis, 0
            ).reshape(space.size, -1)
            rest = np.delete(self._homogeneous.shape, axis)
            table = np.moveaxis(part.fit(values).reshape(part.size, *rest), 0, axis)
            # the way from a part's parameter to the equation's stays with the whole
            axes = [Parametrisation(part) if k == axis else a for k, a in enumerate(self.axes)]
            weights = None if self.weights is None else table[..., -1]
            poles = self._project(table)
            pieces.append(SplineVolume((axes[0], axes[1], axes[2]), poles, weights))
        return pieces

    def turned(
        self, order: tuple[int, int, int], backwards: tuple[bool, bool, bool]
    ) -> SplineVolume:
        """Return the volume with axes reversed (in their old order), and in another order.

        Its axes do not know the way to the equation's parameters.
        """
        flips = tuple(slice(None, None, -1 if back else 1) for back in backwards)
        spaces = [
            axis.space.reversed() if back else axis.space
            for axis, back in zip(self.axes, backwards, strict=True)
        ]
        a, b, c = (Parametrisation(spaces[k]) for k in order)
        poles = self.poles[flips].transpose(*order, 3)
        weights = None if self.weights is None else self.weights[flips].transpose(order)
        return SplineVolume((a, b, c), poles, weights)

    def volume(self) -> float:
        """Return the integral of the Jacobian determinant, by Gauss rules on every knot span.

        Exact to rounding without weights; with weights the rules have ten nodes more.
        """
        nodes, weights, values, slopes = zip(*map(self._rule, self.axes), strict=True)
        total = 0.0
        homogeneous = self._homogeneous
        step = max(1, 200_000 // (len(nodes[1]) * len(nodes[2])))
        for start in range(0, len(nodes[0]), step):
            part = slice(start, start + step)
            rows, turned = values[0][part], slopes[0][part]
            point = _contract(homogeneous, rows, values[1], values[2])
            tangents = [
                _contract(homogeneous, turned, values[1], values[2]),
                _contract(homogeneous, rows, slopes[1], values[2]),
                _contract(homogeneous, rows, values[1], slopes[2]),
            ]
            if self.weights is not None:
                place = self._project(point)
                tangents = [(t[..., :3] - t[..., 3:] * place) / point[..., 3:] for t in tangents]
            determinant = (np.cross(tangents[0], tangents[1]) * tangents[2]).sum(axis=-1)
            total += float(
                np.einsum("ijk,i,j,k", determinant, weights[0][part], weights[1], weights[2])
            )
        return total

    def _rule(self, axis: Parametrisation) -> tuple[Array, Array, Array, Array]:
        """Return nodes, weights, and the basis and its derivative there."""
        space = axis.space
        count = (3 * space.degree + 1) // 2 + (0 if self.weights is None else _RATIONAL_NODES)
        x, weight = np.polynomial.legendre.leggauss(count)
        lengths = np.diff(space.points)[:, None]
        nodes = (space.points[:-1, None] + lengths * (x + 1) / 2).ravel()
        p, n, knots = space.degree, space.size, space.knots
        net = np.diff(np.eye(n), axis=0) * (p / (knots[p + 1 : p + n] - knots[1:n]))[:, None]
        slopes = spline_values(knots[1:-1], net, p - 1, nodes)
        return nodes, (lengths * weight / 2).ravel(), space.basis(nodes).toarray(), slopes


def fit_volume(
    sample: GridSampler, axes: tuple[Parametrisation, Parametrisation, Parametrisation]
) -> SplineVolume:
    """Return the volume that fits a function of the equation's local parameters."""
    sites = [axis.space.sites for axis in axes]
    shares = [axis.weight(x) for axis, x in zip(axes, sites, strict=True)]
    x, y, z = (axis.places(t) for axis, t in zip(axes, sites, strict=True))
    values = sample(x, y, z)
    u, v, w = np.ix_(*shares)
    homogeneous = values * (u * v * w)[..., None]
    for k, axis in enumerate(axes):
        homogeneous = np.moveaxis(axis.space.fit(np.moveaxis(homogeneous, k, 0)), 0, k)
    if not any(axis.order for axis in axes):
        return SplineVolume(axes, homogeneous, None)
    a, b, c = np.ix_(*(axis.weights for axis in axes))
    weights = a * b * c
    return SplineVolume(axes, homogeneous / weights[..., None], weights)


def _contract(table: Array, x: Array, y: Array, z: Array) -> Array:
    for axis, matrix in enumerate((x, y, z)):
        table = along(matrix, table, axis)
    return table
