"""What a user finds in the REPL, in a notebook and on the command line at once."""

from __future__ import annotations

import pydoc
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError
from pc2cad.part import Part
from pc2cad.templates.file import read_template_text
from pc2cad.templates.header import TemplateError
from pc2cad.templates.shipped import UnknownTemplateError, find_template


@cache
def ellipsoid() -> Part:
    """Semi-axes 3, 2, 1."""
    return pc.compile_equation(pc.read_template("ellipsoid").bind({}))


def test_a_part_and_its_report_are_one_line_each() -> None:
    part = ellipsoid()
    assert repr(part) == (
        "<Part ellipsoid: volume 25.13274123 mm^3, area 48.8821463 mm^2, 1 face, exact>"
    )
    assert repr(part.report) == repr(part).replace("Part", "Report")
    assert part.report.verdict == "valid solid, exact, 1 face"


def test_templates_equations_guides_and_frames_are_one_line_each() -> None:
    duct, bodies = pc.read_template("duct"), pc.read_template("common_of_pipes")
    helix = pc.helix(1, 2, 3)
    for value in (duct, duct.bind(), bodies, bodies.bind(), helix, pc.frame(helix)):
        assert "\n" not in repr(value)
        assert 10 < len(repr(value)) < 200, repr(value)


@pytest.mark.parametrize(
    "equation",
    [
        ("2*u", "v", "w*(1 + u^2)"),
        "[2*u, v, w*(1 + u^2)]",
        lambda u, v, w: (2 * u, v, w * (1 + u**2)),
        lambda u, v, w: pc.point(2 * u, v, w * (1 + np.square(u))),
        ("2*u", lambda u, v, w: v, lambda u, v, w: w * (1 + u**2)),
    ],
)
def test_texts_and_functions_are_coordinates(equation: Any) -> None:
    made = point_equation(equation)
    u, v, w = pc.parameters()
    assert made.coordinates == point_equation((2 * u, v, w * (1 + u**2))).coordinates


@pytest.mark.parametrize(
    ("equation", "words"),
    [
        ("[u, v, q]", "unknown name 'q'"),
        ("[u, v, np.sin(w)]", "write sin\\(…\\) instead of np.sin\\(…\\)"),
        ("[u, v, np.pi*w]", "write pi instead of np.pi$"),
        (("u", "v", "[u, v, w]"), "a coordinate is Combination"),
        (5, "neither a point nor three coordinates"),
        (pc.read_template("ball"), "bind\\(\\) makes an equation of it"),
    ],
)
def test_what_is_no_equation_is_told_in_a_sentence(equation: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        point_equation(equation)
    with pytest.raises(InputError, match=words):
        pc.compile_equation(equation)


def test_the_name_of_a_template_is_no_equation() -> None:
    with pytest.raises(InputError, match=r"pc2cad.read_template\('duct'\)\.bind\(\) makes one"):
        pc.compile_part("duct")


def test_a_part_has_its_figures() -> None:
    part = ellipsoid()
    assert (part.name, part.units, part.is_exact, list(part.faces)) == (
        "ellipsoid", "mm", True, ["w=1"],
    )  # fmt: skip
    assert part.volume == pytest.approx(8 * np.pi, rel=1e-12)
    assert part.area == part.report.equation.area
    assert np.abs(part.center).max() < 1e-12
    np.testing.assert_allclose(part.bounding_box, [[-3, -2, -1], [3, 2, 1]], atol=3e-7)
    # V/5 times the sums of squares of two semi-axes
    assert np.allclose(part.inertia, 8 * np.pi / 5 * np.diag([5.0, 10.0, 13.0]), atol=1e-9)


def test_inertia_does_not_depend_on_the_sign_of_det_j_or_on_the_place() -> None:
    u, v, w = pc.parameters()
    box = pc.compile_part((100 + 2 * v, 3 * u, 4 * w))
    mass, sides = 24.0, np.array([4.0, 9.0, 16.0])
    assert np.allclose(box.inertia, np.diag(mass / 12 * (sides.sum() - sides)), rtol=1e-12)


def test_pictures_and_pages_are_a_call_away(tmp_path: Path) -> None:
    part = ellipsoid()
    assert part._repr_png_().startswith(b"\x89PNG")  # type: ignore[union-attr]
    part.render(tmp_path / "a.svg", view=(1, 1, 1), size=(200, 150), colours=True)
    assert "<svg" in (tmp_path / "a.svg").read_text()
    part.view(tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text().startswith("<!DOCTYPE html>")
    with pytest.raises(InputError, match="no view"):
        part.render(tmp_path / "b.png", view="above")
    with pytest.raises(InputError, match="a picture has no 'colour'; it has colours"):
        part.render(tmp_path / "b.png", colour=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "a.svg"]


def test_show_opens_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    ellipsoid().show()
    (address,) = opened
    page = Path(address.removeprefix("file://"))
    assert b"ellipsoid" in page.read_bytes().lower()
    page.unlink()


def test_templates_are_read_by_name_and_files_by_path(tmp_path: Path) -> None:
    assert pc.read_template("duct").name == "duct"
    with pytest.raises(UnknownTemplateError, match="did you mean duct"):
        pc.read_template("dukt")
    with pytest.raises(TemplateError, match="cannot be read"):
        pc.read_template(tmp_path / "duct.toml")


def test_a_shipped_template_is_copied_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own.toml"
    assert main(["new", str(own), "--from", "duct"]) == 0
    assert own.read_text() == read_template_text(find_template("duct"))
    assert main(["new", str(tmp_path / "b.toml"), "--from", "dukt"]) == 2
    assert "did you mean duct" in capsys.readouterr().err


def test_a_picture_of_no_known_kind_is_refused_before_the_kernel_loads(tmp_path: Path) -> None:
    script = (
        "import sys; from pc2cad.cli.main import main; "
        "code = main(['render', 'ball', '-o', 'a.jpg']); "
        "sys.exit(9 if 'OCP' in sys.modules else code)"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=False,
                          capture_output=True, text=True, timeout=60)  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert ".png" in done.stderr


def test_help_shows_what_a_user_calls() -> None:
    shown = pydoc.render_doc(pc, renderer=pydoc.plaintext)
    for name in ("compile_part(", "read_template(", "class Part(", "write_mesh(", "parameters("):
        assert name in shown


def test_a_solid_of_one_equation_loads_nothing_that_is_for_several_bodies() -> None:
    script = (
        "import sys, pc2cad as pc; pc.compile_equation(pc.read_template('pyramid').bind({})); "
        "print([m for m in "
        "('pc2cad.csg', 'scipy.spatial', 'scipy.interpolate', 'numpy.ma', 'numpy.random') "
        "if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "[]\n"


def test_check_says_the_verdict_first_and_the_box(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "ellipsoid"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  valid solid, exact, 1 face"
    assert "  x    -3   3       6" in lines
