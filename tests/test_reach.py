"""How far a parameter may go, against where det J vanishes or a solid meets itself."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import InputError
from pc2cad.solidity.over_ranges.boxes import ProvedBox, around
from pc2cad.templates.file import parse_template

#: det J is p (1 - 2 q u): it vanishes at u = 1 where q = 1/2, and everywhere where p = 0
FOLDING = """
title = "A block that folds"
[parameters]
q = 0.2
p = 3
[solid]
x = "u - q*u^2"
y = "v"
z = "p*w"
"""


def folding() -> PointEquation:
    return parse_template(FOLDING, "folding").bind()


def test_a_block_reaches_to_where_it_folds() -> None:
    found = pc.reach(folding(), "q")
    # where det J vanishes on a side alone, it is a solid still
    assert found.high.holds <= 0.5 < found.high.breaks
    assert found.high.breaks - found.high.holds <= 1e-3 * 0.41
    assert "det J" in found.high.why
    # the other way it only gets longer
    assert found.low.breaks is None
    assert found.low.holds < -5
    assert 15 < found.evaluations < 50
    # det J is p (1 - 2 q u): it is proved to be positive up to what was found
    assert found.proved == (found.low.holds, found.high.holds)


def test_a_flat_block_is_the_end() -> None:
    found = pc.reach(folding(), "p")
    assert found.low.breaks == pytest.approx(0, abs=3e-3)
    assert 0 < found.low.holds < 0.01
    assert found.proved is not None
    assert found.proved[0] <= 0.01


def box(low: int, high: int, sign: int = 1) -> ProvedBox:
    return ProvedBox((("p", (Fraction(low), Fraction(high))),), sign)


@pytest.mark.parametrize(
    ("boxes", "limits"),
    [
        ([box(0, 1), box(1, 3)], (0, 3)),
        ([box(1, 3), box(-2, 1)], (-2, 3)),
        ([box(0, 1), box(1, 2), box(3, 4)], (0, 2)),
        ([box(-3, -1), box(1, 3)], (1, 3)),
        # beyond what is open there is another orientation
        ([box(-3, -1, -1), box(1, 2), box(4, 5)], (1, 2)),
        ([box(3, 4)], None),
        ([box(-4, 1)], None),
        ([], None),
    ],
)
def test_boxes_that_touch_are_one_range(boxes: list[ProvedBox], limits: Any) -> None:
    assert around(boxes, Fraction(2) if limits != (1, 2) else Fraction(1)) == limits


def test_the_command_line_tells_ranges(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pc2cad.studies.reach.DOUBLINGS", 6)
    monkeypatch.setattr("pc2cad.studies.reach.WITHIN", 0.1)
    path = tmp_path / "folding.toml"
    path.write_text(FOLDING)
    assert main(["sensitivities", str(path), "--for", "q", "--reach"]) == 0
    shown = capsys.readouterr().out
    assert "q = 0.2 may go (found by search)" in shown
    assert "; no end was found" in shown
    assert "  det J is proved to keep its sign from -" in shown
    assert main(["sensitivities", str(path), "--for", "q", "--reach", "--json"]) == 0
    high = json.loads(capsys.readouterr().out)["reach"]["q"]["high"]
    assert high["holds"] <= 0.5 < high["breaks"]


def test_a_range_belongs_to_a_parameter() -> None:
    with pytest.raises(InputError, match="no parameter 'r'"):
        pc.reach(folding(), "r")


@pytest.mark.slow
def test_nothing_leads_beyond_a_vanishing_determinant() -> None:
    """A pipe of inner radius r, bent with R = 3, its wall 1/2: it ends at r = 0 and r = 2.5.

    Below r = -1/2 there are solids again, of the other orientation.
    """
    found = pc.reach(pc.read_template("elbow_pipe").bind(), "r")
    assert found.low.breaks < 0 <= found.low.holds
    assert found.low.breaks > -2e-3
    assert found.high.holds < 2.5 <= found.high.breaks * (1 + 1e-12)
