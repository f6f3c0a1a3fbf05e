"""Mass, centre of mass and inertia against closed forms, and the laws that they obey."""

from __future__ import annotations

import json
from fractions import Fraction
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import checked_of, part_of

import pc2cad as pc
from pc2cad.channels.layers import depth
from pc2cad.checked import CheckedMap, check_map
from pc2cad.cli.main import main
from pc2cad.domain.analysis import analyse
from pc2cad.domain.jacobian_watch import JacobianWatch
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError
from pc2cad.expression.tree import ONE, number, substitute
from pc2cad.integrals.exact import exact_second_moments
from pc2cad.integrals.inertia import Mass, joined, mass_of, principal_axes
from pc2cad.integrals.mass_properties import integrate

U, V, W = pc.parameters()


def checked(x: object, y: object, z: object) -> CheckedMap:
    return check_map(point_equation((x, y, z)))


def weighed(density: float, x: object, y: object, z: object) -> Mass:
    """Return mass properties without the look at overlaps, which laws do not need."""
    analysis = analyse(point_equation((x, y, z)))
    return mass_of(analysis, integrate(analysis), [density])


def test_a_block_is_the_fraction() -> None:
    found = checked(2 * U, 3 * V, 4 * W).mass_properties(0.5)
    assert (found.mass, found.centroid, found.relative_error) == (12.0, (1.0, 1.5, 2.0), 0.0)
    assert found.inertia == ((25.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 13.0))
    assert found.principal == (13.0, 20.0, 25.0)
    assert found.axes == ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
    assert found.radii_of_gyration == tuple(np.sqrt(np.array([13.0, 20.0, 25.0]) / 12))


def test_a_pyramid_is_the_fraction() -> None:
    """A tetrahedron abcd: V/20 (Σ p pᵀ + 16 c cᵀ) - V c cᵀ about the centroid."""
    corners = [(4, 0, 0), (1, 5, 1), (-2, -1, 0), (1, 1, 6)]
    volume, c = Fraction(63, 2), [Fraction(sum(p[i] for p in corners), 4) for i in range(3)]
    exact = tuple(
        tuple(
            volume / 20 * (sum(p[i] * p[j] for p in corners) + 16 * c[i] * c[j])
            - volume * c[i] * c[j]
            for j in range(3)
        )
        for i in range(3)
    )
    assert exact_second_moments(analyse(pc.read_template("pyramid").bind())) == exact


@pytest.mark.parametrize(
    ("name", "inertia"),
    [
        ("ball", np.eye(3) * (2 / 5 * 4)),
        ("torus", np.diag([(4 * 25 + 5 * 4) / 8] * 2 + [25 + 3])),
        ("cone", np.diag([3 / 20 * 9 + 3 / 80 * 16] * 2 + [3 / 10 * 9])),
        ("hollow_cylinder", np.diag([(3 * 13 + 25) / 12] * 2 + [13 / 2])),
    ],
)
def test_closed_forms(name: str, inertia: np.ndarray) -> None:
    """Of mass 1; torus: (4R² + 5r²)/8 across and R² + 3r²/4 about its axis."""
    found = checked_of(name).mass_properties(7.85e-6)
    unit = np.array(found.inertia) / found.mass
    np.testing.assert_allclose(unit, inertia, rtol=1e-12, atol=1e-12 * inertia.max())
    assert found.mass == pytest.approx(7.85e-6 * checked_of(name).mass.volume, rel=1e-15)
    assert 0 < found.relative_error < 1e-12


def test_layers_of_two_densities() -> None:
    """A rod of radius 1 and a sleeve on it to 2, both 1 high."""
    r = depth([ONE, ONE])(W)
    x, y = r * pc.cos(2 * pc.pi * U), r * pc.sin(2 * pc.pi * U)
    equation = point_equation((x, y, V)).layered(("rod", "sleeve"))
    found = check_map(equation).mass_properties({"rod": 2.0, "sleeve": 3.0})
    assert found.mass == pytest.approx(2 * pi + 9 * pi, rel=1e-13)
    assert found.inertia[2][2] == pytest.approx(2 * pi / 2 + 3 * pi / 2 * 15, rel=1e-12)
    assert found.density == pytest.approx(11 / 4, rel=1e-13)
    assert [found.layers[k].mass for k in ("rod", "sleeve")] == pytest.approx([2 * pi, 9 * pi])
    assert found.layers["sleeve"].inertia[2][2] == pytest.approx(45 * pi / 2, rel=1e-12)


eighths = st.integers(-24, 24).map(lambda n: Fraction(n, 8))
few = settings(max_examples=6, deadline=None)


