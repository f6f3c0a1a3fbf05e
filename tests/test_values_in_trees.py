"""A template is read once: values of parameters are put into its trees."""

from __future__ import annotations

import pickle
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pc2cad as pc
from pc2cad.equation.language import read_expression
from pc2cad.equation.points import Combination
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.substitution import Substitution
from pc2cad.expression.tree import Expr, number, substitute, symbol
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import template_paths
from pc2cad.templates.template import Template

#: what guides by numbers ask for as they are read
ASKING = ("duct", "propeller_blade", "spring", "trefoil")
BOX = """title = "box"
[parameters]
a = 1
b = 2
[points]
A = [1, 0, 0]
[let]
c = "1/(a - b)"
[solid]
M = "A + vector(a*u, b*v, c*w)"
"""


def _values(template: Template, share: Fraction) -> dict[str, Expr]:
    """Return values a share away from the defaults, within the ranges."""
    found = {}
    for parameter in template.parameters:
        low, high = parameter.limits
        value = min(max(evaluate(parameter.default, {}) * float(1 + share), low), high)
        found[parameter.name] = number(value)
    return found


@pytest.mark.parametrize("share", [Fraction(0), Fraction(1, 7), Fraction(-1, 50)])
def test_values_put_into_trees_make_the_trees_that_are_read_with_them(share) -> None:
    shipped = [read_template(path) for path in template_paths().values()]
    once = [t for t in shipped if isinstance(t, Template) and t.parameters and not t.consumed]
    assert len(once) > 40
    for template in once:
        values = _values(template, share)
        _assert_same(template._put(values), template._again(values, {}))


def _assert_same(put: Template, read: Template) -> None:
    """Hold all trees of two templates against each other."""
    assert put.M.coordinates == read.M.coordinates, put.name
    assert put.M.weight is read.M.weight, put.name
    assert put.domain == read.domain, put.name
    for name in ("points", "layers", "lets", "fields"):
        for one, other in zip(getattr(put, name), getattr(read, name), strict=True):
            if isinstance(one.value, Combination):
                assert one.value.coordinates == other.value.coordinates, (put.name, name)
            else:
                assert one.value is other.value, (put.name, name)


@pytest.mark.parametrize("name", ASKING)
def test_what_asks_for_values_is_read_again_for_those_alone(name) -> None:
    template, readings = read_template(name), []

    def again(values, points, free=""):
        readings.append(set(values))
        return template._again(values, points, free)

    counted = replace(template, _again=again)
    default = {p.name: p.default for p in template.parameters}
    others = {
        n: x for n, x in _values(template, Fraction(1, 50)).items() if n not in template.consumed
    }
    assert others
    put = counted._with(default | others, {})
    assert readings == []
    _assert_same(put, template._again(default | others, {}))
    asked = min(template.consumed)
    changed = {asked: number(evaluate(default[asked], {}) + 1)}
    for _ in range(3):
        put = counted._with(default | others | changed, {})
    assert readings == [{asked}]
    _assert_same(put, template._again(default | others | changed, {}))


def test_a_template_is_not_read_again_for_values() -> None:
    template = replace(parse_template(BOX, "box"), _again=None)
    assert template.bind({"a": 5}).parameters == {"a": 5, "b": 2}
    assert template.family(["a"], {"b": 3}).coordinates[1] is 3 * symbol("v")


@pytest.mark.parametrize("values", [{"a": 2}, {"a": 1, "b": 1}])
def test_values_that_do_not_fit_are_told_with_their_place(values) -> None:
    with pytest.raises(InputError, match=r"\[let\] c: .*division by zero"):
        parse_template(BOX, "box").bind(values)


def test_what_parameters_alone_make_is_a_finite_real_number() -> None:
    template = parse_template(BOX.replace("1/(a - b)", "exp(-exp(a))*sqrt(b)"), "box")
    template.bind({"a": 3})
    with pytest.raises(InputError, match=r"\[let\] c: .* is outside the range"):
        template.bind({"a": 300})
    with pytest.raises(InputError, match=r"\[let\] c: .* is not a real number"):
        template.bind({"b": -1})


def test_points_that_were_replaced_stay_so_whatever_is_set() -> None:
    template = parse_template(BOX, "box")
    moved = template.move({"A": [4, 5, 6]})
    for values in ({}, {"a": 7}):
        x, y, z = (evaluate(t, {"u": 0, "v": 0, "w": 0}) for t in moved.bind(values).coordinates)
        assert (x, y, z) == (4, 5, 6)
    both = moved.move({"A": [0, 0, 9]}).bind({"b": 3})
    assert both.coordinates == template.bind({"A": [0, 0, 9], "b": 3}).coordinates


GUIDED = """title = "rod"
[parameters]
p = 1
[points]
A = [1, 0, 0]
B = [0, 0, 1]
[guide]
N = "A*(1 - u) + B*u"
[let]
c = "1/(p + 3)"
[solid]
M = "N + (R - N)*w*cos(2*pi*v) + (Q - N)*w*sin(2*pi*v)"
"""


def test_points_that_do_not_fit_the_defaults_may_fit_the_values() -> None:
    moved = {"A": "[0, 0, 0]", "B": "[0, 0, p - 1]"}
    found = parse_template(GUIDED, "rod").bind({"p": 3, **moved})
    assert found.guide == (number(0), number(0), symbol("u") * 2)
    # and what is said of values that do not is said of them
    with pytest.raises(InputError, match=r"\[let\] c: .*division by zero"):
        parse_template(GUIDED, "rod").bind({"p": -3, **moved})


