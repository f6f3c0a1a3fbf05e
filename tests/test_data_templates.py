"""Lists, tables and entries of [let] in templates: where they may stand, and what is refused."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.templates.file import parse_template

CUBE = '[solid]\nx = "10*u"\ny = "3*v"\nz = "w*{z}"\n'


def solid(z: str, tables: str, **values: float):
    return parse_template(f'title = "t"\n{tables}\n' + CUBE.format(z=z), "t").bind(values)


def height(z: str, tables: str, u: float, v: float = 0.5, **values: float) -> float:
    return evaluate(solid(z, tables, **values).coordinates[2], {"u": u, "v": v, "w": 1.0})


DATA = """
[parameters]
r = 2
[data]
k = [1, "2*r", 0.5]
m = [[1, 2, 3], ["u", "k[1]", 6]]
"""


def test_lists_hold_numbers_and_expressions() -> None:
    assert height("sum(i, 0, 2, k[i]*u^i)", DATA, 0.5) == 1 + 4 * 0.5 + 0.5 * 0.25
    assert height("sum(i, 0, 1, sum(j, 0, 2, m[i, j]))", DATA, 0.25) == 6 + 0.25 + 4 + 6
    assert height("k[1]", DATA, 0.5, r=7) == 14


TABLES = """
[parameters]
top = { default = 2, min = 1, max = 3 }
[let]
middle = "top/2 + 1/4"
[tables]
chord = { at = [0, 1, 2.5, "2*top"], values = [1, "top", "middle", 1] }
flat = { at = [[0, 1], [0, 0.5, 1]], values = [[1, 2, 3], [2, "top", 4]], kind = "linear" }
spine = { at = [0, 0.5, 1], points = [[0, 0, 0], [1, 0, "top"], [0, 0, 4]] }
ring = { at = [0, 90, 180, 360], values = [1, 2, 1, 1], periodic = true, kind = "pchip" }
steep = { at = [0, 1, 2], values = [0, 1, 0], ends = [3, "-top"] }
"""


def test_tables_are_functions_of_their_values() -> None:
    for top in (2.0, 2.5):
        at, values = [0, 1, 2.5, 2 * top], [1, top, top / 2 + 0.25, 1]
        truth = CubicSpline(at, values, bc_type="natural")
        assert height("chord(4*u)", TABLES, 0.3, top=top) == pytest.approx(float(truth(1.2)))
    assert height("flat(u, v)", TABLES, 0.5, 0.25) == pytest.approx((1.5 + 2) / 2)
    assert height("spine(u).x + spine(u).z", TABLES, 0.5) == pytest.approx(3)
    assert height("ring(360*u + 3600)", TABLES, 0.25) == pytest.approx(2)
    truth = CubicSpline([0, 1, 2], [0, 1, 0], bc_type=((1, 3.0), (1, -2.0)))
    assert height("steep(2*u)", TABLES, 0.8) == pytest.approx(float(truth(1.6)))


def test_a_table_is_a_solid_of_exact_faces() -> None:
    part = compile_equation(solid("chord(4*u)", TABLES))
    truth = CubicSpline([0, 1, 2.5, 4], [1, 2, 1.25, 1], bc_type="natural").integrate(0, 4) * 7.5
    assert part.report.solid.volume == pytest.approx(truth, rel=1e-12)
    assert all(face.evidence == "exact" for face in part.report.faces)


EVERYWHERE = """
title = "entries of [let] wherever a length may stand"
[parameters]
r = { default = 1, min = 0.5, max = 2 }
[curves.ring]
kind = "ellipse"
a = "wide"
b = "wide/2"
[guide]
N = "spine(2*u) + rise*u"
[frame]
kind = "direction"
direction = "aside"
twist = "turn*u"
[layers]
inner = "thin"
outer = "2*thin"
[tables]
spine = { at = [0, 1, 2], points = [[0, 0, 0], ["wide", 0, 5], [0, 0, 10]] }
[let]
wide = "2*r"
rise = "vector(0, 0, wide/10)"
aside = "vector(0, 1, 0)"
turn = "30*deg"
thin = "r/10"
S = "N + (R - N)*ring_x(v) + (Q - N)*ring_y(v)"
[solid]
M = "S + (S - N)*depth(w)"
"""


def test_entries_of_let_may_be_used_everywhere() -> None:
    template = parse_template(EVERYWHERE, "t")
    assert [d.name for d in template.lets] == [
        "wide", "rise", "N", "aside", "turn", "thin", "S"]  # fmt: skip
    small, large = (template.bind({"r": r}) for r in (1, 2))
    assert len(small.layers) == 2
    for equation, wide in ((small, 2), (large, 4)):
        assert equation.guide is not None
        N = [evaluate(c, {"u": 0.5}) for c in equation.guide]
        assert pytest.approx([wide, 0, 5 + wide / 20]) == N


def test_a_guide_that_names_no_frame_has_the_default_one() -> None:
    guide = 'title = "t"\n[let]\nb = "3*2"\n[guide]\nN = "[b*u, 0, u^2]"\n'
    rod = '[solid]\nM = "N + ((R-N)*cos(2*pi*v) + (Q-N)*sin(2*pi*v))*w"\n'
    left_out, named = (parse_template(guide + f + rod, "t").bind() for f in ("", "[frame]\n"))
    assert left_out.coordinates == named.coordinates
    assert left_out.frame == named.frame != ""
    # nobody asks for it, or R and Q are something else
    assert parse_template(guide + '[solid]\nM = "N + [0, v, w]-[0,0,0]"\n', "t").bind().frame == ""
    own = guide.replace("[let]", '[points]\nR = [1, 1, 1]\n[let]\nQ = "R + [0, u, 0] - [0,0,0]"')
    assert parse_template(own + rod, "t").bind().frame == ""


def test_show_prints_data_tables_and_their_use(tmp_path, capsys) -> None:
    file = tmp_path / "t.toml"
    file.write_text(EVERYWHERE + '[data]\nk = [1, 2]\nm = [[1, 2], ["r", 4]]\n', "utf-8")
    assert main(["show", str(file)]) == 0
    text = capsys.readouterr().out
    assert "k: 2 entries" in text
    assert "m: 2 x 2 entries" in text
    assert "spine(a): cubic, points at 3 places from 0 to 2" in text
    assert "x_N = x_spine(2*u) + x_rise*u" in text
    assert "wide = 2*r" in text
    assert main(["show", "--latex", str(file)]) == 0
    assert r"x_{\mathrm{spine}}\left(2\,u\right)" in capsys.readouterr().out


LANGUAGE = (
    'title = "t"\n[data]\nk = [1, 2]\n[tables]\nf = { at = [[0, 1], [0, 1]], values = '
    '[[1, 2], [3, 4]] }\n[let]\na = "if(u < 0.5 and not v > 1, P.x, min(u, v, 2))"\n'
    'b = "sum(i, 0, 1, k[i]*cos(i*30*deg)) + f(u, v)"\nc = "diff(f(u, v), u) + mod(u, 2)"\n'
    '[points]\nP = [1, 2, 3]\n[solid]\nM = "if(u < c, rotz(P, u), P) + '
    '(rotate([u, v, w], P, vector(0, 0, 1), b) - P)*a"\n'
)


def test_show_prints_the_language_by_coordinates(tmp_path, capsys) -> None:
    file = tmp_path / "t.toml"
    file.write_text(LANGUAGE, "utf-8")
    for more in ([], ["--latex"]):
        assert main(["show", str(file), *more]) == 0
        text = capsys.readouterr().out
        assert "…" not in text
        assert "?" not in text


REFUSED = {
    "no list": ("[data]\nk = 3", r"\[data\] k: is a list"),
    "empty": ("[data]\nk = []", r"\[data\] k: is a list"),
    "both": ("[data]\nk = [1, [2]]", "is a list of numbers, or one of lists, and not of both"),
    "text": ('[data]\nk = ["u +"]', r"\[data\] k\[0\]: column 4: expected"),
    "later": ('[data]\na = ["b[0]"]\nb = [1]', r"\[data\] a\[0\]: column 1: unknown list 'b'"),
    "reserved": ("[data]\npi = [1]", "the name pi is reserved"),
    "no table": ("[tables]\nf = [1, 2]", r"\[tables\] f: is a table, { at = "),
    "no places": ("[tables]\nf = { values = [1, 2] }", "needs the places of its values, at ="),
    "no values": ("[tables]\nf = { at = [0, 1] }", "needs either values or points"),
    "unknown key": ("[tables]\nf = { at = [0, 1], value = [1, 2] }", "did you mean values"),
    "kind": ("[tables]\nf = { at = [0, 1], values = [1, 2], kind = 'nurbs' }", "is one of linear"),
    "unsorted": ("[tables]\nf = { at = [0, 2, 1], values = [1, 2, 3] }",
                 r"\[tables\] f: at ascends, and 1 follows 2 as number 3 of its list"),
    "short": ("[tables]\nf = { at = [0, 1, 2], values = [1, 2] }", "2 entries for 3 places of at"),
    "ragged": ("[tables]\nf = { at = [[0, 1], [0, 1]], values = [[1, 2], [1]] }",
               "row 2 of values has 1 entries for 2 places"),
    "flat": ("[tables]\nf = { at = [[0, 1], [0, 1]], values = [1, 2] }",
             r"f.values\[0\]: is a list, and one of lists where there are two lists of places"),
    "depends": ('[tables]\nf = { at = [0, 1], values = ["u", 2] }', "must be constant, .* on u"),
    "triples": ("[tables]\nf = { at = [0, 1], points = [[1, 2], [3, 4]] }", "three coordinates"),
    "ends": ("[tables]\nf = { at = [0, 1], values = [1, 2], ends = [1] }", "ends are two slopes"),
    "periodic": ("[tables]\nf = { at = [0, 1], values = [1, 1], periodic = 1 }", "true or false"),
    "open": ("[tables]\nf = { at = [0, 1, 2], values = [1, 1, 2], periodic = true }",
             "ends as it begins"),
    "a function's name": ("[tables]\nmin = { at = [0, 1], values = [1, 2] }", "min is reserved"),
    "huge": (f"[tables]\nf = {{ at = {list(range(20001))}, values = [1] }}", "at most 20000"),
    "huge list": (f"[data]\nk = {[1] * 20001}", "has more than 20000 entries"),
    "circle": ('[let]\na = "f(0)"\n[tables]\nf = { at = [0, 1], values = ["a", 2] }',
               r"\[tables\] f: is made of \[let\] a, which is made of it in turn"),
    "forward": ('[let]\na = "b"\nb = "1"', r"\[let\] a: column 1: unknown name 'b'"),
    "called wrongly": ("[tables]\nf = { at = [0, 1], values = [1, 2] }\n[let]\na = 'f(u, v)'",
                       "f takes 1 operand, here are 2"),
    "of two": ("[tables]\nf = { at = [[0, 1], [0, 1]], values = [[1, 2], [3, 4]] }\n[let]\n"
               "a = 'f(u)'", "f takes 2 operands, here are 1"),
    "beyond": ("[tables]\nf = { at = [0, 1], values = [1, 2] }\n[let]\na = 'f(2)'",
               "the table f runs from 0 to 1, and is asked for its value at 2; end the domain"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_mistakes_are_named_with_their_place(name: str) -> None:
    tables, match = REFUSED[name]
    with pytest.raises(InputError, match=match) as error:
        solid("1", tables)
    assert "\n" not in str(error.value)


def test_old_names_of_values_may_stay() -> None:
    names = "floor", "mod", "deg", "sign", "max"
    text = "".join(f"{name} = {i}\n" for i, name in enumerate(names, start=1))
    z = "floor + mod*deg + floor(1.5 + sign) + max"
    assert height(z, f"[parameters]\n{text}", 0.5) == 1 + 2 * 3 + 5 + 5


BOMBS = {
    "sums in sums": "sum(i, 1, 99, sum(j, 1, 99, sum(k, 1, 99, i*j*k*u)))",
    "tables in tables": "f(f(f(f(f(f(f(f(f(f(f(f(u))))))))))))",
    "choices in choices": "if(u < 1, " * 18 + "u" + ", v)" * 18,
    "nots": "if(" + "not " * 55 + "u < v, u, v)",
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_short_texts_of_huge_trees_end_soon(name: str) -> None:
    table = "[tables]\nf = { at = [0, 0.5, 1], values = [0, 0.7, 1], kind = 'pchip' }"
    start = time.process_time()
    with suppress(InputError):
        assert solid(BOMBS[name], table).coordinates
    assert time.process_time() - start < 5


def test_a_net_of_points_is_read_in_time() -> None:
    n = 24
    net = [[[i, j, round(float(np.sin(i + j)), 3)] for j in range(n)] for i in range(n)]
    text = f"[tables]\ns = {{ at = [{list(range(n))}, {list(range(n))}], points = {net} }}"
    start = time.process_time()
    assert height(f"(20 + s({n - 1}*u, {n - 1}*v).z)", text, 1.0, 1.0) == pytest.approx(
        20 + round(float(np.sin(2 * n - 2)), 3))  # fmt: skip
    assert time.process_time() - start < 5


@pytest.mark.parametrize("key", ["start", 'kind = "direction"\ndirection', 'kind = "point"\nE'])
def test_references_of_frames_are_decimals_and_expressions(key: str) -> None:
    text = (
        'title = "t"\n[parameters]\nq = 0.25\n[guide]\nN = "[u^2, 0, 5*u]"\n[let]\nk = "2*q"\n'
        f"[frame]\n{key} = LIST\n"
        '[solid]\nM = "N + (R-N)*w*cos(2*pi*v) + (Q-N)*w*sin(2*pi*v)"\n'
    )
    lists = ("[0.5, 1, 0.25]", '["k", "1", "q"]')
    one, other = (parse_template(text.replace("LIST", x), "t").bind() for x in lists)
    assert one.coordinates == other.coordinates
    with pytest.raises(InputError, match=r"\[frame\] \w+: is a list of three coordinates"):
        parse_template(text.replace("LIST", "[1, 0.5]"), "t")