@few
@given(st.lists(eighths, min_size=3, max_size=3), st.floats(0.1, 5))
def test_the_parallel_axis_law(way: list[Fraction], density: float) -> None:
    """A moved body has the same tensor; two halves, joined, are the whole."""
    bent = (U, V * (1 + U * U), W + U * V)
    here = weighed(density, *bent)
    there = weighed(density, *(c + d for c, d in zip(bent, way, strict=True)))
    np.testing.assert_allclose(there.inertia, here.inertia, rtol=1e-12, atol=1e-13)
    moved = np.subtract(there.centroid, here.centroid)
    np.testing.assert_allclose(moved, [float(d) for d in way], atol=1e-12)
    halves = {k: weighed(density, *substitute(bent, {"u": (U + k) / 2})) for k in (0, 1)}
    whole = joined({str(k): half for k, half in halves.items()}, here.mass / density)
    np.testing.assert_allclose(whole.inertia, here.inertia, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(whole.centroid, here.centroid, rtol=1e-12)


def turned_about(axis: int, half: Fraction) -> list[list[Fraction]]:
    """Return the turn whose half has this tangent: its entries are fractions."""
    c, d = (1 - half**2) / (1 + half**2), 2 * half / (1 + half**2)
    rows = [[Fraction(i == j) for j in range(3)] for i in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows[i][i] = rows[j][j] = c
    rows[i][j], rows[j][i] = -d, d
    return rows


@few
@given(st.integers(0, 2), eighths)
def test_the_rotation_law(axis: int, half: Fraction) -> None:
    body, turn = (U, V * (1 + U * U), W + U * V), turned_about(axis, half)
    here = weighed(1.0, *body)
    rows = [sum((t * c for t, c in zip(row, body, strict=True)), number(0)) for row in turn]
    turned = weighed(1.0, *rows)
    R = np.array(turn, dtype=float)
    wanted = R @ np.array(here.inertia) @ R.T
    np.testing.assert_allclose(turned.inertia, wanted, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(turned.principal, here.principal, rtol=1e-12)


@few
@given(st.lists(eighths, min_size=9, max_size=9))
def test_axes_are_right_handed_and_diagonalise(entries: list[Fraction]) -> None:
    root = np.array(entries, dtype=float).reshape(3, 3) + 4 * np.eye(3)
    tensor = root @ root.T
    moments, axes = principal_axes(tensor)
    assert list(moments) == sorted(moments)
    np.testing.assert_allclose(axes @ tensor @ axes.T, np.diag(moments), atol=1e-12 * moments[2])
    assert np.linalg.det(axes) == pytest.approx(1.0, rel=1e-12)


def test_a_balls_axes_are_x_y_and_z() -> None:
    assert np.array_equal(checked_of("ball").mass_properties().axes, np.eye(3))


def test_a_proved_sign_of_det_j_changes_no_integral_and_is_not_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A bent pipe: no node can show another sign than the proved one."""
    analysis = analyse(pc.read_template("torus_tube").bind())
    looked = integrate(analysis)
    monkeypatch.setattr(JacobianWatch, "note", None)
    assert integrate(analysis, proved=True) == looked
    with pytest.raises(TypeError):
        integrate(analysis)


def test_what_is_no_density_is_refused() -> None:
    part = part_of("ball")
    for density in (0, -1.0, float("nan"), float("inf"), True):
        with pytest.raises(InputError, match="a density is a positive number"):
            part.mass_properties(density)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="has no layers"):
        part.mass_properties({"core": 1.0})


def test_check_tells_the_mass(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "pyramid", "--density", "7.85e-6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["mass"]
    assert found["mass"] == pytest.approx(31.5 * 7.85e-6, rel=1e-15)
    assert found["centroid"] == [1.0, 1.25, 1.75]
    assert [len(row) for row in found["inertia"] + found["axes"]] == [3] * 6
    assert np.trace(found["inertia"]) == pytest.approx(sum(found["principal"]), rel=1e-14)
    assert main(["check", "pyramid", "--density", "1/2"]) == 0
    shown = capsys.readouterr().out
    assert "Mass (density times mm^3; equation (closed form over the rationals))" in shown
    assert main(["check", "pyramid", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mass"] is None


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("--density", "-2"), "--density: must be a positive density"),
        (("--density", "core=2"), "has no layers"),
        (("--density", "1", "--density", "2"), "give one for all, or LAYER=VALUE"),
        (("--density", "a=1", "--density", "a=2"), "set twice"),
    ],
)
def test_densities_on_the_command_line(
    given: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "pyramid", *given]) == 2
    assert told in capsys.readouterr().err
