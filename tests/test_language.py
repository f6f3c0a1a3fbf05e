"""The language of pieces and lists, held against plain NumPy: values, derivatives, enclosures."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import pc2cad as pc
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.cli.typeset import definition_latex
from pc2cad.equation.language import Listed, read_expression
from pc2cad.errors import InputError
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import interval
from pc2cad.expression.printing import as_latex, as_text
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, number, symbol

u, v, w = pc.parameters()
few = settings(max_examples=60, deadline=None, derandomize=True)
DATA = {
    "k": Listed(((number(2), number(3), number(5)),), plain=True),
    "c": Listed(((number(1), number(2)), (number(7), symbol("u"))), plain=False),
}
NAMES = {name: symbol(name) for name in "uvw"} | DATA
P = "[2*u + 1, v - u, u*v]"


def turned(p, o, axis, angle):
    """Rodrigues' formula."""
    k = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    d = np.asarray(p) - o
    turned = d * math.cos(angle) + np.cross(k, d) * math.sin(angle)
    return o + turned + k * (k @ d) * (1 - math.cos(angle))


def point(x, y):
    return np.array([2 * x + 1, y - x, x * y])


#: text of the language -> the same in plain NumPy, of u and v
CONSTRUCTS = {
    "if(u < v, u^2, 3*v)": lambda x, y: np.where(x < y, x**2, 3 * y),
    "if(u <= v, u^2, 3*v)": lambda x, y: np.where(x <= y, x**2, 3 * y),
    "if(2*u > v, sin(u), v)": lambda x, y: np.where(2 * x > y, np.sin(x), y),
    "if(u >= 0.3, u, v*v)": lambda x, y: np.where(x >= 0.3, x, y * y),
    "if(u < 0.5 and v < 0.5, 1 + u, 2*v)":
        lambda x, y: np.where((x < 0.5) & (y < 0.5), 1 + x, 2 * y),
    "if(u < 0.3 or not v < 0.6 and u < 0.8, u*v, v - u)":
        lambda x, y: np.where((x < 0.3) | ((y >= 0.6) & (x < 0.8)), x * y, y - x),
    "if(not (u < 0.3 or v < 0.4), u*v, v - u)":
        lambda x, y: np.where((x >= 0.3) & (y >= 0.4), x * y, y - x),
    "min(u, v, 0.4)": lambda x, y: np.minimum(np.minimum(x, y), 0.4),
    "max(u*u, v - 0.2)": lambda x, y: np.maximum(x * x, y - 0.2),
    "clamp(3*u - 1, v, v + 0.5)": lambda x, y: np.clip(3 * x - 1, y, y + 0.5),
    "sign(u - v)*u": lambda x, y: np.sign(x - y) * x,
    "floor(5*u + v)*v": lambda x, y: np.floor(5 * x + y) * y,
    "mod(3*u - v, 0.4)": lambda x, y: np.mod(3 * x - y, 0.4),
    "hypot(u - 2, v)": lambda x, y: np.hypot(x - 2, y),
    "cos(360*deg*v)*u": lambda x, y: np.cos(np.deg2rad(360 * y)) * x,
    f"({P}).x + 2*{P}.y*{P}.z": lambda x, y: 2 * x + 1 + 2 * (y - x) * x * y,
    f"rotx({P}, u).y": lambda x, y: turned(point(x, y), np.zeros(3), (1, 0, 0), x)[1],
    f"roty({P}, v).z": lambda x, y: turned(point(x, y), np.zeros(3), (0, 1, 0), y)[2],
    f"rotz({P}, 3*u*v).x": lambda x, y: turned(point(x, y), np.zeros(3), (0, 0, 1), 3 * x * y)[0],
    f"rotate({P}, [1, 2, 3], vector(1, -1, 2), 2*v).x":
        lambda x, y: turned(point(x, y), np.array([1, 2, 3]), (1, -1, 2), 2 * y)[0],
    "sum(i, 0, 2, k[i]*cos(i*u))": lambda x, y: 2 + 3 * np.cos(x) + 5 * np.cos(2 * x),
    "sum(i, 0, 1, sum(j, 0, 1, c[i, j]*v^(2*i + j)))":
        lambda x, y: 1 + 2 * y + 7 * y**2 + x * y**3,
    "sum(n, -1, 1, abs(u - n/4))": lambda x, y: abs(x + 0.25) + abs(x) + abs(x - 0.25),
}  # fmt: skip
inside = st.floats(0.02, 0.98)


def read(text: str) -> Expr:
    found = read_expression(text, NAMES)
    assert isinstance(found, Expr)
    return found


