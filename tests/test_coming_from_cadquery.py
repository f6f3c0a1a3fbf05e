"""The rows of docs/coming-from-cadquery.md: what CadQuery makes without a word, and what we say."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

cq = pytest.importorskip("cadquery")

import pc2cad as pc  # noqa: E402
from pc2cad.errors import NotASolidError  # noqa: E402

PAGE = Path(__file__).parent.parent / "docs" / "coming-from-cadquery.md"
u, v, w = pc.parameters()
TURN = 2 * pc.pi


def tight_helix() -> cq.Shape:
    path = cq.Workplane(cq.Wire.makeHelix(1, 3, 5))
    return cq.Workplane("XZ").center(5, 0).circle(1).sweep(path, isFrenet=True).val()


def tight_bend() -> cq.Shape:
    path = cq.Workplane("XY").spline([(0, 0), (0, 5), (1, 6), (2, 5), (2, 0)])
    return cq.Workplane("XZ").circle(2).sweep(path).val()


def folded_loft() -> cq.Shape:
    first = cq.Workplane().rect(4, 4).workplane(offset=5).rect(0.1, 0.1)
    return first.workplane(offset=-4).rect(4, 4).loft().val()


def tube(major: object, minor: object, turns: int, pitch: float) -> tuple[object, ...]:
    around, along = TURN * v, TURN * turns * u
    out = major + minor * w * pc.cos(around)
    return (
        out * pc.cos(along), out * pc.sin(along), pitch * turns * u + minor * w * pc.sin(around),
    )  # fmt: skip


#: words of the page's row -> the native way, its volume, and the same as an equation
SILENT: dict[str, tuple[Callable[[], cq.Shape], float, tuple[object, ...]]] = {
    "a circle of radius 1 along a helix of pitch 1": (tight_helix, 296.09, tube(5, 1, 3, 1.0)),
    "a circle of radius 2 round a bend of radius 1": (tight_bend, 102.23, tube(1, 2, 1, 0.0)),
    "a loft through sections at 0, 5 and 1": (
        folded_loft, -3.312, ((u - 0.5) * (4 - 3 * w), (v - 0.5) * (4 - 3 * w), 9 * w - 8 * w**2),
    ),
}  # fmt: skip


@pytest.mark.parametrize("row", SILENT)
def test_what_is_valid_there_is_refused_here(row: str) -> None:
    native, volume, equation = SILENT[row]
    shape = native()
    assert shape.isValid()
    assert shape.Volume() == pytest.approx(volume, rel=1e-3)
    with pytest.raises(NotASolidError):
        pc.compile_part(equation)
    (line,) = [text for text in PAGE.read_text().splitlines() if row in text]
    assert f"{volume:g}" in line


def test_a_parametric_surface_is_near_and_does_not_say_how_near() -> None:
    def place(a: float, b: float) -> tuple[float, float, float]:
        a, b = 2 * math.pi * a, 2 * math.pi * b
        out = 4 + math.cos(b)
        return out * math.cos(a), out * math.sin(a), math.sin(b)

    face = cq.Workplane().parametricSurface(place, N=20).val()
    true = 16 * math.pi**2
    assert face.isValid()
    assert face.ShapeType() == "Face"
    assert 1e-5 < abs(face.Area() / true - 1) < 1e-4
    part = pc.compile_part(tube(4, 1, 1, 0.0))
    assert part.is_exact
    assert part.area == pytest.approx(true, rel=1e-12)
    assert part.report.faces[0].carrier == "torus"
    assert "1.8e-5" in PAGE.read_text()
