"""SymPy expressions in and out; SymPy also serves as an independent judge of exact volumes."""

from __future__ import annotations

import pytest
import sympy

import pc2cad as pc
from pc2cad.expression.sympy_bridge import NotTranslatableError
from pc2cad.templates.file import parse_template

u, v, w = sympy.symbols("u v w", real=True)


def exact_volume(x: sympy.Expr, y: sympy.Expr, z: sympy.Expr) -> sympy.Expr:
    determinant = sympy.Matrix([x, y, z]).jacobian([u, v, w]).det()
    return sympy.integrate(sympy.expand(determinant), (u, 0, 1), (v, 0, 1), (w, 0, 1))


def test_a_solid_from_sympy_coordinates_has_the_volume_that_sympy_integrates() -> None:
    coordinates = (2 * u, 2 * v + u * w / 3, 2 * w + u * v * w)
    part = pc.compile_part(coordinates)
    assert part.report.solid.volume == pytest.approx(float(exact_volume(*coordinates)), rel=1e-13)


def test_trees_survive_the_way_there_and_back() -> None:
    a, b, c = pc.parameters()
    tree = pc.sqrt(a**2 + 1) * pc.cos(2 * pc.pi * b) - pc.exp(c) / 3 + pc.atan2(a, b + 1)
    again = pc.from_sympy(pc.to_sympy(tree))
    assert sympy.simplify(pc.to_sympy(again) - pc.to_sympy(tree)) == 0


def test_a_contour_becomes_a_piecewise_expression() -> None:
    _, t, _ = pc.parameters()
    x, _ = pc.contour([(2, 0), (0, 2), (-2, 0), (0, -2)], t)
    expression = pc.to_sympy(x)
    assert expression.subs(sympy.Symbol("v", real=True), sympy.Rational(1, 2)) == -2
    assert expression.subs(sympy.Symbol("v", real=True), sympy.Rational(1, 8)) == sympy.Rational(
        5, 4
    )


def test_what_has_no_counterpart_is_refused_by_name() -> None:
    with pytest.raises(NotTranslatableError, match="besselj"):
        pc.compile_part((u, v, sympy.besselj(0, w)))


def test_sums_of_template_points_are_identities() -> None:
    template = parse_template(
        """
title = "frustum"
[parameters]
p = 0.5
[solid]
x = "u*v*(1 - w + p*w)"
y = "(1-v)*(1 - w + p*w)"
z = "w"
""",
        "frustum",
    )
    difference = pc.to_sympy(template.M.x) - sympy.Symbol("u", real=True) * sympy.Symbol(
        "v", real=True
    ) * (1 - w + sympy.Symbol("p", real=True) * w)
    assert sympy.expand(difference) == 0
