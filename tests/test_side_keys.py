"""What tells a side of the box from others, and the one place where its label is made."""

from __future__ import annotations

import pytest

from pc2cad.topology.cells import SideKey

#: v is creased in the middle, w lies between odd limits
LABELS = (("0", "1"), ("-1", "1/3 (of 1)", "1"), ("a:b", "c / d"))


@pytest.mark.parametrize(
    ("cell", "label", "whole"),
    [
        ((0, 1, 1), "u=0 (piece 1 of v)", "u=0"),
        ((2, 3, 1), "u=1 (piece 2 of v)", "u=1"),
        ((1, 0, 1), "v=-1", "v=-1"),
        ((1, 2, 1), "v=1/3 (of 1)", "v=1/3 (of 1)"),
        ((1, 1, 0), "w=a:b (piece 1 of v)", "w=a:b"),
        ((2, 1, 2), "u=1, w=c / d (piece 1 of v)", "u=1, w=c / d"),
    ],
)
def test_labels_are_made_from_keys_and_never_taken_apart(cell, label, whole):
    key = SideKey.of(cell, LABELS)
    assert (key.label, key.whole.label) == (label, whole)
    assert key.is_piece == (label != whole)
    assert not key.whole.is_piece
    assert SideKey(key.cell, LABELS, "rib").label == f"rib:{label}"


def test_pieces_of_one_side_are_different_and_have_one_whole():
    lower, upper = SideKey.of((0, 1, 1), LABELS), SideKey.of((0, 3, 1), LABELS)
    assert lower != upper
    assert lower.whole == upper.whole == SideKey.of((0, 1, 1), LABELS, shown=[0])
    # what limits are called tells nothing apart, the body does
    assert lower == SideKey(lower.cell, (("x", "y"),) * 3)
    assert lower != SideKey(lower.cell, LABELS, "rib")
