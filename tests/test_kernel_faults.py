"""What the kernel must not be given, and what it gives back that no file may hold."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.gp import gp_Pnt, gp_Trsf, gp_Vec
from OCP.Standard import Standard_Failure
from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State

from pc2cad import validation
from pc2cad.brep import build as brep
from pc2cad.brep import to_kernel
from pc2cad.brep.inside_out import inside_out
from pc2cad.brep.same_numbers import same_numbers
from pc2cad.brep.spline_numbers import (
    curve_numbers,
    spline_curve,
    spline_surface,
    surface_numbers,
)
from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation
from pc2cad.errors import KernelError
from pc2cad.export.kernel import census, check_read_back, subshapes
from pc2cad.geometry.carriers import SplineCurve
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

BEZIER = SplineCurve(
    2, np.array([0.0, 0, 0, 1, 1, 1]), np.array([[0.0, 0, 0], [1, 1, 0], [2, 0, 0]]), np.ones(3)
)


def test_the_curve_itself_is_good() -> None:
    assert to_kernel.curve(BEZIER)[0].IsKind("Geom_BSplineCurve")


@pytest.mark.parametrize("name", ["poles", "weights", "knots"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_do_not_reach_the_kernel(name: str, value: float) -> None:
    spoilt = getattr(BEZIER, name).copy()
    spoilt[1] = value
    with pytest.raises(KernelError, match="not finite"):
        to_kernel.curve(replace(BEZIER, **{name: spoilt}))


@pytest.mark.parametrize("weighted", [False, True])
def test_the_kernel_has_the_very_numbers_that_it_is_given(weighted: bool) -> None:
    rng = np.random.default_rng(3)
    poles, weights = rng.normal(size=(6, 5, 3)), rng.uniform(1.0, 2.0, (6, 5, 1))
    given = np.concatenate((poles, weights), axis=-1) if weighted else poles
    knots = np.array([0, 0, 0, 0, 0.3, 0.7, 1, 1, 1, 1]), np.array([2, 2, 2, 2.5, 2.5, 3, 3, 3.0])
    surface = spline_surface(given, knots, (3, 2))
    for found, wanted in zip(surface_numbers(surface), (given, *knots), strict=True):
        assert np.array_equal(found, wanted)
    curve = spline_curve(given[:, 0], knots[0], 3)
    for found, wanted in zip(curve_numbers(curve), (given[:, 0], knots[0]), strict=True):
        assert np.array_equal(found, wanted)
    for t in (0.0, 0.2, 0.3, 0.9):
        assert curve.Value(t).Distance(surface.Value(t, 2.0)) < 1e-14
    with pytest.raises(Standard_Failure, match="mismatch"):
        spline_surface(given[:5], knots, (3, 2))


def test_knots_that_nearly_coincide_do_not_reach_the_kernel() -> None:
    knots = np.array([0.0, 0, 0, 0.5, 0.5 + 1e-17 + 2e-16, 1, 1, 1])
    poles = np.linspace(0.0, 1.0, 15).reshape(5, 3)
    with pytest.raises(KernelError, match="nearer than"):
        to_kernel.curve(SplineCurve(2, knots, poles))


def refused(folder: Path, capsys: pytest.CaptureFixture[str], expected: int = 5) -> str:
    """Build the pyramid, which must fail with a code; return the sentence."""
    code = main(["build", "pyramid", "-o", str(folder / "p.step")])
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (expected, "", 1), err
    assert os.listdir(folder) == [], "nothing half-written"
    return err


def test_an_exception_of_the_kernel_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: Any, index: int) -> None:
        raise Standard_Failure("no edge today")

    monkeypatch.setattr(brep._Build, "_edge", fail)
    assert "the CAD kernel refused the boundary" in refused(tmp_path, capsys)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"valid": False}, "invalid"),
        ({"free_edges": 2}, "2 edges of the kernel's solid do not bound exactly two faces"),
        ({"shells": 2}, "where the equation has"),
        ({"faces": 3}, "where the equation has"),
        ({"euler": 0}, "where the equation has"),
        ({"largest_tolerance": 1e-3}, "raised a tolerance to 0.001"),
    ],
    ids=str,
)
def test_a_solid_that_is_not_what_was_asked_for_is_refused(
    change: dict[str, Any],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    inspect = validation.inspect
    monkeypatch.setattr(validation, "inspect", lambda *solid: replace(inspect(*solid), **change))
    assert words in refused(tmp_path, capsys)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("volume", lambda volume: -volume, "the solid's volume is -"),
        ("volume", lambda volume: 0.0, "the solid's volume is 0"),
        ("volume", lambda volume: float("nan"), "the solid's volume is nan"),
        ("area", lambda area: 1.001 * area, "the solid's area is"),
        ("centroid", lambda place: (place[0] + 0.01, *place[1:]), "centroid is 0.01 away"),
    ],
    ids=["inside out", "no volume", "no number", "area", "centroid"],
)
def test_a_solid_with_other_integrals_than_the_equation_is_refused(
    name: str,
    change: Any,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measure = validation.solid_integrals

    def spoilt(*solid: Any) -> Any:
        found = measure(*solid)
        return replace(found, **{name: change(getattr(found, name))})

    monkeypatch.setattr(validation, "solid_integrals", spoilt)
    # the equation is suspected first: an overlap looks like this
    assert words in refused(tmp_path, capsys, expected=3)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"faces": 5}, "reads back with 4 faces"), ({"tolerance": 1e-9}, "reads back with gaps")],
    ids=["faces", "tolerance"],
)
def test_a_file_that_reads_back_as_another_solid_is_refused(
    change: dict[str, Any], words: str
) -> None:
    part = compile_equation(read_template(template_paths()["pyramid"]).bind({})).exportable()
    (good,) = census(part)
    check_read_back(part.solid, [good], "STEP text")
    with pytest.raises(KernelError, match=words):
        check_read_back(part.solid, [replace(good, **change)], "STEP text")


def moved(solid: Any, by: float, scale: float = 1.0) -> Any:
    """Return a copy of a solid, scaled about the origin and then moved along x."""
    change = gp_Trsf()
    change.SetScale(gp_Pnt(0, 0, 0), scale)
    shift = gp_Trsf()
    shift.SetTranslation(gp_Vec(by, 0, 0))
    copy = BRepBuilderAPI_Transform(solid, shift.Multiplied(change), True).Shape()
    return subshapes(copy, TopAbs_ShapeEnum.TopAbs_SOLID)[0]


@pytest.mark.parametrize("name", ["pyramid", "channel_ellipse", "cone", "torus", "ball"])
def test_solids_are_the_same_by_their_numbers_alone(name: str) -> None:
    part = compile_equation(read_template(template_paths()[name]).bind({})).exportable()
    assert same_numbers(part.solid, moved(part.solid, 0.0))
    assert same_numbers(part.solid, moved(moved(part.solid, 0.5), -0.5))
    assert not same_numbers(part.solid, moved(part.solid, 1e-9))
    larger = moved(part.solid, 0.0, 1 + 1e-6)
    assert not same_numbers(part.solid, larger)
    with pytest.raises(KernelError, match="reads back with the volume"):
        check_read_back(larger, census(part), "STEP text")
    # another shape of the same volume in other numbers, as readers may make it
    check_read_back(moved(part.solid, 1e-9), census(part), "STEP text")


@pytest.mark.parametrize("name", ["pyramid", "channel_ellipse", "cone", "torus", "square_to_round"])
def test_the_kernels_question_which_side_is_out_has_its_answer(name: str) -> None:
    solid = compile_equation(read_template(template_paths()[name]).bind({})).exportable().solid
    for shape, inside in ((solid, False), (solid.Reversed(), True)):
        kernel = BRepClass3d_SolidClassifier(shape)
        kernel.PerformInfinitePoint(1e-7)
        assert (kernel.State() == TopAbs_State.TopAbs_IN) is inside
        assert inside_out(shape) is inside
