"""The coordinate-wise system: every row says what the point equation says, axis by axis."""

from __future__ import annotations

import re

import pytest

from pc2cad.channels.layers import depth
from pc2cad.cli.main import main
from pc2cad.cli.typeset import definition_latex
from pc2cad.equation.language import read_expression
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, as_expr, symbol
from pc2cad.templates.coordinatewise import coordinate_system
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import find_template, template_paths
from pc2cad.templates.template import Template

DERIVATIVE = re.compile(r"diff\((\w+), ([uvw])(?:, (\d))?\)")
PLACES = [(0.3, 0.7, 0.2), (0.85, 0.15, 0.6)]

DIFFICULT = """
title = "Derivatives through names"
[parameters]
k = 2
x_N = 3
[points]
A = [4, 0, 1]
B = [1, "k", 1]
C = [-2, -1, 0]
D = [1, 1, 6]
[let]
a = "u^2"
b = "1 - a"
N = "A*a*v + B*b*v + C*(1-v)"
T = "diff(N, u)"
f = "diff(length(T)*u*k, u) + diff(diff(a*v, u), v) + diff(sin(a), u, 2)"
g = "-f/(3*x_N)"
S = "cross(T, D-A)*(1/g) - T/2"
[solid]
M = "N*(1-w) + D*w + (S + diff(N*(1-w) + D*w, u, 2))*(-f*w)/10 + diff(diff(N, v), u)*w*f"
"""


def parsed(text: str) -> Template:
    return parse_template(text, "t")


def coordinates(template: Template) -> dict[str, Expr]:
    """Return the trees that the names of rows stand for, from the template itself."""
    trees: dict[str, Expr] = {}
    for definition in (*template.points, *template.carried, *template.lets):
        if isinstance(definition.value, Expr):
            trees[definition.name] = definition.value
        else:
            for axis, tree in zip("xyz", definition.value.coordinates, strict=True):
                trees[f"{axis}_{definition.name}"] = tree
    return trees


def evaluate_row(text: str, template: Template, trees: dict[str, Expr], values) -> float:
    """Evaluate the text of a row, every name on its right side taken from the template."""
    known = dict(trees)
    while match := DERIVATIVE.search(text):
        operand, parameter, order = match.groups()
        tree = known[operand]
        for _ in range(int(order or 1)):
            (tree,) = derivatives((tree,), parameter)
        name = f"D{len(known)}"
        known[name] = tree
        text = text[: match.start()] + name + text[match.end() :]
    names = {name: symbol(name) for name in (*known, *values)}
    numbers = {name: evaluate(tree, values) for name, tree in known.items()}
    functions = dict(template.curves)
    if template.layers:
        functions["depth"] = depth([layer.value for layer in template.layers])
    return evaluate(read_expression(text, names, functions), values | numbers)


def check_rows(template: Template) -> None:
    trees = coordinates(template)
    solid = dict(zip(("x_M", "y_M", "z_M"), template.M.coordinates, strict=True))
    for place in PLACES:
        values = {p.name: evaluate(p.default, {}) for p in template.parameters}
        for name, share, ends in zip("uvw", place, template.domain, strict=True):
            low, high = (evaluate(as_expr(end), values) for end in ends)
            values[name] = low + (high - low) * share
        for expansion in coordinate_system(template):
            for row in expansion.rows:
                name = row.name if row.name in (trees | solid) else row.name.rstrip("_")
                true = evaluate((trees | solid)[name], values)
                found = evaluate_row(row.text, template, trees, values)
                assert found == pytest.approx(true, rel=1e-11, abs=1e-12), row


@pytest.mark.parametrize("name", sorted(template_paths()))
def test_every_row_of_a_shipped_template_has_the_value_of_the_equation(name):
    check_rows(read_template(find_template(name)))


def test_derivatives_reach_through_names():
    # x_N is a parameter here: the coordinates of N must not be taken for it
    template = parsed(DIFFICULT.replace("x_N = 3", "kk = 3").replace("3*x_N", "3*kk"))
    check_rows(template)


def test_coordinates_are_not_taken_for_parameters_of_the_same_name():
    rows = {e.name: e.rows for e in coordinate_system(parsed(DIFFICULT))}
    assert [row.name for row in rows["N"]] == ["x_N_", "y_N_", "z_N_"]
    assert rows["g"][0].text.endswith("/(3*x_N)")
    assert rows["T"][0].text == "diff(x_N_, u)"


def test_weights_that_add_up_only_through_names():
    rows = {e.name: e.rows for e in coordinate_system(parsed(DIFFICULT))}
    assert rows["N"][1].text == "y_A*a*v + y_B*b*v + y_C*(1 - v)"


