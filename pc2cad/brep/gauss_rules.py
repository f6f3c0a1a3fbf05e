"""Gauss rules on spans and panels."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct


def gauss_on(knots: Array, count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on every span between knots."""
    spans = distinct(knots)
    x, weight = legendre(count)
    half = np.diff(spans)[:, None] / 2
    nodes = (spans[:-1, None] + spans[1:, None]) / 2 + half * x
    return nodes.ravel(), (half * weight).ravel()


def gauss(panels: Array, order: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on every panel (n, 2), panel by panel."""
    nodes, weights = nodes_between(panels, order)
    return nodes.ravel(), weights.ravel()


def nodes_between(limits: Array, count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule between limits (k, 2): shape (k, count)."""
    x, weight = legendre(count)
    return between(limits, x), (limits[:, 1:] - limits[:, :1]) / 2 * weight


def between(limits: Array, x: Array) -> Array:
    """Return the places (k, n) between limits (k, 2) of those on [-1, 1]."""
    return np.asarray(limits.mean(axis=1, keepdims=True) + (limits[:, 1:] - limits[:, :1]) / 2 * x)


@lru_cache(maxsize=8)
def rules_together(orders: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the ascending nodes (n,) of Gauss rules on [-1, 1], and weights of each (k, n)."""
    nodes = np.concatenate([legendre(order)[0] for order in orders])
    weights = np.zeros((len(orders), len(nodes)))
    start = 0
    for row, order in zip(weights, orders, strict=True):
        row[start : start + order] = legendre(order)[1]
        start += order
    ascending = np.argsort(nodes)
    return nodes[ascending], weights[:, ascending]


@lru_cache(maxsize=64)
def legendre(order: int) -> tuple[Array, Array]:
    """Return the nodes and weights of a Gauss rule on [-1, 1], read-only."""
    x, weight = np.polynomial.legendre.leggauss(order)
    x.flags.writeable = weight.flags.writeable = False
    return x, weight
