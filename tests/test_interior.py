"""Samples of the interior and M inverted, against shapes whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import vtk
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import kstest
from shipped import checked_of, every_template

import pc2cad as pc
from pc2cad.checked import check_map
from pc2cad.cli.main import main
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError
from pc2cad.export.point_files import write_points
from pc2cad.sampling.interior import locate, sample_blue, sample_grid, sample_uniform

TEMPLATES = sorted(Path(__file__).parent.parent.glob("templates/*.toml"))
u, v, w = pc.parameters()


@every_template
def test_samples_have_the_centroid_and_are_found_inside(path: Path) -> None:
    checked = checked_of(path.stem)
    points = sample_uniform(checked, 4000, seed=5)
    spread = points.points.std(axis=0) / np.sqrt(4000)
    gap = points.points.mean(axis=0) - checked.mass.centroid
    assert (np.abs(gap) < 4.5 * spread).all()
    found = locate(checked, points.points[:1500])
    assert found.inside.all()
    assert found.distance.max() <= 1e-10 * checked.scale.size


def test_the_radius_of_uniform_points_of_a_ball_has_its_distribution() -> None:
    points = sample_uniform(checked_of("ball"), 20_000, seed=1).points
    radius = np.sqrt((points**2).sum(axis=1))
    top = radius.max()
    assert top == pytest.approx(2.0, abs=1e-3)
    assert kstest((radius / 2.0) ** 3, "uniform").pvalue > 1e-3
    assert kstest((points[:, 2] / radius + 1) / 2, "uniform").pvalue > 1e-3


def test_blue_noise_keeps_its_distance_and_fills() -> None:
    checked = checked_of("torus")
    points = sample_blue(checked, 400, seed=2)
    assert len(points.points) == 400
    nearest = cKDTree(points.points).query(points.points, k=2)[0][:, 1]
    assert nearest.min() >= points.spacing
    # random points of this density would come as near as a tenth of this
    assert points.spacing > 0.7 * np.cbrt(checked.mass.volume / 400)


def test_samples_depend_on_the_seed_alone() -> None:
    checked = checked_of("pyramid")
    first, same, other = (sample_uniform(checked, 50, seed).points for seed in (3, 3, 4))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_a_lattice_has_the_points_that_lie_inside() -> None:
    points = sample_grid(checked_of("ball"), 0.25).points
    axis = np.arange(-8, 9) * 0.25
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = lattice[(lattice**2).sum(axis=1) <= 4.0 + 1e-12]
    assert {tuple(p) for p in np.round(points, 9)} == {tuple(p) for p in np.round(inside, 9)}


# -- inversion -------------------------------------------------------------------------------------


def test_points_about_a_hollow_ball_are_told_by_their_radius() -> None:
    checked = checked_of("hollow_ball")
    low, high = 1.0, 2.0  # r, and r + wall
    random = np.random.default_rng(8)
    points = random.uniform(-1.3 * high, 1.3 * high, (3000, 3))
    radius = np.sqrt((points**2).sum(axis=1))
    found = locate(checked, points)
    assert np.array_equal(found.inside, (radius >= low) & (radius <= high))
    exact = np.maximum(0, np.maximum(low - radius, radius - high))
    assert found.distance == pytest.approx(exact, abs=1e-10)


def test_u_v_w_are_the_equations_own() -> None:
    equation = point_equation((u + v * v / 4, v, w * (1 + u / 2)), {"u": (2, 5), "v": (-1, 1)})
    checked = check_map(equation)
    random = np.random.default_rng(2)
    own = np.stack([random.uniform(2, 5, 500), random.uniform(-1, 1, 500), random.random(500)], 1)
    a, b, c = own.T
    points = np.stack([a + b * b / 4, b, c * (1 + a / 2)], axis=1)
    found = locate(checked, points)
    assert found.inside.all()
    assert found.parameters == pytest.approx(own, abs=1e-8)
    assert found.nearest == pytest.approx(points, abs=1e-8)


def test_axes_poles_and_centres_are_inside() -> None:
    ball = locate(checked_of("ball"), [[0, 0, 0], [0, 0, 1.5], [0, 0, -2], [0, 0, 2.01]])
    assert ball.inside.tolist() == [True, True, True, False]
    assert ball.distance[3] == pytest.approx(0.01, abs=1e-9)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(0.02, 0.98)] * 3), st.floats(1e-3, 1.0))
def test_a_point_pushed_out_of_a_channel_is_outside_by_that_much(
    place: tuple[float, float, float], share: float
) -> None:
    checked = _CHANNEL
    first, second, _ = place
    edge = checked.map.points(first, second, 1.0)
    a, b, c = checked.map.tangents((0, 1, 2), first, second, 1.0)
    normal = np.cross(a, b)
    normal *= np.sign(normal @ c) / np.linalg.norm(normal)
    step = share * 0.05
    found = locate(checked, [edge + step * normal, edge - 0.01 * normal])
    assert found.inside.tolist() == [False, True]
    assert found.distance[0] == pytest.approx(step, rel=1e-6)


_CHANNEL = checked_of("channel_ellipse")


@pytest.mark.parametrize("factor", [1e-5, 1e5])
def test_scale_does_not_matter(factor: float) -> None:
    angle = 2 * pc.pi * u
    radius = factor * (1 + w)
    tube = point_equation((radius * pc.cos(angle), radius * pc.sin(angle), factor * v))
    checked = check_map(tube)
    points = factor * np.array([[1.5, 0, 0.5], [0.5, 0, 0.5], [-1.2, 0.9, 0.1], [0, 2.1, 0.5]])
    found = locate(checked, points)
    assert found.inside.tolist() == [True, False, True, False]
    assert found.distance / factor == pytest.approx([0, 0.5, 0, 0.1], abs=1e-8)


# -- files and the verb ----------------------------------------------------------------------------


def test_files_hold_points_and_parameters(tmp_path: Path) -> None:
    points = sample_uniform(checked_of("torus"), 37)
    for ending in (".ply", ".npz", ".vtp"):
        write_points(points, tmp_path / f"p{ending}")
    with np.load(tmp_path / "p.npz") as archive:
        assert np.array_equal(archive["points"], points.points)
        assert np.array_equal(archive["parameters"], points.parameters)
    for ending, kind in ((".ply", "vtkPLYReader"), (".vtp", "vtkXMLPolyDataReader")):
        reader = getattr(vtk, kind)()
        reader.SetFileName(str(tmp_path / f"p{ending}"))
        reader.Update()
        data = reader.GetOutput()
        assert data.GetNumberOfPoints() == 37
        # VTK reads PLY in single precision
        close = 1e-6 if ending == ".ply" else 0.0
        assert data.GetPoint(11) == pytest.approx(tuple(points.points[11]), rel=close, abs=close)
        if ending == ".vtp":
            values = data.GetPointData().GetArray("uvw").GetTuple(11)
            assert values == tuple(points.parameters[11])
    raw = (tmp_path / "p.ply").read_bytes().partition(b"end_header\n")[2]
    rows = np.frombuffer(raw).reshape(37, 6)
    assert np.array_equal(rows, np.hstack((points.points, points.parameters)))


def test_the_verb_says_how_many_and_how_far_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "p.npz")
    assert main(["points", "pyramid", "--count", "40", "--method", "blue", "-o", out]) == 0
    assert "40 points, at least" in capsys.readouterr().out
    assert main(["points", "pyramid", "--spacing", "1", "--method", "grid", "-o", out]) == 0
    with np.load(out) as archive:
        assert (archive["points"] == np.rint(archive["points"])).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "x.stl"], "use one of .ply"),
        (["-o", "x.ply", "--count", "0"], "from 1 to"),
        (["-o", "x.ply", "--method", "grid"], "needs a --spacing"),
        (["-o", "x.ply", "--method", "grid", "--count", "5"], "a grid has"),
        (["-o", "x.ply", "--spacing", "1"], "a grid has"),
        (["-o", "x.ply", "--seed", "-1"], "negative"),
    ],
)
def test_the_verb_refuses_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["points", "pyramid", *arguments]) == InputError.exit_code
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