@few
@given(text=st.sampled_from(list(CONSTRUCTS)), x=inside, y=inside)
def test_values_and_derivatives_are_those_of_numpy(text: str, x: float, y: float) -> None:
    tree, truth = read(text), CONSTRUCTS[text]
    at = {"u": x, "v": y}
    assert evaluate(tree, at) == pytest.approx(truth(x, y), rel=1e-12, abs=1e-12)
    (value,) = Program((tree,))({name: np.full(3, place) for name, place in at.items()})
    assert np.asarray(value) == pytest.approx(float(truth(x, y)), rel=1e-12, abs=1e-12)
    step = 1e-6
    for name, (a, b) in {"u": (step, 0), "v": (0, step)}.items():
        rise = [(truth(x + k * a, y + k * b) - truth(x, y)) / (k * step) for k in (-1, 1)]
        assume(abs(rise[0] - rise[1]) < 1e-3)  # no kink beside the place
        (slope,) = derivatives((tree,), name)
        assert evaluate(slope, at) == pytest.approx(float(np.mean(rise)), abs=1e-7)


@few
@given(text=st.sampled_from(list(CONSTRUCTS)))
def test_what_is_printed_reads_as_the_same_tree(text: str) -> None:
    tree = read(text)
    assert read(as_text(tree)) is tree
    assert "?" not in as_latex(tree)
    assert definition_latex(text)


@few
@given(text=st.sampled_from(list(CONSTRUCTS)), x=inside, y=inside)
def test_sympy_gives_the_same_value(text: str, x: float, y: float) -> None:
    tree = read(text)
    found = pc.to_sympy(tree).subs(
        {sympy.Symbol("u", real=True): x, sympy.Symbol("v", real=True): y}
    )
    assert float(found) == pytest.approx(evaluate(tree, {"u": x, "v": y}), rel=1e-9, abs=1e-9)
    again = pc.from_sympy(pc.to_sympy(tree))
    assert evaluate(again, {"u": x, "v": y}) == pytest.approx(float(found), rel=1e-9, abs=1e-9)


def boxes_hold(text: str, places: int) -> None:
    """All three enclosures, over boxes and with the derivatives, hold values at places in them."""
    tree = read(text)
    trees = (tree, *derivatives((tree,), "u"), *derivatives((tree,), "v"))
    random = np.random.default_rng(len(text))
    low = random.uniform(0, 0.9, (places, 2))
    high = low + random.choice((1e-6, 0.02, 0.2, 0.6), (places, 1))
    at = low + (high - low) * random.uniform(0, 1, (places, 2))
    values = Program(trees)({"u": at[:, 0], "v": at[:, 1]})
    box = {name: interval(low[:, k], high[:, k]) for k, name in enumerate("uv")}
    plain = IntervalProgram(trees)(box)
    centred = CentredProgram(trees)(box)
    for value, found, other in zip(values, plain, centred, strict=True):
        for hull in (found, other.value):
            room = 1e-9 * (1 + np.abs(value))
            assert (hull.lower - room <= value).all(), text
            assert (value <= hull.upper + room).all(), text


@pytest.mark.parametrize("text", CONSTRUCTS)
def test_enclosures_hold_samples(text: str) -> None:
    boxes_hold(text, 400)


@pytest.mark.slow
@pytest.mark.parametrize("text", CONSTRUCTS)
def test_enclosures_hold_a_hundred_thousand_samples(text: str) -> None:
    boxes_hold(text, 100_000)


@pytest.mark.parametrize("text", CONSTRUCTS)
def test_taylor_models_hold_samples(text: str) -> None:
    tree = read(text)
    random = np.random.default_rng(7)
    centre = random.uniform(0.1, 0.9, (2, 40))
    half = np.full(40, 0.01)
    places = [Place(c, half, 2 * half) for c in centre]
    (model,) = enclose((tree,), ("u", "v"), places, 4)
    s, t = np.meshgrid((centre[0] + 0.009), (centre[1] - 0.007), indexing="ij")
    (value,) = Program((tree,))({"u": s, "v": t})
    (i, j), local = model.terms.shape[:2], (0.009 / 0.02, -0.007 / 0.02)
    series = sum(
        model.terms[a, b] * local[0] ** a * local[1] ** b for a in range(i) for b in range(j)
    )
    known = np.broadcast_to(np.isfinite(model.radius), s.shape)
    assert known.mean() > 0.5
    gap = np.abs(series - value) - model.radius - 1e-12
    assert (np.broadcast_to(gap, s.shape)[known] <= 0).all()


