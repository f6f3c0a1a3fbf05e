"""Taylor models of Fourier series: all their waves at once, as products of matrices.

The derivatives of a series are series, so that its Taylor coefficients on a grid of boxes are
products of matrices each. What the others add is bounded wave by wave: |cos| of a complex angle is
at most what the absolute values of its power series add up to.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import vectors
from pc2cad.bounds.taylor_models import SLACK, TINY, UNIT, Model
from pc2cad.bounds.taylor_products import product
from pc2cad.expression.wave_values import jet, moment, rounding, table_of
from pc2cad.expression.waves import Waves

#: reaches are rounded up to so many binary places, so that boxes of one size share their bounds
PLACES = 7


def model_of(waves: Waves, theta: Model, phi: Model, order: int) -> Model:
    """Return the model of the series at two angles."""
    reach = _rounded_up(theta.reach), _rounded_up(phi.reach)
    radius, along, across = _left(waves, reach[0], reach[1], order)
    angles = theta.centre, phi.centre
    powers = [_powers(x, order) for x in (theta, phi)]
    boxes = np.broadcast_shapes(theta.centre.shape, phi.centre.shape)
    degrees = zip(*(x[-1].shape[:2] for x in powers), strict=True)
    terms = np.zeros((*(min(a + b - 1, order + 1) for a, b in degrees), *boxes))
    wanted = [
        (i, j) for i in range(len(powers[0])) for j in range(len(powers[1])) if i + j <= order
    ]
    lost = np.zeros(boxes)
    for (i, j), value in jet(waves, *angles, wanted):
        share = 1.0 / (factorial(i) * factorial(j))
        factor, whole = value * share, reach[0] ** i * reach[1] ** j
        term = product(powers[0][i], powers[1][j], order)
        highest = tuple(n - 1 for n in term.shape[:2])
        if np.count_nonzero(term) == np.count_nonzero(term[highest]):
            terms[highest] += factor * term[highest]
        else:
            # powers of angles that bend lose products beyond the order
            terms[: term.shape[0], : term.shape[1]] += factor * term
            kept = np.abs(term).sum(axis=(0, 1))
            beyond = _size(theta) ** i * _size(phi) ** j * SLACK - kept
            lost = lost + np.abs(factor) * np.maximum(beyond, 0.0)
        off = rounding(waves, *angles, i, j) * share + 64 * UNIT * np.abs(factor)
        lost = lost + off * whole
    spread = along * (theta.radius + theta.error) + across * (phi.radius + phi.error)
    radius = (radius + lost + spread) * SLACK + TINY
    error = moment(waves, 1, 0) * theta.error + moment(waves, 0, 1) * phi.error
    most = (np.abs(theta.centre) + reach[0], np.abs(phi.centre) + reach[1])
    return Model(terms, radius, (error + rounding(waves, *most)) * SLACK + TINY)


def _size(x: Model) -> Array:
    """Return the sum of a model's |terms| without its centre."""
    return np.asarray(x.sizes[1:].sum(axis=0))


def _powers(x: Model, order: int) -> list[Array]:
    """Return the powers of a model's polynomial without its centre, up to the order."""
    moving = x.terms.copy()
    moving[0, 0] = 0.0
    result = [np.ones((1, 1, 1, 1))]
    if not moving.any():
        return result
    for _ in range(order):
        result.append(product(result[-1], moving, order))
    return result


def _rounded_up(x: Array) -> Array:
    """Return numbers of few digits that are not less."""
    mantissa, exponent = np.frexp(x)
    return np.asarray(np.ldexp(np.ceil(np.ldexp(mantissa, PLACES)), exponent - PLACES))


def _left(waves: Waves, first: Array, second: Array, order: int) -> tuple[Array, Array, Array]:
    """Return bounds of Taylor's series beyond the order, and of the slopes in both angles.

    For complex angles within so much of their centres. A wave of |amplitude| a adds at most
    a x^(n+1)/(n+1)! exp(x) with x = m·first + |k|·second.
    """
    (a, row), (b, column) = (np.unique(x, return_inverse=True) for x in (first, second))
    m, k, amplitude = _by_size(waves)
    x = (m * a[:, None])[:, None, :] + (k * b[:, None])[None, :, :]
    grown = amplitude * np.exp(x)
    tails = grown * x ** (order + 1) / factorial(order + 1)
    bounds = np.stack((vectors(grown, m), vectors(grown, k), tails.sum(axis=2)))
    bounds = np.where(np.isfinite(bounds), bounds * (1 + 1e-10), np.inf)
    shape = np.broadcast_shapes(first.shape, second.shape)
    rows, columns = (
        np.broadcast_to(index.reshape(x.shape), shape)
        for index, x in ((row, first), (column, second))
    )
    along, across, tail = bounds[:, rows, columns]
    return tail, along, across


@lru_cache(maxsize=512)
def _by_size(waves: Waves) -> tuple[Array, Array, Array]:
    """Return m, |k| and the sum of the amplitudes that share them."""
    table = table_of(waves)
    places, back = np.unique(np.stack((table.m, np.abs(table.k))), axis=1, return_inverse=True)
    amplitude = np.zeros(places.shape[1])
    np.add.at(amplitude, back.ravel(), table.amplitude)
    return places[0], places[1], amplitude * (1 + 1e-12)
