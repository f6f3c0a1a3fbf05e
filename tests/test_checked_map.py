"""Everything is made from the map that was checked, under one set of options."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pc2cad as pc
from pc2cad import compiler
from pc2cad.checked import Stages, check_map
from pc2cad.cli.main import main
from pc2cad.domain.jacobian_watch import FlatMapError, FoldedMapError
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError, NotASolidError, ToleranceNotReachedError
from pc2cad.options import CompileOptions
from pc2cad.part import Part

u, v, w = pc.parameters()
#: its upper side is no exact form
WAVY = (3 * u, v, w * (1 + pc.sin(9 * u) / 5))
COARSE = 1e-2


@pytest.fixture(scope="module")
def wavy() -> Part:
    return pc.compile_part(WAVY, tolerance=COARSE, name="wavy")


@pytest.mark.interop
def test_tetrahedra_are_of_the_parts_own_solid(wavy: Part) -> None:
    mesh = wavy.mesh(size=0.5, shape="tetrahedra")
    x, _, z = mesh.points[mesh.node_sets["w=1"]].T
    gap = np.abs(z - (1 + np.sin(3 * x) / 5)).max()
    # a solid of the default tolerance would be a hundred thousand times nearer
    assert 1e-3 * COARSE < gap <= wavy.report.deviation


def test_nothing_is_analysed_twice(wavy: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("analysed again")

    monkeypatch.setattr("pc2cad.domain.analysis.local_map", refuse)
    monkeypatch.setattr("pc2cad.checked.integrate", refuse)
    assert wavy.mesh(cells=(4, 1, 1)).volume() == pytest.approx(wavy.report.equation.volume, 0.05)
    assert wavy.splines(COARSE).volume() == pytest.approx(wavy.report.equation.volume, 1e-3)
    assert wavy.locate(wavy.sample(5, method="blue").points).inside.all()
    with pytest.raises(AssertionError, match="again"):
        pc.compile_part(WAVY)


@pytest.mark.parametrize("tolerance", [-1, 0, -1e-300, math.inf, math.nan, "thick", 10**400])
def test_a_tolerance_is_a_positive_length_wherever_it_is_asked(
    wavy: Part, tolerance: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiler, "check_map", None)  # it is refused before any work
    for make in (
        lambda: pc.spline_part(WAVY, tolerance=tolerance),
        lambda: pc.compile_part(WAVY, tolerance=tolerance),
        lambda: compiler.compile_equation(wavy.equation, tolerance),
        lambda: wavy.splines(tolerance),
    ):
        with pytest.raises(InputError, match="must be a positive length, not"):
            make()


def test_a_slender_part_has_the_same_default_tolerance_in_every_form() -> None:
    plate = (100 * u, 100 * v, w / 100 + pc.sin(u) * v)
    part = pc.compile_part(plate)
    assert part.report.tolerance < 0.01 * 1e-7 * part.report.size
    for model in (part.splines(), pc.spline_part(plate)):
        assert model.tolerance == pytest.approx(part.report.tolerance, rel=1e-9)


def test_what_double_precision_does_not_hold_is_refused_as_splines_too() -> None:
    for make in (pc.spline_part, pc.compile_part):
        with pytest.raises(ToleranceNotReachedError, match="double precision holds"):
            make(WAVY, tolerance=1e-16)


@pytest.mark.parametrize(("order", "evidence"), [(7, "exact"), (11, "exact"), (12, "bounded")])
def test_waves_are_exact_as_faces_and_as_volumes_up_to_one_order(order: int, evidence: str) -> None:
    """cos kθ times cos θ is of order k + 1; the limit is 12."""
    theta = 2 * pc.pi * u
    r = v * (2 + pc.cos(order * theta) / 20)
    part = pc.compile_part((r * pc.cos(theta), r * pc.sin(theta), w), tolerance=1e-3)
    model = part.splines(1e-3)
    assert (part.report.evidence, model.evidence) == (evidence, evidence)
    if evidence == "exact":
        assert model.deviation <= 1e-14
        assert model.volume() == pytest.approx(part.report.equation.volume, rel=1e-13)


def test_options_are_refused_where_they_clash() -> None:
    with pytest.raises(InputError, match="give one"):
        CompileOptions(degree=3, max_degree=5)
    with pytest.raises(InputError, match="in the cubic profile"):
        CompileOptions(degree=5, profile="cubic")
    with pytest.raises(InputError, match="choose one of"):
        CompileOptions(profile="quartic")


@pytest.mark.parametrize("verb", ["build", "check", "spline", "render", "view", "study", "mesh"])
def test_every_verb_that_makes_splines_takes_their_options(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endings = {
        "build": "p.step",
        "spline": "p.xml",
        "render": "p.png",
        "view": "p.html",
        "mesh": "p.vtu",
    }
    output = [] if verb == "check" else ["-o", str(tmp_path / endings.get(verb, "folder"))]
    vary = ["--vary", "p=0.2:0.4:2"] if verb == "study" else []
    code = main([verb, "pyramid_cut", "--degree", "3", "--max-degree", "5", *output, *vary])
    assert code == 2
    assert "give one" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_hexahedra_have_no_tolerance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = str(tmp_path / "p.vtu")
    assert main(["mesh", "pyramid_cut", "--tolerance", "0.1", "-o", output]) == 2
    assert "hexahedra are of the equation itself" in capsys.readouterr().err


def test_meshes_take_options_and_grading_from_python(
    wavy: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    growing = {"u": 4.0, "w": (9, "both")}
    meshes = [
        wavy.mesh(cells=(3, 1, 3), grading=growing),
        pc.mesh_part(WAVY, cells=(3, 1, 3), grading=growing),
    ]
    assert len(meshes) == 2
    for mesh in meshes:
        x, _, z = mesh.points.T
        # lengths grow steadily, four times along u, and nine times to the middle of w
        steps = 4 ** (np.arange(4) / 3) - 1
        np.testing.assert_allclose(np.unique(x.round(9)), steps, atol=1e-8)
        edge = (9 ** (2 / 3) - 1) / 16
        np.testing.assert_allclose(np.unique(z[x == 0].round(9)), [0, edge, 1 - edge, 1], atol=1e-8)
    asked = []
    monkeypatch.setattr(compiler, "require", lambda *_: None)
    monkeypatch.setattr(compiler, "check_map", lambda *given, **_: asked.append(given[1]) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        pc.mesh_part(WAVY, shape="tetrahedra", tolerance=0.5, degree=5)
    assert asked == [CompileOptions(0.5, 5)]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"grading": {"q": 2}}, "write u, v or w and a ratio"),
        ({"grading": {"u": (2, "ends")}}, "write u, v or w and a ratio"),
        ({"grading": {"u": "2"}}, "write u, v or w and a ratio"),
        ({"grading": {"u": 0}}, "between 1e-6 and 1e6, not 0"),
        ({"grading": {"u": math.nan}}, "between 1e-6 and 1e6, not nan"),
        ({"grading": {"u": 2}, "shape": "tetrahedra"}, "tetrahedra have one size of cells"),
        ({"tolerance": 0.1}, "hexahedra are of the equation itself"),
        ({"shape": "tetrahedra", "tolerance": -1}, "must be a positive length, not -1"),
    ],
)
def test_what_meshes_refuse_from_python(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        pc.mesh_part(WAVY, **given)


def test_cadquerys_functions_take_all_options() -> None:
    pcq = pytest.importorskip("pc2cad.cadquery")
    import cadquery as cq

    wanted: dict[str, Any] = {"tolerance": 1e-3, "profile": "cubic"}
    made = [
        pcq.point_solid(WAVY, **wanted).part,
        cq.Workplane().pointSolid(WAVY, **wanted).pointParts()[0],
    ]
    assert [part.report.tolerance for part in made] == [1e-3, 1e-3]
    for part in made:
        assert max(max(face.degrees, default=0) for face in part.report.faces) == 3
    for make in (pcq.point_solid, pcq.channel_solid, cq.Workplane().channelSolid):
        with pytest.raises(InputError, match="give one"):
            make("pyramid", degree=3, max_degree=5)


def test_stages_are_told_and_timed_in_order() -> None:
    told: list[str] = []
    stages = Stages(told.append)
    checked = check_map(point_equation(WAVY), stages=stages)
    assert told == ["sample", "orient", "analyse", "integrate", "solidity", "limits"]
    assert list(stages.times) == told
    of_faces = Stages()
    check_map(point_equation(WAVY), stages=of_faces, faces=True)
    assert list(of_faces.times) == told[:-1]  # det J is proved, the faces are to be
    assert checked.orientation.sign == 1
    assert check_map(point_equation((v, u, w))).orientation.axes == (1, 0, 2)


@pytest.mark.parametrize(
    ("equation", "error"),
    [((u, v, 0 * w), FlatMapError), ((u, v, w * (1 - 2 * u)), FoldedMapError)],
)
def test_a_map_without_orientation_is_refused_before_its_boundary_is_asked(
    equation: tuple[pc.Expr, ...], error: type[NotASolidError]
) -> None:
    told: list[str] = []
    with pytest.raises(error):
        check_map(point_equation(equation), stages=Stages(told.append))
    assert told[-1] == "orient"