REFUSED = {
    "if(u, 1, 2)": "column 4: a condition is made of < <= > >=, and, or, not",
    "if(u < 1, 2)": r"write if\(condition, a, b\)",
    "u < v": r"a condition is no value; write if\(condition, a, b\)",
    "if(0 < u < 1, u, v)": "comparisons are joined by 'and': write a < b and b < c",
    "if(u < 1, [u, 0, 0], u)": r"if\(…\) chooses between values of one kind, not a point and a sc",
    "if(u < 1, [u, 0, 0], vector(1, 0, 0))": "not a point and a free vector",
    "if([u, 0, 0] < 1, 1, 2)": "a side of < must be a scalar, and a point was given",
    "u.x": "a point or a vector has the coordinate .x, a scalar has none",
    "[u, v, w].t": r"a point has the coordinates .x, .y and .z, not .t",
    "min(u)": "min takes two operands or more",
    "clamp(u, 1)": "clamp takes 3 operands, here are 2",
    "mod(u, -2)": r"mod\(x, -2\) needs a positive number behind the comma",
    "rotate(u, [0, 0, 0], vector(0, 0, 1), 2)": "rotate turns a point or a free vector",
    "rotx([0, 0, 0], [1, 0, 0])": "the angle of rotx is a scalar, and a point was given",
    "rotate([u, 0, 0], [0, 0, 0], [0, 0, 1], 2)": "third operand of rotate must be a free vector",
    "sum(i, 0, 2)": r"write sum\(i, from, to, expression\)",
    "sum(3, 0, 2, u)": r"write sum\(i, from, to, expression\)",
    "sum(u, 0, 2, u)": r"u has a meaning already; write sum\(i, from, to, expression\)",
    "sum(i, 0, u, u)": "a limit of sum is a whole number, and u was given",
    "sum(i, 0, 1e7, u)": "sums have 10000001 terms, and at most 10000 are added up",
    "sum(i, 1, 200, sum(j, 1, 200, i*j))": "sums have .* terms, and at most 10000",
    "k[3]": "k has entries from 0 to 2, and 3 was asked for",
    "k[-1]": "k has entries from 0 to 2, and -1 was asked for",
    "k[0.5]": "an index of k is a whole number, and 0.5 was given",
    "k[u]": "an index of k is a whole number, and u was given",
    "k[0, 1]": r"write k\[i\]",
    "c[0]": r"write c\[i, j\]",
    "k": r"k is a list of \[data\]; write k\[i\]",
    "kk[0]": r"unknown list 'kk'; entries are taken from lists of \[data\]; did you mean k",
    "u[0]": r"u is no list; entries are taken from lists of \[data\]",
    "u & v": "the character '&' has no meaning here; conditions are joined by 'and'",
    "u % v": r"a remainder is mod\(x, m\)",
    "not(u)": "a condition is no value",
    "if(" + "not " * 80 + "u < v, u, v)": "nested deeper than 60",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refusals_say_what_to_write(text: str) -> None:
    with pytest.raises(InputError, match=REFUSED[text]) as error:
        read_expression(text, NAMES)
    assert "\n" not in str(error.value)


def test_long_conditions_and_sums_are_read_without_recursion() -> None:
    assert read_expression("if(" + " and ".join(["u < v"] * 390) + ", u, v)", NAMES) is not None
    found = read("sum(i, 1, 5000, u*i)")
    assert evaluate(found, {"u": 1.0}) == 5000 * 5001 / 2


# -- Python ----------------------------------------------------------------------------------------

NUMPY = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "arcsin": np.arcsin, "arccos": np.arccos,
    "arctan": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "exp": np.exp,
    "arcsinh": np.arcsinh, "arctanh": np.arctanh, "log": np.log, "sqrt": np.sqrt, "abs": np.abs,
    "fabs": np.fabs, "floor": np.floor, "ceil": np.ceil, "sign": np.sign, "square": np.square,
    "deg2rad": np.deg2rad, "rad2deg": np.rad2deg, "log2": np.log2, "log10": np.log10,
    "log1p": np.log1p, "expm1": np.expm1, "exp2": np.exp2, "reciprocal": np.reciprocal,
    "negative": np.negative, "hypot": lambda x: np.hypot(x, 2.0), "mod": lambda x: np.mod(x, 0.3),
    "arctan2": lambda x: np.arctan2(x, 0.7), "minimum": lambda x: np.minimum(x, 0.4),
    "maximum": lambda x: np.maximum(0.4, x), "clip": lambda x: np.clip(x, 0.3, 0.6),
    "where": lambda x: np.where(x < 0.5, x, 1 - x), "power": lambda x: np.power(x, 1.5),
    "where with or": lambda x: np.where((x < 0.2) | (x >= 0.6), x, 2.0),
    "where with not": lambda x: np.where(np.logical_not((x > 0.2) & (x <= 0.6)), x, 2.0),
    "logical": lambda x: np.where(np.logical_and(x > 0.2, x < 0.6), x, -x),
    "NumPy's numbers": lambda x: np.float64(2) * x + x / np.int64(3) - np.float32(0.5) * x,
    "floor division": lambda x: (5 * x) // 2 + (5 * x) % 2,
}  # fmt: skip


