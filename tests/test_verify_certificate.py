"""Certificates: what a replay finds again by arithmetic alone, and what it refuses."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
import random
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from consumers.step_edits import move, pole, read_instances

from pc2cad.cli.main import main
from pc2cad.compiler import compile_solid
from pc2cad.expression.tree import Expr, call, symbol
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import find_template
from pc2cad.verify.against import verification
from pc2cad.verify.certificate import NotVerifiedError, certificate
from pc2cad.verify.nearness import program_of
from pc2cad.verify.receipt import parse_step
from pc2cad.verify.replay import Jet, ReplayError, replay, run

Case = tuple[dict[str, Any], bytes]
NAMES = ("bilinear_top", "cone", "ball_wedge")


@pytest.fixture(scope="session")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Case]:
    folder, made = tmp_path_factory.mktemp("certified"), dict[str, Case]()

    def case(name: str) -> Case:
        if name not in made:
            path = folder / f"{name}.step"
            equation = read_template(find_template(name)).bind()
            compile_solid(equation).write(path)
            data = read_instances(path).encode()
            found = verification(parse_step(data), equation, claims=True)
            held = certificate(found, path, find_template(name))
            made[name] = json.loads(json.dumps(held, allow_nan=False)), data
        return made[name]

    return case


@pytest.mark.parametrize("name", NAMES)
def test_every_face_is_bounded_anew(cases: Callable[[str], Case], name: str) -> None:
    held, data = cases(name)
    template = find_template(name).read_bytes()
    found = replay(held, data, template)
    count = len(held["faces"])
    assert f"{count} of {count} faces bounded anew" in found[1]
    assert {face["rests_on"] for face in held["faces"]} <= {"exact", "bounded"}


def _number(held: dict[str, Any]) -> None:
    for face in held["faces"]:
        for row in face["replay"][0]["program"]:
            if row[0] == "number":
                row[1] *= 1.001


def _cells(held: dict[str, Any]) -> None:
    held["faces"][0]["replay"][0]["cells"][0] = [0.0, 0.5]


def _face(held: dict[str, Any]) -> None:
    held["faces"].pop()


def _distance(held: dict[str, Any]) -> None:
    for face in held["faces"]:
        face["distance"] *= 1e-3


def _tolerance(held: dict[str, Any]) -> None:
    held["tolerance"] = 1e-18


def _operation(held: dict[str, Any]) -> None:
    held["faces"][0]["replay"][0]["program"][-1][0] = "open"


def _other(held: dict[str, Any]) -> None:
    one, other = (face for face in held["faces"][:2])
    one["replay"], other["replay"] = other["replay"], one["replay"]


def _verdict(held: dict[str, Any]) -> None:
    held["verified"] = False


FORGED: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "another number of the equation": (_number, "is stated"),
    "cells that leave out a half": (_cells, "partition"),
    "a face left out": (_face, "shells"),
    "bounds that are too small": (_distance, "is stated"),
    "a tolerance that is too small": (_tolerance, "are allowed"),
    "an operation of its own": (_operation, "not known"),
    "programs of other faces": (_other, "is stated"),
    "no verified file": (_verdict, "verified"),
    "another hash": (lambda held: held["file"].update(sha256="0" * 64), "not the one"),
}


@pytest.mark.parametrize("kind", FORGED)
def test_a_certificate_that_is_forged_does_not_hold(
    cases: Callable[[str], Case], kind: str
) -> None:
    held, data = cases("bilinear_top")
    changed = copy.deepcopy(held)
    FORGED[kind][0](changed)
    assert changed != held
    with pytest.raises(ReplayError, match=FORGED[kind][1]):
        replay(changed, data)


def test_the_angle_of_a_cone_is_read_in_radians_alone(
    cases: Callable[[str], Case],
) -> None:
    held, data = cases("cone")
    text = data.decode()
    (old,) = re.findall(r"CONICAL_SURFACE\('',#\d+,[\d.E+-]+,([\d.E+-]+)\)", text)
    (unit,) = re.findall(r"#\d+ = \( NAMED_UNIT\(\*\) PLANE_ANGLE_UNIT\(\) [^;]*;", text)
    degrees = (
        f"{unit.split()[0]} = ( CONVERSION_BASED_UNIT('DEGREE',#90001) NAMED_UNIT(#90003) "
        "PLANE_ANGLE_UNIT() );#90001 = PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE("
        f"{math.pi / 180!r}),#90002);" + unit.replace(unit.split()[0], "#90002")
        + "#90003 = DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.);"
    )  # fmt: skip
    in_degrees = text.replace(unit, degrees)
    turned = in_degrees.replace(f",{old})", f",{math.degrees(float(old))!r})")
    broken = text.replace(unit, unit.replace(".RADIAN.", ".STERADIAN."))
    for changed in (in_degrees, turned, broken):
        with pytest.raises(ReplayError, match="not the radian"):
            replay(held | {"file": {**held["file"], "sha256": _sha(changed)}}, changed.encode())
    # in degrees it is no less true, and its cone is not claimed
    equation = read_template(find_template("cone")).bind()
    found = verification(parse_step(turned.encode()), equation, claims=True)
    assert {m.nearness.rests_on for m in found.matches} == {"exact"}
    assert {m.name: len(m.nearness.claims) for m in found.matches} == {"w=0": 1, "v=1": 0}


def _sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("by", [1e-1, 1e-3, 1e-5, 3e-6])
def test_another_file_does_not_hold_by_its_numbers(cases: Callable[[str], Case], by: float) -> None:
    """Even under its own hash: the poles are read from the text."""
    held, data = cases("bilinear_top")
    text = data.decode()
    changed = move(text, pole(text, 0, 0), by).encode()
    forged = copy.deepcopy(held)
    forged["file"]["sha256"] = hashlib.sha256(changed).hexdigest()
    with pytest.raises(ReplayError, match="is stated"):
        replay(forged, changed)
    with pytest.raises(ReplayError, match="not the one"):
        replay(held, changed)


def test_a_face_that_is_turned_over_is_no_closed_shell(cases: Callable[[str], Case]) -> None:
    held, data = cases("cone")
    changed = data.replace(b",.T.);", b",.F.);", 1)
    forged = copy.deepcopy(held)
    forged["file"]["sha256"] = hashlib.sha256(changed).hexdigest()
    with pytest.raises(ReplayError, match="once in each sense"):
        replay(forged, changed)


def test_another_template_does_not_hold(cases: Callable[[str], Case]) -> None:
    held, data = cases("cone")
    with pytest.raises(ReplayError, match="the template is not the one"):
        replay(held, data, find_template("torus").read_bytes())


def test_a_file_that_differs_has_no_certificate(cases: Callable[[str], Case]) -> None:
    _, data = cases("cone")
    found = verification(parse_step(data), read_template(find_template("cone")).bind({"h": 5}))
    with pytest.raises(NotVerifiedError, match="no certificate"):
        certificate(found, "cone.step")


def test_the_verb_writes_and_replays(
    cases: Callable[[str], Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, held = tmp_path / "cone.step", tmp_path / "cone.json"
    file.write_bytes(cases("cone")[1])
    assert main(["verify", str(file), "cone", "--certificate", str(held)]) == 0
    assert main(["verify", str(file), "cone", "--replay", str(held)]) == 0
    assert "holds" in capsys.readouterr().out
    assert main(["verify", str(file), "torus", "--replay", str(held)]) == 6
    assert main(["verify", str(file), "--replay", str(file)]) == 2
    held.unlink()
    assert main(["verify", str(file), "cone", "-s", "h=5", "--certificate", str(held)]) == 6
    assert not held.exists()
    assert main(["verify", str(file), "--certificate", str(held)]) == 2


def test_a_replay_loads_numpy_and_nothing_else(
    cases: Callable[[str], Case], tmp_path: Path
) -> None:
    held, data = cases("bilinear_top")
    (tmp_path / "c.json").write_text(json.dumps(held))
    (tmp_path / "f.step").write_bytes(data)
    code = (
        "import json, sys; from pathlib import Path; from pc2cad.verify.replay import replay;"
        "assert len(replay(json.load(open('c.json')), Path('f.step').read_bytes())) == 3;"
        "print({m for m in sys.modules if m.startswith('pc2cad.') and '.' in m[7:]},"
        "{'scipy', 'sympy', 'OCP'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    assert {"pc2cad.verify.replay"} >= {
        name
        for name in done.stdout.replace("'", " ").replace(",", " ").replace("{", " ").split()
        if name.startswith("pc2cad.verify")
    }
    assert done.stdout.strip().endswith("set()")
    for room in ("equation", "expression", "templates", "bounds", "geometry", "domain"):
        assert f"pc2cad.{room}" not in done.stdout


def _broken(value: Any, chance: random.Random) -> Any:
    """Change one thing somewhere in plain data."""
    if isinstance(value, dict | list) and value and chance.random() < 0.9:
        copied = copy.copy(value)
        key: Any = (
            chance.choice(list(value)) if isinstance(value, dict) else chance.randrange(len(value))
        )
        copied[key] = _broken(value[key], chance)
        return copied
    if isinstance(value, float):
        return value * chance.choice([0.0, -1.0, 0.5, 1e300, float("nan")])
    odd = [None, "", "1e999999999", [], {}, 0, -1, 10**30, "1/0", float("inf"), True, [[[]]]]
    return chance.choice(odd)


def test_broken_certificates_end_in_a_verdict(
    cases: Callable[[str], Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held, data = cases("ball_wedge")
    (tmp_path / "f.step").write_bytes(data)
    chance, codes = random.Random(7), Counter[int]()
    command = ["verify", str(tmp_path / "f.step"), "--replay", str(tmp_path / "c.json")]
    for _ in range(20):
        broken = {**held, "faces": _broken(held["faces"], chance)}
        (tmp_path / "c.json").write_text(json.dumps(broken))
        codes[main(command)] += 1
    assert set(codes) <= {0, 2, 6}
    assert min(codes[2], codes[6]) > 1
    for text in ("[]", "", "[" * 100_000, '{"format": 1}'):
        (tmp_path / "c.json").write_text(text)
        assert main(command) in (2, 6)
    assert "Traceback" not in capsys.readouterr().err


# -- balls ---------------------------------------------------------------------------------------

ARGUMENTS = {"asin": 0.4, "acos": -0.3, "sqrt": 1.7, "log": 0.6}
TRUE: dict[str, Callable[[Any], Any]] = {
    "neg": lambda x: -x, "div": lambda x: -1 / x,
    "power": lambda x: x ** mpmath.mpf("-1.25"), "third": lambda x: mpmath.cbrt(x) ** 5,
    "whole": lambda x: x**-7,
    **{name: getattr(mpmath, name) for name in (
        "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "sqrt", "asin", "acos", "atan",
        "asinh", "log")},
}  # fmt: skip
TREES: dict[str, Callable[[Expr], Expr]] = {
    "div": lambda x: 1 / -x, "power": lambda x: x ** Fraction(-5, 4),
    "third": lambda x: x ** Fraction(5, 3), "whole": lambda x: x**-7, "neg": lambda x: -x,
}  # fmt: skip


@pytest.mark.parametrize("name", TRUE)
def test_balls_hold_all_taylor_coefficients(name: str) -> None:
    """At every place of the ball, of a function of x + x²/3 - x³/7, to 60 digits."""
    rng, order, half = np.random.default_rng(3), 7, 0.01
    middle, true = ARGUMENTS.get(name, 0.8), TRUE[name]
    inner = (1.0, 1 / 3, -1 / 7)
    c, r = np.zeros((2, order + 1, 1, 1))
    c[0], r[0] = middle, half
    for k, factor in enumerate(inner):
        c[k + 1] = factor
    tree = TREES.get(name, lambda x: call(name, x))(symbol("s"))
    program, (row,) = program_of((tree,), ("s", "t"))
    found = run(program, Jet(c, r), Jet(c, r))[row]
    inside = half * (1.0 - 1e-12)
    with mpmath.workdps(60):
        for place in middle + inside * np.array([-1.0, 1.0, *rng.uniform(-1.0, 1.0, 2)]):

            def series(x: Any, place: float = float(place)) -> Any:
                return true(place + sum(f * x ** (k + 1) for k, f in enumerate(inner)))

            wanted = mpmath.taylor(series, 0, order)
            for k in range(order + 1):
                off = abs(wanted[k] - mpmath.mpf(float(found.c[k, 0, 0])))
                assert off <= float(found.r[k, 0, 0]) + 1e-25, (name, place, k)
    assert np.all(found.r[:6] < 2.0 * (1.0 + np.abs(found.c[:6])))


@pytest.mark.parametrize("turn", list(itertools.product((False, True), repeat=3)))
def test_programs_are_in_the_parameters_of_the_surface(turn: tuple[bool, bool, bool]) -> None:
    swap, *back = turn
    s, t = symbol("s"), symbol("t")
    program, (row,) = program_of((s + 10 * t * t,), ("s", "t"), turn)
    own = np.array([0.2, 0.7])
    found = run(program, *(Jet([[[x]]], [[[0.0]]]) for x in own))[row]
    along = [1.0 - x if reverse else x for x, reverse in zip(own, back, strict=True)]
    s_, t_ = along[::-1] if swap else along
    assert float(found.c[0, 0, 0]) == pytest.approx(s_ + 10 * t_ * t_, abs=1e-14)


# -- the gate ------------------------------------------------------------------------------------


def test_build_verifies_before_it_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pc2cad.export import step

    file, report = tmp_path / "cone.step", tmp_path / "cone.json"
    command = ["build", "cone", "-o", str(file), "--verify", "--report", str(report)]
    assert main(command) == 0
    verdict = json.loads(report.read_text())["verified"][str(file)]
    assert verdict["verified"] is True
    assert verdict["evidence"] == "exact"
    assert verdict["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    true = step.encode
    monkeypatch.setattr(step, "encode", lambda *given: true(*given).replace(b"'w=0'", b"'w=7'", 1))
    for path in (file, report):
        path.unlink()
    assert main(command) == 6
    assert "not this solid: the face 'w=7'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert main(["build", "cone", "-o", str(tmp_path / "cone.stl"), "--verify"]) == 2


def test_a_study_says_which_variants_are_not_verified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pc2cad.export import step
    from pc2cad.studies.variant import Job, Task, run_variant

    task = Task(find_template("cone").read_text(), "cone", ("step",), str(tmp_path), verify=True)
    assert run_variant(task, Job("a", {"h": 3.0})).status == "built"
    assert (tmp_path / "a.step").exists()
    true = step.encode
    monkeypatch.setattr(step, "encode", lambda *given: true(*given).replace(b".T.);", b".F.);", 1))
    found = run_variant(task, Job("b", {"h": 3.0}))
    assert found.status == "not verified"
    assert found.reason
    assert not (tmp_path / "b.step").exists()
