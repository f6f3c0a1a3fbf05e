"""Fields: read, held against their expression, integrated, bounded, weighed, and refused."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from shipped import checked_of, part_of

import pc2cad as pc
from pc2cad.channels.layers import depth
from pc2cad.checked import CheckedMap, check_map
from pc2cad.cli.main import main
from pc2cad.domain.analysis import analyse
from pc2cad.domain.fields import FieldNotFiniteError, local_field
from pc2cad.equation.fields import FieldError, FieldValue
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError
from pc2cad.expression.tree import ONE, symbol
from pc2cad.integrals.fields import integrate_field, mass_by_field
from pc2cad.integrals.inertia import Mass
from pc2cad.integrals.mass_properties import integrate
from pc2cad.sampling.fields import field_values

U, V, W = pc.parameters()
TEMPLATE = """
title = "Bar"
[parameters]
L = 6
[solid]
x = "L*u"
y = "3*v"
z = "4*w"
[fields]
density = "1 + x/L"
warm = "2*density + w"
flow = "vector(u, x, 1)"
"""


def bar(tmp_path: Path, fields: str = "") -> Path:
    path = tmp_path / "bar.toml"
    path.write_text(TEMPLATE + fields)
    return path


def with_fields(name: str, **fields: FieldValue) -> CheckedMap:
    """Return a shipped map with fields, checked once for all tests."""
    known = checked_of(name)
    analysis = replace(known.analysis, equation=known.equation.with_fields(**fields))
    return replace(known, analysis=analysis)


def test_a_field_is_its_expression_at_random_places() -> None:
    """To rounding at parameters; at points as near as they are found, within 1e-10 of the size."""
    texts = {
        "bent": ("sin(x) + y*z - w", lambda u, p: np.sin(p[0]) + p[1] * p[2] - u[2]),
        "way": ("vector(x, 2*v, x*y)", lambda u, p: np.stack([p[0], 2 * u[1], p[0] * p[1]], 1)),
        "place": ("point(x, y, z)", lambda u, p: p.T),
    }
    seen = 0
    for name in ("torus", "channel_ellipse", "pyramid"):
        checked = with_fields(name, **{key: text for key, (text, _) in texts.items()})
        local = np.random.default_rng(3).uniform(0.02, 0.98, (40, 3))
        points = checked.map.points(*local.T)
        own = np.stack([checked.map.values(d, local[:, d]) for d in range(3)], axis=1)
        for key, (_, formula) in texts.items():
            exact = formula(own.T, points.T)
            size = np.abs(exact).max()
            for found, room in (
                (field_values(checked, key, None, own), 1e-14),
                (field_values(checked, key, points, None), 1e-9),
            ):
                np.testing.assert_allclose(found, exact, rtol=0, atol=room * size)
                seen += 1
    assert seen == 18


def test_a_graded_bar(tmp_path: Path) -> None:
    """Density 1 + x/L on [0, L]: 3/2 of the volume, centre at 5L/9."""
    checked = check_map(pc.read_template(bar(tmp_path)).bind({"L": 9}))
    found = checked.mass_properties()
    assert (found.mass, found.centroid, found.relative_error) == (162.0, (5.0, 1.5, 2.0), 0.0)
    assert found.inertia[1][1] == pytest.approx(162 * (6.5 + 16 / 12), rel=1e-15)
    warm = checked.field_figures("warm")
    assert warm.whole.mean == (3.5,)
    assert (warm.least[0].seen, warm.largest[0].seen) == (2.0, 5.0)
    assert warm.evidence == "bounded"
    assert 2 - 1e-14 < warm.least[0].bound <= 2.0
    assert 5.0 <= warm.largest[0].bound < 5 + 1e-14
    assert checked.field_figures("flow").whole.mean == (0.5, 4.5, 1.0)


@pytest.mark.parametrize(
    ("name", "field", "integral"),
    [
        # a ball of radius 2; a torus of 5 and 2
        ("ball", "x^2 + y^2 + z^2", 4 * pi * 2**5 / 5),
        ("ball", "x*y", 0.0),
        ("torus", "x^2", 2 * pi**2 * 5 * 4 * (25 / 2 + 3 * 4 / 8)),
        ("cone", "z", pi * 9 * 4**2 / 12),
    ],
)
def test_integrals_are_closed_forms(name: str, field: str, integral: float) -> None:
    checked = with_fields(name, f=field)
    found = integrate_field(checked.analysis, checked.mass, local_field(checked.analysis, "f"))
    assert found.integral[0] == pytest.approx(integral, rel=1e-12, abs=found.error)
    assert 0 < found.error < 1e-9 * checked.mass.volume * 50


def test_extremes_hold_all_that_is_seen() -> None:
    """Bounds lie beyond, and near, the values at many random places."""
    checked = with_fields("cone", f="sin(x) + y*z/5")
    local = np.random.default_rng(5).uniform(0, 1, (20_000, 3))
    seen = local_field(checked.analysis, "f").at(*local.T)[:, 0]
    found = checked.field_figures("f")
    low, high = found.least[0], found.largest[0]
    assert low.bound <= low.seen <= seen.min()
    assert seen.max() <= high.seen <= high.bound
    assert high.bound - low.bound < 1.01 * (high.seen - low.seen)


def _weighed(field: str, *coordinates: object) -> Mass:
    analysis = analyse(point_equation(coordinates).with_fields(density=field))
    return mass_by_field(analysis, integrate(analysis), local_field(analysis, "density"))


def test_a_density_of_the_place_is_the_same_in_other_parameters() -> None:
    """A block by its own parameters, and by bent ones (no polynomial): mass and inertia agree."""
    exact = _weighed("1 + x*y", 2 * U, 3 * V, W)
    bent = _weighed("1 + x*y", 2 * (pc.exp(U) - 1) / (pc.e - 1), 3 * V, W)
    assert exact.relative_error == 0 < bent.relative_error
    assert exact.mass == 6 * 2.5
    assert bent.mass == pytest.approx(exact.mass, rel=1e-12)
    np.testing.assert_allclose(bent.centroid, exact.centroid, rtol=1e-12)
    np.testing.assert_allclose(bent.inertia, exact.inertia, rtol=1e-11, atol=1e-12)


def test_layers_are_weighed_by_a_field() -> None:
    """A rod of radius 1 and a sleeve on it to 2, of the density r."""
    r = depth([ONE, ONE])(W)
    x, y = r * pc.cos(2 * pc.pi * U), r * pc.sin(2 * pc.pi * U)
    equation = point_equation((x, y, V)).layered(("rod", "sleeve")).with_fields(density=r)
    analysis = analyse(equation)
    found = mass_by_field(analysis, integrate(analysis), local_field(analysis, "density"))
    assert found.mass == pytest.approx(2 * pi * 8 / 3, rel=1e-13)
    masses = [found.layers[name].mass for name in ("rod", "sleeve")]
    assert masses == pytest.approx([2 * pi / 3, 2 * pi * 7 / 3], rel=1e-13)
    assert found.inertia[2][2] == pytest.approx(2 * pi * 32 / 5, rel=1e-12)


def test_check_tells_fields(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bar(tmp_path)
    assert main(["check", str(path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["mass"]["mass"] == 108.0
    assert list(data["fields"]) == ["density", "warm", "flow"]
    assert data["fields"]["density"]["mean"] == [1.5]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('"../a" = "u"', "is not the name of a field"),
        ('"a b" = "u"', "is not the name of a field"),
        ('"<script>" = "u"', "is not the name of a field"),
        ('x = "u"', "reserved"),
        ('side = "u"', "reserved"),
        ('L = "u"', "defined twice"),
        ('a = "late"\nlate = "u"', "unknown name 'late'"),
        ('a = "1/"', "[fields] a"),
        ("a = [1, 2]", "[fields] a"),
        ('Warm = "u"', "but for capitals"),
    ],
)
def test_bad_fields_are_refused(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(InputError, match=words.replace("[", r"\[").replace("]", r"\]")):
        pc.read_template(bar(tmp_path, line)).bind()


def test_bad_values_are_refused() -> None:
    checked = with_fields("cone", density="x", hole="1/x", way="vector(1, 0, 0)")
    with pytest.raises(InputError, match="the density density is -"):
        checked.mass_properties()
    with pytest.raises(FieldNotFiniteError, match="field hole"):
        checked.field_figures("hole")
    with pytest.raises(InputError, match="is a vector"):
        checked.mass_properties("way")
    with pytest.raises(InputError, match="has no field 'heat'"):
        checked.field_figures("heat")
    with pytest.raises(InputError, match="u runs from"):
        field_values(checked, "way", None, [(7, 0, 0)])
    with pytest.raises(FieldError, match="instead of 1 or 3"):
        checked.equation.with_fields(a=(1, 2))
    with pytest.raises(FieldError, match="depends on q"):
        checked.equation.with_fields(a=symbol("q"))


def test_a_part_gives_fields() -> None:
    part = part_of("cone")
    assert part.equation.fields == ()
    with pytest.raises(InputError, match="has no field"):
        part.field("heat", [(0, 0, 1)])