@few
@given(name=st.sampled_from(list(NUMPY)), x=inside)
def test_functions_of_numpy_take_expressions(name: str, x: float) -> None:
    tree = NUMPY[name](u)
    assert isinstance(tree, Expr)
    assert evaluate(tree, {"u": x}) == pytest.approx(float(NUMPY[name](x)), rel=1e-12)


def test_arrays_of_expressions_are_taken_one_by_one() -> None:
    assert list(np.sin([u, v])) == [pc.sin(u), pc.sin(v)]
    assert list(np.sin(np.array([u, v], dtype=object))) == [pc.sin(u), pc.sin(v)]
    assert list(np.array([1.0, 2.0]) * u) == [u, 2 * u]
    assert (np.array([[1], [2]]) + np.array([u, v], dtype=object)).shape == (2, 2)
    with pytest.raises(InputError, match=r"numpy.cbrt does not take expressions"):
        np.cbrt(u)
    with pytest.raises(InputError, match=r"numpy.interp does not take expressions"):
        np.interp(u, [0, 1], [0, 1])
    assert np.sum([u, v, 2]) == u + v + 2


def test_functions_of_sympy_take_expressions() -> None:
    found = pc.from_sympy(sympy.sin(u) + sympy.Max(u, v) * sympy.Rational(1, 3))
    at = {"u": 0.3, "v": 0.8}
    assert evaluate(found, at) == pytest.approx(math.sin(0.3) + 0.8 / 3)


def test_what_takes_numbers_only_says_what_to_use() -> None:
    with pytest.raises(
        TypeError, match=r"functions of Python's math take numbers only: use .* pc.sin"
    ):
        math.sin(u)
    with pytest.raises(TypeError, match="u is no number"):
        round(u)
    with pytest.raises(TypeError, match="minimum and maximum instead of min and max"):
        min(u, v)
    assert math.ceil(u) == -pc.floor(-u)
    with pytest.raises(TypeError, match=r"a power is written \*\*, as in u\*\*2"):
        assert u ^ 2
    with pytest.raises(TypeError, match=r"write where\(condition, a, b\) instead of 'if'"):
        assert u < 1
    with pytest.raises(InputError, match="a condition is made of < <= > >="):
        pc.where(u, 1, 2)  # type: ignore[arg-type]
    assert math.sqrt(pc.pi) == math.sqrt(math.pi)


def test_python_has_the_names_of_the_language() -> None:
    a, b = pc.point(u, v, w), pc.point(1, 2, 3)
    texts = {
        "min(u, v, 2)": pc.minimum(u, v, 2), "max(u, v)": pc.maximum(u, v), "floor(u)": pc.floor(u),
        "clamp(u, 0.2, 1)": pc.clamp(u, 0.2, 1), "sign(u)": pc.sign(u),
        "mod(u, 0.5)": pc.mod(u, 0.5), "hypot(u, v)": pc.hypot(u, v), "30*deg": 30 * pc.deg,
        "if(u < v, u, 3)": pc.where(u < v, u, 3),
        "if(u < v or v > 1 and not u > 1, u, 3)": pc.where((u < v) | (v > 1) & ~(u > 1), u, 3),
    }  # fmt: skip
    for text, tree in texts.items():
        assert read(text) is tree, text
    points = {
        "rotx([u, v, w], 2)": pc.rotx(a, 2), "roty([u, v, w], u)": pc.roty(a, u),
        "rotz([u, v, w], u)": pc.rotz(a, u),
        "if(u < v, [u, v, w], [1, 2, 3])": pc.where(u < v, a, b),
        "rotate([u, v, w], [1, 2, 3], vector(0, 0, 1), v)":
            pc.rotate(a, b, pc.vector(0, 0, 1), v),
    }  # fmt: skip
    for text, found in points.items():
        assert read_expression(text, NAMES).coordinates == found.coordinates, text


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("sin(30deg)", "30*pi/180"),
        ("sin(30°)", "30*pi/180"),
        ("sin(radians(30))", "30*pi/180"),
        ("degrees(u)", "30*pi/180"),
        ("math.sin(u)", "write sin(…) instead of math.sin(…)"),
        ("2*np.cos(u)", "write cos(…) instead of np.cos(…)"),
    ],
)
def test_habits_of_other_languages_get_a_hint(text, hint):
    with pytest.raises(InputError, match=re.escape(hint)):
        read_expression(text, NAMES)