@pytest.mark.parametrize("text", [BOX, GUIDED])
def test_points_given_as_numbers_may_depend_on_parameters(text) -> None:
    template = parse_template(text, "part")
    name = template.parameters[0].name
    as_text = template.bind({name: 4, "A": f"[5, {name}, 0]"})
    for point in ((5, symbol(name), 0), pc.point(5, symbol(name), 0)):
        assert template.bind({name: 4, "A": point}).coordinates == as_text.coordinates
        assert template.bind({name: 4}).move(A=point).coordinates == as_text.coordinates


@pytest.mark.parametrize("point", [5, None, np.array(3.0), [1, 2], lambda u: u])
def test_what_is_no_point_replaces_none(point) -> None:
    with pytest.raises(InputError, match=r"the point A: a point has 3 coordinates, .* given|are 2"):
        parse_template(BOX, "box").bind({"A": point})


def test_numbers_of_numpy_are_values() -> None:
    template = parse_template(BOX, "box")
    for a in (np.int64(4), np.float64(4)):
        assert template.bind({"a": a}).coordinates == template.bind({"a": 4}).coordinates
    with pytest.raises(InputError, match="the value of parameter a must be a number"):
        template.bind({"a": np.bool_(True)})


def test_an_equation_goes_to_another_process_with_the_values_that_it_has() -> None:
    # the derivative is 0, and its text cannot be read with a = 0
    template = parse_template(BOX.replace("1/(a - b)", "b + diff(1/a, u)"), "box")
    found = template.bind({"a": 0})
    there = pickle.loads(pickle.dumps(found))
    assert there.coordinates == found.coordinates
    assert there.written() == found.written()
    assert there.move(A=[7, 8, 9]).coordinates == found.move(A=[7, 8, 9]).coordinates


TREES = st.recursive(
    st.sampled_from([symbol(name) for name in "uvpq"]) | st.integers(-3, 3).map(number),
    lambda inner: st.tuples(inner, inner).flatmap(
        lambda pair: st.sampled_from([pair[0] + pair[1], pair[0] - pair[1], pair[0] * pair[1]])
    ),
    max_leaves=25,
)


@given(st.lists(TREES, min_size=1, max_size=4), st.fractions(-3, 3, max_denominator=9))
def test_a_planned_substitution_is_a_substitution(trees, p) -> None:
    roots = tuple(trees)
    planned = Substitution(roots, frozenset("pq"))
    for values in ({"p": number(p), "q": symbol("u") + 1}, {"q": number(p)}, {}):
        assert planned(values) == substitute(roots, values)


def test_a_function_of_the_template_is_asked_each_time() -> None:
    found = []
    for k in (1, 2):
        curves = {"f": lambda t, k=k: t * k}
        found.append(read_expression("f(p) + 1", {"p": number(5)}, curves))
    assert found == [number(6), number(11)]


def test_a_function_that_bears_a_name_of_the_language_is_asked() -> None:
    plain = read_expression("rotx([0, 1, 0], 0)", {})
    own = read_expression("rotx(2)", {}, {"rotx": lambda t: t * 10})
    assert isinstance(plain, Combination)
    assert own == number(20)


def test_figures_of_variants_are_those_of_a_template_that_is_written_so() -> None:
    text = (
        'title = "box"\n[parameters]\na = {{ default = {a} }}\nn = {{ default = 6 }}\n'
        '[solid]\nx = "a*u"\ny = "v"\nz = "w"\n'
        '[expect]\nvolume = "a"\narea = "2 + 4*sqrt(a^2)"\ncentroid = ["a/2", 0.5, "1/2"]\n'
        'faces = "{faces}"\n'
    )
    template = parse_template(text.format(a=1, faces="6"), "box")
    other = parse_template(text.format(a='"7/3"', faces="6"), "box").bind({})
    found = template.bind({"a": "7/3"}).expectations
    assert found.centroid == pytest.approx(other.expectations.centroid, rel=1e-15)
    for name in ("volume", "area", "faces"):
        assert getattr(found, name) == pytest.approx(getattr(other.expectations, name), rel=1e-15)
    # counts that depend on parameters are exact, and figures without a value are refused
    counted = parse_template(text.format(a=1, faces="n"), "box")
    assert counted.bind({"n": 5}).expectations.faces == 5
    with pytest.raises(InputError, match="whole number"):
        counted.bind({"n": "11/2"})
    rooted = parse_template(text.format(a=1, faces="6").replace("a^2", "a - 1"), "box")
    with pytest.raises(InputError, match=r"not a finite real number for a = 0\.5"):
        rooted.bind({"a": "1/2"})


def test_figures_are_those_at_the_exact_values() -> None:
    text = """[expect]
faces = "floor(100*a)"
euler = "if(b > -2, 2, 1/(b + 1))"
volume = "if(100*a >= 29, 2, 3)"
centroid = ["mod(b, a)", 0, 0]
"""
    template = parse_template(BOX + text, "box")
    found = template.bind({"a": "0.29", "b": "2.9"}).expectations
    assert (found.faces, found.euler, found.volume) == (29, 2, 2)
    assert found.centroid == (0, 0, 0)
    # what is not chosen need not have a value
    assert template.bind({"a": 1, "b": -1}).expectations.euler == 2
