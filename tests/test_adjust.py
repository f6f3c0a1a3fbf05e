"""Parameters that are found from what the solid is to be, against closed forms."""

from __future__ import annotations

import json
import math
from math import pi
from pathlib import Path

import pytest
from shipped import CUBES
from whole_files import assert_whole

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.errors import InputError
from pc2cad.studies.adjust import Adjusted, Goal, GoalsNotMetError, adjust, read_goal
from pc2cad.templates.ranges import RangeError

BLOCK = """
title = "A block"
[parameters]
a = { default = 1, min = 0.1, max = 100 }
b = { default = 2, min = 0.1, max = 100 }
c = { default = 3, min = 0.1, max = 100 }
[solid]
x = "a*u"
y = "b*v"
z = "c*w"
"""


def block(
    goals: tuple[str, ...], minimise: str | None = None, **vary: tuple[float, float]
) -> Adjusted:
    from pc2cad.templates.file import parse_template

    template = parse_template(BLOCK, "block")
    return adjust(template, vary, [read_goal(g) for g in goals], minimise=minimise)


def test_a_volume_is_met() -> None:
    found = adjust(pc.read_template("ball"), {"R": (0.2, 5)}, [Goal("volume", "=", 200.0)])
    assert found.parameters["R"] == pytest.approx((150 / pi) ** (1 / 3), rel=1e-12)
    assert found.figures["volume"] == pytest.approx(200, rel=1e-12)
    assert found.evaluations < 15
    assert found.at_limits == ()


@pytest.mark.parametrize("also", ["x=0", "Ixy=0", "z<=0"])
def test_a_goal_of_nothing_is_met_to_rounding(also: str) -> None:
    """The centroid of a ball is at 1e-17, of which there is nothing to be held against."""
    found = adjust(pc.read_template("ball"), {"R": (0.2, 5)}, ["volume=200", also])
    assert found.parameters["R"] == pytest.approx((150 / pi) ** (1 / 3), rel=1e-10)


@pytest.mark.slow
def test_three_figures_give_three_parameters() -> None:
    """Centroid and volume: a = 4, b = 5 and c = 6."""
    found = block(("x=2", "volume=120", "z=3"), a=(1, 9), b=(1, 9), c=(1, 9))
    assert found.parameters == pytest.approx({"a": 4, "b": 5, "c": 6}, rel=1e-11)
    assert found.evaluations < 15


@pytest.mark.slow
def test_the_least_area_of_a_volume() -> None:
    """Of blocks the cube."""
    found = block(("volume=8",), "area", a=(0.5, 9), b=(0.5, 9), c=(0.5, 9))
    assert found.parameters == pytest.approx({"a": 2, "b": 2, "c": 2}, rel=1e-7)
    assert found.figures["area"] == pytest.approx(24, rel=1e-12)


def test_the_cone_of_least_area_is_found_in_few_evaluations() -> None:
    """Of a volume: h = 2√2 r, from a cone of a fifth of it."""
    found = pc.adjust("cone", {"r": (0.2, 8), "h": (0.2, 30)}, ["volume=200"], minimise="area")
    r = (600 / (2 * math.sqrt(2) * math.pi)) ** (1 / 3)
    wanted = {"r": r, "h": 2 * math.sqrt(2) * r}
    assert found.parameters == pytest.approx(wanted, rel=1e-10)
    assert found.evaluations < 15


def test_what_is_met_already_is_left_and_limits_are_told() -> None:
    assert block(("volume<=10", "Izz>=0"), a=(0.5, 9)).parameters == {"a": 1.0}
    found = block(("volume<=10",), "volume", a=(0.5, 9))
    assert found.parameters == pytest.approx({"a": 0.5}, rel=1e-12)
    assert found.at_limits == ("a",)


@pytest.mark.slow
def test_what_cannot_be_is_said_in_words() -> None:
    with pytest.raises(GoalsNotMetError) as told:
        block(("volume=200",), a=(0.2, 3), b=(1, 2))
    assert str(told.value) == (
        "with a from 0.2 to 3, b from 1 to 2 the nearest solid found has a = 3, b = 2: "
        "volume = 200 is not met, volume is 18"
    )


def test_a_near_miss_has_the_digits_that_tell_it() -> None:
    goal = Goal("volume", "=", 330000.0)
    assert goal.missed(18.0) == "volume = 330000 is not met, volume is 18"
    assert goal.missed(330000.0004) == "volume = 330000 is not met, volume is 330000.0004"


@pytest.mark.slow
def test_several_bodies_are_adjusted() -> None:
    """A cube of 8 with a bar beside it: A = 24 + 4 (d - 1)."""
    from pc2cad.templates.file import parse_template

    template = parse_template(CUBES.format(result="union(big, small)"), "cubes")
    found = adjust(template, {"d": (1.1, 1.9)}, [read_goal("area=26")])
    assert found.parameters == pytest.approx({"d": 1.5}, rel=1e-10)
    assert found.evaluations < 15


def test_what_is_not_well_put_is_refused() -> None:
    for goals, vary, words in (
        ((), {"a": (1, 2)}, "say what is wanted"),
        (("volume=1",), {}, "say which parameters may change"),
        (("volume=1",), {"q": (1, 2)}, "has no parameter 'q'"),
        (("volume=1",), {"a": (0, 2)}, "outside its range"),
    ):
        with pytest.raises(InputError, match=words):
            block(goals, **vary)
    for text in ("weight=3", "volume", "volume=x", "volume==3"):
        with pytest.raises((InputError, RangeError)):
            read_goal(text)


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "block.step"
    (tmp_path / "block.toml").write_text(BLOCK)
    call = ["adjust", str(tmp_path / "block.toml"), "--vary", "c=1:50", "-s", "a=2"]
    goal = ["--density", "1/2", "--until", "mass=20"]
    assert main([*call, *goal, "-o", str(file), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"] == pytest.approx({"c": 10.0}, rel=1e-12)
    assert found["figures"]["volume"] == pytest.approx(40)
    assert found["files"] == [str(file)]
    assert_whole(file)
    assert main([*call, *goal]) == 0
    assert "mass = 20; " in capsys.readouterr().out
    for arguments, told in (
        (["--until", "volume=1e9"], "volume = 1000000000 is not met"),
        (["--until", "volume=1", "-s", "c=3"], "c is set (-s) and varied"),
        (["--until", "volume=1", "-o", str(tmp_path / "a.xyz")], ".xyz"),
        (["--until", "volume=1", "--vary", "c=1:2"], "varied twice"),
        (["--until", "volume=1", "--vary", "b=1,2"], "write NAME=LOW:HIGH"),
        (["--until", "weight=1"], "is none of volume, area"),
        (["--minimise", "area", "--maximise", "area"], "cannot be asked for at once"),
    ):
        assert main([*call, *arguments]) == 2
        assert told in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["block.step", "block.toml"]
