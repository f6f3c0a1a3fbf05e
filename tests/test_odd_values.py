"""Values that are no numbers, no counts or no copies: each gives a sentence, or what was meant."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import time
from decimal import Decimal
from fractions import Fraction
from math import pi

import pytest
import sympy

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError, PointCadError
from pc2cad.expression.tree import number
from pc2cad.integrals.mass_properties import integrate
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import template_paths

CUBE = '[solid]\nx = "u"\ny = "v"\nz = "w"\n'
U, V, W = pc.parameters()
SLOW = """title = "t"
[domain]
u = [-1, 1]
[guide]
N = "{N}"
[frame]
[solid]
M = "N + w*0.5*((R - N)*cos(2*pi*v) + (Q - N)*sin(2*pi*v))"
"""


@pytest.mark.parametrize("key", ["faces", "edges", "vertices", "shells", "euler"])
@pytest.mark.parametrize("value", ["6.4", "2.5", '"13/2"', '"sqrt(2)"', '"6 + 1e-30"'])
def test_what_is_expected_to_be_a_count_is_a_whole_number(key, value) -> None:
    with pytest.raises(InputError, match=rf"\[expect\] {key}: is a whole number"):
        parse_template(f'title = "t"\n{CUBE}[expect]\n{key} = {value}\n', "t")


def test_counts_that_depend_on_parameters_are_whole_at_their_values() -> None:
    text = f'title = "t"\n[parameters]\nn = 3\n{CUBE}[expect]\nfaces = "2*n"\neuler = -2\n'
    template = parse_template(text + "carriers = {plane = 6.0}\n", "t")
    assert template.bind().expectations.faces == 6
    assert template.bind().expectations.euler == -2
    with pytest.raises(InputError, match=r"faces: is a whole number, and 6\.4 was given"):
        template.bind({"n": 3.2})
    for bad in ("carriers = {plane = 5.5}", "shells = -1"):
        with pytest.raises(InputError, match="is a whole number"):
            parse_template(f'title = "t"\n{CUBE}[expect]\n{bad}\n', "t")


@pytest.mark.parametrize("epoch", ["garbage", " ", "-5", "1e9", "9" * 30, "9" * 5000, "٣"])
@pytest.mark.parametrize("verb", ["check", "mesh", "study"])
def test_a_stated_time_that_is_none_is_refused_first(epoch, verb, monkeypatch, capsys) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    more = {"check": [], "mesh": ["-o", "x.vtu"], "study": ["--vary", "p=1,2", "-o", "o"]}
    assert main([verb, "pyramid", *more[verb]]) == 2
    assert "SOURCE_DATE_EPOCH is" in capsys.readouterr().err


def test_an_empty_stated_time_is_none(monkeypatch, capsys) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "")
    assert main(["build", "no-such-template", "-o", "x.step"]) == 2
    assert "SOURCE_DATE_EPOCH" not in os.environ
    assert "SOURCE_DATE_EPOCH" not in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--time-limit", "--memory-limit", "--workers", "--stop-after"])
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1", "1e300"])
def test_limits_of_a_study_are_numbers(option, value, tmp_path, capsys) -> None:
    arguments = ["study", "pyramid_cut", "--vary", "p=.2,.3", "-o", str(tmp_path / "o")]
    assert main([*arguments, option, value]) == 2
    assert option in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--time-limit", "--memory-limit"])
@pytest.mark.parametrize("value", ["nan", "inf", "-1", "1e300"])
def test_limits_of_a_command_are_numbers(option, value) -> None:
    run = [sys.executable, "-m", "pc2cad", "check", "pyramid", option, value]
    ended = subprocess.run(run, capture_output=True, text=True)
    assert ended.returncode == 2
    assert f"pc2cad: {option} {float(value):g}: takes a positive number" in ended.stderr


@pytest.mark.parametrize("count", ["²", "9" * 5000, "-2", ""])
def test_a_slider_has_a_count(count, capsys) -> None:
    assert main(["view", "pyramid_cut", "-o", "x.html", "--slider", f"p=0.2:0.4:{count}"]) == 2
    assert "a whole number from 1 on" in capsys.readouterr().err


def test_a_sample_has_a_seed(tmp_path, capsys) -> None:
    arguments = ["study", "pyramid_cut", "--vary", "p=.2:.3", "--sample", "lhs:2", "--seed", "-1"]
    assert main([*arguments, "-o", str(tmp_path / "o")]) == 2
    assert "the seed of a sample is 0 or more" in capsys.readouterr().err


@pytest.mark.parametrize(
    "value",
    ["9**9**9", "1e999999999", "u", "", "1/0", None, 1j, b"1", [1], Decimal("1e999999999"),
     Decimal("nan"), float("nan"), 10**5000],
    ids=lambda value: str(value)[:12] if not isinstance(value, int) else "long",
)  # fmt: skip
def test_what_is_no_number_is_no_coordinate(value) -> None:
    with pytest.raises(InputError):
        pc.points(A=(value, 0, 0))


def test_texts_and_decimals_that_are_numbers_are_exact() -> None:
    assert number("1/3") is number(Fraction(1, 3))
    assert number(Decimal("0.1")) is number(0.1)
    for given in (1, None, "abc"):
        with pytest.raises(InputError, match="three coordinates"):
            pc.points(A=given)


@pytest.mark.parametrize("name", ["f", "sin", "sqrt"])
def test_an_undefined_function_of_sympy_is_named(name) -> None:
    u, v, w = sympy.symbols("u v w")
    with pytest.raises(InputError, match=f"{name} is a function without a definition"):
        point_equation((sympy.Function(name)(u), v, w))
    with pytest.raises(InputError, match="no scalar expression of SymPy"):
        point_equation((sympy.Matrix([u, v]), v, w))


@pytest.mark.parametrize("name", ["pyramid_cut", "channel_sine", "duct"])
def test_templates_and_equations_can_be_copied_and_pickled(name) -> None:
    template = read_template(template_paths()[name])
    equation = template.bind()
    copies = [pickle.loads(pickle.dumps(equation)), copy.copy(equation), copy.deepcopy(equation)]
    copies.append(pickle.loads(pickle.dumps(template)).bind())
    assert len(copies) == 4
    for other in copies:
        assert other.coordinates == equation.coordinates
        assert other.parameters == equation.parameters
    if template.points:
        point = {template.points[0].name: "[1 + u, 2, 3]"}
        assert copies[0].move(**point).coordinates == equation.move(**point).coordinates


def test_a_deep_tree_is_pickled_without_recursion() -> None:
    tree = U
    for _ in range(5000):
        tree = pc.sin(tree)
    assert pickle.loads(pickle.dumps(tree)) is tree
    assert copy.deepcopy(tree) is tree


def test_a_guide_that_stands_still_for_a_moment_is_a_channel(tmp_path, capsys) -> None:
    from pc2cad.channels.limits import find_limits
    from pc2cad.domain.analysis import analyse

    equation = parse_template(SLOW.format(N="point(10*u^3, 0, 0)"), "t").bind()
    assert find_limits(equation)
    assert integrate(analyse(equation)).volume == pytest.approx(5 * pi, rel=1e-9)
    for cusp in ("point(u^2, u^3, 0)", "point(u^3, u^4, 0)"):
        (tmp_path / "t.toml").write_text(SLOW.format(N=cusp))
        assert main(["check", str(tmp_path / "t.toml")]) == 3
        assert "u = " in capsys.readouterr().err


@pytest.mark.parametrize("module", ["pc2cad.cli", "pc2cad.cli.main", "argparse", "pc2cad.cli.show"])
def test_an_interruption_while_the_command_loads_is_a_sentence(module) -> None:
    code = (
        "import os, signal, sys\n"
        # what is started in the background of a shell ignores it
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import pc2cad.__main__ as command\n"
        "class Hook:\n"
        "    def find_spec(self, name, *rest):\n"
        f"        if name == {module!r}:\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Hook())\n"
        "sys.argv = ['pc2cad', 'show', 'pyramid']\n"
        "sys.exit(command.start())\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ended.returncode == 130
    assert ended.stderr.startswith("pc2cad: interrupted")
    assert ended.stderr.count("\n") == 1


def test_the_squares_of_fractions_do_not_grow_for_ever() -> None:
    lets = "".join(f'a{i} = "a{i - 1}*a{i - 1} + 1/7"\n' for i in range(1, 40))
    begun = time.process_time()
    with pytest.raises(PointCadError, match=r"\[let\] a11: .* over 1228 digits"):
        parse_template(f'title = "t"\n[let]\na0 = "1/3"\n{lets}{CUBE}', "t")
    assert time.process_time() - begun < 1.0
    assert signal.getsignal(signal.SIGINT) is not None
