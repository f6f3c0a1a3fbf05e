"""Faces and edges of polynomial maps in whole numbers, against what their trees tell."""

from fractions import Fraction
from math import lcm

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.domain.analysis import analyse
from pc2cad.domain.map import Mapping3
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.polynomials import (
    constant_of,
    constant_sums,
    polynomials,
    rational_polynomial,
)
from pc2cad.expression.tree import Number, symbol
from pc2cad.geometry.recognition.from_polynomials import (
    exact_plane,
    is_exactly_straight,
    normal_at,
)
from pc2cad.geometry.recognition.from_separable_form import is_straight, plane
from pc2cad.geometry.recognition.separable_form import separate
from pc2cad.solidity.orientation import _inner_zero, _is_clear

MAPS = ["pyramid_cut", "hexahedron", "bilinear_top", "triquadratic_cube", "hypar_slab"]


def cells(name: str) -> tuple[list[RestrictedMap], list[RestrictedMap]]:
    analysis = analyse(pc.read_template(name).bind())
    boundary = analysis.complex
    return (
        [RestrictedMap(analysis, face.patch) for face in boundary.faces],
        [RestrictedMap(analysis, edge.cell) for edge in boundary.edges],
    )


@pytest.mark.parametrize("name", MAPS)
def test_planes_are_those_of_the_trees_to_the_last_bit(name: str) -> None:
    for face in cells(name)[0]:
        assert face.polynomial is not None
        form = separate(*face.trees)
        assert form is not None
        found, told = face.exact_plane, plane(form)
        assert (found is None) == (told is None)
        if found is not None and told is not None:
            assert found.origin.tolist() == told.origin.tolist()
            assert found.normal.tolist() == told.normal.tolist()


@pytest.mark.parametrize("name", MAPS)
def test_forms_lines_and_normals_are_those_of_the_trees(name: str) -> None:
    faces, edges = cells(name)
    for cell in (*faces, *edges):
        form = separate(*cell.trees)
        assert form is not None
        assert cell.form is not None
        assert {key: v.tolist() for key, v in form.vectors.items()} == {
            key: v.tolist() for key, v in cell.form.vectors.items()
        }
    for edge in edges:
        form = separate(*edge.trees)
        assert form is not None
        assert edge.is_exactly_straight == is_straight(form)
    for face in faces:
        assert face.polynomial is not None
        vectors, scale = face.polynomial
        normal = np.array(normal_at(vectors, 0.3, 0.8)) / scale**2
        seen = face.normals(np.array([0.3]), np.array([0.8]))[0, 0]
        assert normal == pytest.approx(seen, rel=1e-12, abs=1e-12)


def test_nothing_is_told_by_too_little() -> None:
    line = {(0, 0): (1, 2, 3), (1, 0): (2, 0, 0), (0, 1): (4, 0, 0)}
    assert exact_plane(line, 1) is None
    # a normal that is rounding of the long steps
    needle = {(1, 0): (10**20, 0, 0), (0, 1): (10**20, 1, 0)}
    assert exact_plane(needle, 1) is None
    bent = {(1, 0): (1, 0, 0), (0, 1): (0, 1, 0), (1, 1): (0, 0, 1)}
    assert exact_plane(bent, 1) is None
    # on one line though its parts run in powers, and off it by one part in 10^40
    assert is_exactly_straight({(1,): (3, 6, 9), (2,): (-1, -2, -3)})
    assert not is_exactly_straight({(1,): (10**40, 0, 0), (2,): (10**40, 1, 0)})
    assert not is_exactly_straight({(0,): (1, 2, 3)})


def test_a_map_on_a_cell_is_what_its_limits_leave() -> None:
    u, v, w = pc.parameters()
    found = polynomials((u * v + w / 2, v - 3 * u * w, u + v * v * w))
    assert found is not None
    assert found.scale == 2
    assert found.on((1, 2, 0)) == {(1,): (2, 0, 2), (0,): (0, 2, 0)}
    assert found.on((0, 0, 0)) == {}
    assert found.on((1, 1, 2))[0, 0] == (1, 0, 0)


@pytest.mark.parametrize("size", [1, 10**9, Fraction(1, 10**9)])
def test_coefficients_clear_det_j_only_where_it_is_clear_of_zero(size: Number) -> None:
    u, v, w = pc.parameters()
    cube = polynomials((u * size, v * size, w * size))
    cubic = polynomials(((u - Fraction(1, 2)) ** 3 * size, v * size, w * size))
    assert cube is not None
    assert cubic is not None
    assert _is_clear(cube)
    assert not _is_clear(cubic)
    # what is near zero is left to a watch
    mapping = Mapping3(((u - Fraction(1, 2)) ** 3 * size, v * size, w * size), (u, v, w))
    assert "vanishes inside the box, near u = 0.5" in _inner_zero(mapping, 1)


def test_det_j_beyond_all_doubles_is_cleared() -> None:
    u, v, w = pc.parameters()
    large = polynomials((u**2 * 10**58 + u / 10**58, v * 10**58, w * 10**58 + w / 10**58))
    assert large is not None
    assert max(large.determinant.values()) > 10**309
    assert _is_clear(large)


def test_trees_are_multiplied_out_as_normal_forms_are() -> None:
    u, v, w = pc.parameters()
    third = Fraction(1, 3)
    trees = [
        (u * third + v * w / 7) ** 3 * (1 - u),
        (u + v) * (u - v) + v**2 - u * u * 0.1,
        3 * (u * (v - w) - (u * v - u * w)),
        (u * 2 - third) ** 2 - (v / 6) ** 2 + w * 5 / 4,
        u / (1 + v) * 2 - 2 * (u / (1 + v)) + w,
    ]
    for tree in trees:
        found, form = rational_polynomial(tree), normal_form(tree)
        assert found is not None
        assert form is not None
        terms, below = found
        # the order of terms tells which of two equal steps is the first of a plane
        assert [Fraction(c, below) for c in terms.values()] == list(form.values())
        assert lcm(*(c.denominator for c in form.values())) == below
    assert rational_polynomial(u / (1 + v)) is None
    assert rational_polynomial(pc.sqrt(u)) is None
    assert rational_polynomial((u + v + w + 1) ** 40) is None


def test_constant_sums_are_told_by_algebra() -> None:
    u, v, w = pc.parameters()
    half = (u + v) * (u - v) - u * u + v * v + Fraction(1, 2)
    near = (u * Fraction(1, 10**15) + 1) - 1
    steady = constant_sums((half * w, near + v))
    assert steady is not None
    assert half in steady
    assert not any(node.op != "add" for node in steady)
    assert near not in steady
    assert constant_sums((pc.sin(u),)) is None
    assert constant_sums((1 / (1 + u),)) is None


def test_short_polynomials_that_are_numbers_are_told_by_algebra() -> None:
    u, v, p = (*pc.parameters()[:2], symbol("p"))
    assert constant_of((1 - u) * (1 - v) + u * (1 - v) + v) == 1
    assert constant_of((u + v) ** 2 - u * u - 2 * u * v - v * v) == 0
    assert constant_of(u - v) is None
    assert constant_of(u * Fraction(1, 10**30)) is None
    assert constant_of(p - p * 1 + 3 * u) is None
    assert constant_of(pc.sin(u)) is None
    assert constant_of((u + 1) ** 9 - (u + 1) ** 9 + 1) in (None, 1)
