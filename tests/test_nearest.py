"""The nearest place of a point outside, held against a dense sampling of the boundary."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shipped import checked_of

from pc2cad.domain.map import open_grid
from pc2cad.sampling.interior import locate

SLOW = ("torus", "trefoil", "channel_sine", "duct", "hollow_ball")


@pytest.mark.parametrize(
    ("name", "count"),
    [("spring", 60), *(pytest.param(name, 2000, marks=pytest.mark.slow) for name in SLOW)],
)
def test_no_place_of_a_dense_sampling_is_nearer(name: str, count: int) -> None:
    checked = checked_of(name)
    analysis = checked.analysis
    parts = []
    for direction in range(3):
        for limit in (0.0, 1.0):
            nodes = [np.linspace(0, 1, 300)] * 3
            nodes[direction] = np.array([limit])
            parts.append(analysis.map.points(*open_grid(*nodes)).reshape(-1, 3))
    samples = np.concatenate(parts)
    low, high = samples.min(axis=0), samples.max(axis=0)
    random = np.random.default_rng(0)
    targets = (low + high) / 2 + (random.random((count, 3)) - 0.5) * (high - low) * 3
    found = locate(checked, targets)
    outside = ~found.inside
    assert outside.sum() > count / 2
    sampled, _ = cKDTree(samples).query(targets)
    assert (found.distance - sampled)[outside].max() <= 1e-9 * analysis.size
    assert found.gap.max() <= 1e-3 * analysis.size
    assert (found.gap[found.inside] == 0).all()
    # nothing sampled is nearer than what the gap leaves open
    assert (found.distance - found.gap - sampled)[outside].max() <= 1e-9 * analysis.size
