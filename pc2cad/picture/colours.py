"""Colour scales."""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.picture.scene import GREY

#: viridis (van der Walt, Smith; CC0), which colour-blind eyes read and grey prints keep in order
_VIRIDIS = np.array([
    (0.267, 0.005, 0.329), (0.283, 0.141, 0.458), (0.254, 0.265, 0.530), (0.207, 0.372, 0.553),
    (0.164, 0.471, 0.558), (0.128, 0.567, 0.551), (0.135, 0.659, 0.518), (0.267, 0.749, 0.441),
    (0.478, 0.821, 0.318), (0.741, 0.873, 0.150), (0.993, 0.906, 0.144),
])  # fmt: skip


def viridis(share: Array) -> Array:
    """Return the colours, shape + (3,), of numbers in 0…1; what is no number is 0."""
    places = np.linspace(0.0, 1.0, len(_VIRIDIS))
    clean = np.clip(np.nan_to_num(share), 0.0, 1.0)
    return np.stack([np.interp(clean, places, column) for column in _VIRIDIS.T], axis=-1)


def shares(values: Array, low: float, high: float) -> Array:
    """Return where values lie between low and high, as 0…1; the middle when those are equal."""
    return (values - low) / (high - low) if high > low else np.full_like(values, 0.5)


def limits_of(numbers: Array, scale: float | None = None) -> tuple[float, float]:
    """Return the least and the largest number; what is constant up to rounding has one.

    Rounding is held against `scale`, or against the numbers themselves.
    """
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return 0.0, 0.0
    low, high = float(known.min()), float(known.max())
    if high - low <= 1e-9 * (max(abs(low), abs(high)) if scale is None else scale):
        low = high = float(np.median(known))
    return low, high


def paint(numbers: Array, low: float, high: float) -> Array:
    """Return a colour per number, (n, 3); grey where there is none."""
    known = np.isfinite(numbers)[:, None]
    colours: Array = np.where(known, viridis(shares(numbers, low, high)), np.array(GREY))
    return colours
