"""Boxes that meet and places that are near are found as by looking at all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from pc2cad.arrays import boxes


@pytest.mark.parametrize("count", [0, 1, 300, boxes.FEW, boxes.FEW + 300])
@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_the_boxes_that_meet_are_those_of_all_pairs(count, gap):
    # on a coarse grid, so that many just touch
    rng = np.random.default_rng(count)
    low = rng.integers(0, 60, (count, 3)) / 64
    high = low + rng.integers(0, 6, (count, 3)) / 64
    first, second = np.triu_indices(count)
    near = (low[first] <= high[second] + gap) & (low[second] <= high[first] + gap)
    rows = near.all(axis=1)
    wanted = np.column_stack((first[rows], second[rows]))
    assert len(wanted) >= count
    assert np.array_equal(boxes.meeting(low, high, gap), wanted)


@pytest.mark.parametrize("few", [0, 90])
def test_boxes_in_one_heap_are_looked_at_a_slab_at_a_time(monkeypatch, few):
    for name, value in (("FEW", few), ("_SLAB", 100), ("_TABLE", 100)):
        monkeypatch.setattr(boxes, name, value)
    low = np.zeros((90, 2))
    assert np.array_equal(boxes.meeting(low, low + 1), np.stack(np.triu_indices(90), axis=1))


def test_a_box_that_has_no_inside_does_not_meet_itself():
    low = np.arange(100.0)[:, None]
    assert len(boxes.meeting(low, low - 0.5)) == 0
    broken = np.where(low == 7, np.nan, low)
    assert len(boxes.meeting(broken, broken)) == 99


def test_near_places_are_among_those_found():
    rng = np.random.default_rng(1)
    places = rng.integers(-3, 3, (400, 3)) + rng.normal(size=(400, 3)) * 1e-3
    near = boxes.Near(1e-3)
    found = 0
    for k, place in enumerate(places):
        told = near.of(place.tolist())
        assert told == sorted(told)
        wanted = np.flatnonzero(np.abs(places[:k] - place).max(axis=1) < 1e-3)
        assert set(wanted.tolist()) <= set(told)
        found += len(wanted)
        near.add(place.tolist())
    assert found > 20
