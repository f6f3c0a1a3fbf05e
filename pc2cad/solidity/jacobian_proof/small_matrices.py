"""Many 3×3 (or 1×1) matrices at once: inverses with signs, and bounds of the spectral radius."""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.expression.intervals import ULP


def inverse_and_sign(matrix: Array) -> tuple[Array, Integers]:
    """Return the inverses of matrices (n, m, m) and the sign of their determinants, 0 if unsure."""
    if matrix.shape[-1] == 1:
        return 1 / matrix, np.sign(matrix[:, 0, 0]).astype(int)
    rows = matrix.transpose(1, 0, 2)
    cofactors = np.stack([np.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)], axis=1)
    determinant = (matrix[:, 0] * cofactors[:, 0]).sum(axis=1)
    x, y, z = np.abs(matrix).transpose(1, 0, 2)
    terms = (
        x[:, 0] * (y[:, 1] * z[:, 2] + y[:, 2] * z[:, 1])
        + x[:, 1] * (y[:, 0] * z[:, 2] + y[:, 2] * z[:, 0])
        + x[:, 2] * (y[:, 0] * z[:, 1] + y[:, 1] * z[:, 0])
    )
    sure = np.abs(determinant) > 16 * ULP * terms
    sign = np.where(sure, np.sign(determinant), 0).astype(int)
    return cofactors.transpose(0, 2, 1) / determinant[:, None, None], sign


def dominant_vectors(bound: Array) -> Array:
    """Return positive vectors (n, m, 1) near the first eigenvectors of non-negative matrices."""
    x = np.ones((*bound.shape[:2], 1))
    for _ in range(4):
        x = x + bound @ x
        x = x / x.max(axis=1, keepdims=True)
    return x


def radius_bound(bound: Array, x: Array) -> Array:
    """Return max (bound x)_i / x_i, which is no less than the spectral radius (Collatz)."""
    return np.asarray(((bound @ x) / x).max(axis=(1, 2)))