def test_rows_follow_the_order_of_the_equation():
    rows = coordinate_system(read_template(find_template("pyramid")))[0].rows
    assert [row.name for row in rows] == ["x_M", "y_M", "z_M"]
    for axis, row in zip("xyz", rows, strict=True):
        assert row.text == (
            "x_A*u*v*(1 - w) + x_B*(1 - v)*(1 - w) + x_C*(1 - u)*v*(1 - w) + x_D*w"
        ).replace("x_", f"{axis}_")


def test_curves_stay_functions_also_under_derivatives():
    rows = coordinate_system(
        parsed(
            'title = "c"\n[curves.c]\nkind = "sine"\nradius = 3\namplitude = 1\nwaves = 5\n'
            '[let]\nf = "diff(c_x(2*v)*u, v)"\n[solid]\nx = "c_x(v)*u"\ny = "c_y(v)*u"\nz = "w*f"'
        )
    )
    assert rows[0].rows[0].text == "2*c_x'(2*v)*u"
    assert [row.text for row in rows[1].rows] == ["c_x(v)*u", "c_y(v)*u", "w*f"]
    assert r"c_{x}'\left(2\,v\right)" in rows[0].rows[0].latex


def test_long_sums_and_products_do_not_exhaust_the_stack():
    many = "C + (A-C)" + "*u" * 300 + " + B*v - B*v" * 150
    template = parsed(
        f'title = "s"\n[points]\nA = [1, 0, 0]\nB = [0, 1, 0]\nC = [0, 0, 1]\n[solid]\nM = "{many}"'
    )
    (expansion,) = coordinate_system(template)
    assert expansion.rows[0].text.startswith("x_C + (x_A - x_C)*u*u")
    assert definition_latex(many).startswith(r"C + \left(A - C\right)\,u\,u")


def test_show_prints_equation_and_system(capsys):
    assert main(["show", "pyramid_cut", "-s", "p=1/4"]) == 0
    out = capsys.readouterr().out
    for line in (
        "  p = 0.25  (0 to 1, default 0.5)  |DP| / |DA|",
        "  q = 0.25  (0 to 1, default 0.25)  |DQ| / |DB|",
        "  A = [4, 0, 0]",
        "  0 <= w <= 1",
        "  N = (A-C)*u*v + (B-C)*(1-v) + C",
        "  z_P = (z_A - z_D)*p + z_D",
        "  y_M = y_N*(1 - w) + y_K*w",
    ):
        assert f"{line}\n" in out


def test_show_says_what_curves_are(capsys):
    assert main(["show", "channel_contour"]) == 0
    out = capsys.readouterr().out
    assert "section_x(t), section_y(t): closed contour" in out
    assert "through 6 points, (2, 0), (1, 1.5)" in out
    assert "x_K = x_N + (x_R - x_N)*section_x(v) + (x_Q - x_N)*section_y(v)\n" in out
    assert main(["show", "channel_sine"]) == 0
    out = capsys.readouterr().out
    assert "sine wave round a circle" in out
    assert re.search(r"_x\(t\) = .*cos\(", out)


@pytest.mark.parametrize("name", sorted(template_paths()))
def test_latex_is_well_formed(name, capsys):
    assert main(["show", name, "--latex"]) == 0
    out = capsys.readouterr().out
    assert "?" not in re.sub("^%.*$", "", out, flags=re.MULTILINE)
    assert out.count(r"\begin{aligned}") == out.count(r"\end{aligned}") > 0
    assert out.count(r"\left") == out.count(r"\right")
    depth = 0
    for character in out.replace(r"\{", "").replace(r"\}", ""):
        depth += (character == "{") - (character == "}")
        assert depth >= 0
    assert depth == 0


def test_latex_of_operators(capsys, tmp_path):
    (tmp_path / "t.toml").write_text(DIFFICULT)
    assert main(["show", str(tmp_path / "t.toml"), "--latex"]) == 0
    out = capsys.readouterr().out
    assert r"T &= \frac{\partial}{\partial u} N" in out
    assert r"S &= \left(T \times \left(D - A\right)\right)" in out
    assert r"\frac{\partial^{2} x_{N}}{\partial u\,\partial v}" in out


def test_show_refuses_as_the_other_verbs_do(capsys):
    assert main(["show", "pyramid_cut", "-s", "p=3"]) == 2
    assert main(["show", "pyramid_cu"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 2


def test_fields_are_shown(tmp_path, capsys) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(
        'title = "Bar"\n[solid]\nx = "2*u"\ny = "v"\nz = "w"\n'
        '[fields]\nwarm = "20 + x"\nflow = "vector(0, u, 1)"\n'
    )
    assert main(["show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "\nFields (of u, v, w and the place x, y, z)\n  warm = 20 + x\n" in shown
    assert "  flow = vector(0, u, 1)\n" in shown
