"""Trivariate splines: exact where they say so, and read by other libraries."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shipped import LONG, checked_of, every_template

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.cli.main import main
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.equation.point_equation import point_equation
from pc2cad.errors import InputError, NotASolidError
from pc2cad.export.patches import interfaces
from pc2cad.export.spline_files import write_splines
from pc2cad.geometry.splines.arcs import wave_in
from pc2cad.geometry.splines.trivariate import SplineVolume
from pc2cad.mesh.grid import closed_directions
from pc2cad.options import CompileOptions
from pc2cad.representation.deviation_proof import bound_volume
from pc2cad.representation.volume import VolumeModel, represent_volume
from pc2cad.sampling.interior import locate
from pc2cad.templates.file import read_template

TEMPLATES = sorted(Path(__file__).parent.parent.glob("templates/*.toml"))
#: no exact form along some direction
BOUNDED = {
    "aspheric_lens", "bellows", "channel_contour", "channel_ellipse", "channel_sine", "coil",
    "disc_cam", "figure_of_eight", "gear_tooth", "gerotor", "helical_channel",
    "simplex_hyperboloid", "spring", "square_to_round", "stellarator_wall", "trefoil",
}  # fmt: skip
#: polynomial along no parameter, with pieces along two
SAMPLED = {"propeller_blade"}
Array = NDArray[np.float64]
u, v, w = pc.parameters()


def truth(checked: CheckedMap, model: VolumeModel, patch: int, places: Array) -> Array:
    """Return M at spline parameters of a patch, straight from the equation."""
    found = model.patches[patch]
    columns: list[Array] = [np.empty(0)] * 3
    for k, d in enumerate(model.directions):
        low, high = checked.analysis.span(d, found.cell[d])
        columns[d] = low + (high - low) * found.volume.axes[k].places(places[:, k])
    return checked.map.points(*columns)


@cache
def volume_of(name: str) -> VolumeModel:
    return represent_volume(checked_of(name))


@every_template
def test_volumes_of_splines_are_the_equations(path: Path) -> None:
    checked, model = checked_of(path.stem), volume_of(path.stem)
    exact = checked.mass.volume
    if path.stem in SAMPLED:
        assert model.evidence == "sampled"
        assert model.deviation <= model.tolerance
        assert model.volume() == pytest.approx(exact, rel=1e-7)
    elif path.stem in BOUNDED:
        assert model.evidence == "bounded"
        assert all(0 < patch.sampled <= patch.deviation for patch in model.patches)
        assert model.deviation <= model.tolerance
        assert model.volume() == pytest.approx(exact, rel=1e-7)
    else:
        assert model.evidence == "exact"
        assert model.deviation <= 1e-14 * (checked.scale.size + checked.scale.magnitude)
        assert model.volume() == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("name", sorted(BOUNDED - set(LONG)))
def test_a_bound_holds_everywhere_and_notices_what_is_amiss(name: str) -> None:
    checked, model = checked_of(name), volume_of(name)
    (patch,) = model.patches
    places = np.random.default_rng(1).random((500, 3))
    found = np.array([patch.volume(*place[:, None])[0, 0, 0] for place in places])
    gap = np.linalg.norm(found - truth(checked, model, 0, places), axis=1).max()
    assert 0.1 * patch.deviation < gap <= patch.deviation
    # one pole moved so that the volume moves by four times the bound is seen, wherever it is
    index = tuple(n // 2 for n in patch.volume.poles.shape[:2])

    def with_pole_moved(by: float) -> SplineVolume:
        poles = patch.volume.poles.copy()
        poles[index][-1, 0] += by
        return replace(patch.volume, poles=poles)

    unit = with_pole_moved(1.0)
    share = max(
        np.linalg.norm(unit(*place[:, None])[0, 0, 0] - before)
        for place, before in zip(places, found, strict=True)
    )
    assert 0.02 < share < 1
    spoilt = with_pole_moved(4 * patch.deviation / share)
    bound = bound_volume(RestrictedMap(checked.analysis, patch.cell), spoilt, model.directions)
    assert bound is not None
    assert bound.largest > 2 * patch.deviation


BENT = (pc.exp(u) * (2 + pc.sin(v * w)), v + pc.exp(v) + w / 9, w * pc.exp(u * w / 3 + v))
_OUT = 3 + v + pc.sin(v * w) / 3
TURNED = (_OUT * pc.cos(2 * pc.pi * u), _OUT * pc.sin(2 * pc.pi * u), w + pc.exp(v * w) / 5)


@pytest.mark.parametrize(
    ("coordinates", "factor"),
    [
        (BENT, 1e-3),
        pytest.param(BENT, 1e4, marks=pytest.mark.slow),
        pytest.param(TURNED, 1.0, marks=pytest.mark.slow),
    ],
    ids=["small", "large", "turned"],
)
def test_what_is_a_polynomial_along_no_direction_is_bounded_by_its_slices(
    coordinates: tuple[pc.Expr, ...], factor: float
) -> None:
    scaled = tuple(factor * x for x in coordinates)
    checked = check_map(point_equation(scaled, name="part"))
    model = represent_volume(checked, CompileOptions(1e-4 * factor))
    assert model.evidence == "bounded"
    assert model.rational == (coordinates is TURNED)
    (patch,) = model.patches
    assert 0 < patch.sampled < patch.deviation <= min(2.5 * patch.sampled, 1e-4 * factor)
    places = np.random.default_rng(1).random((500, 3))
    found = np.array([patch.volume(*place[:, None])[0, 0, 0] for place in places])
    gap = np.linalg.norm(found - truth(checked, model, 0, places), axis=1).max()
    assert 0.1 * patch.deviation < gap <= patch.deviation
    # one pole moved, wherever it is, is seen
    poles = patch.volume.poles.copy()
    poles[tuple(n // 2 for n in poles.shape[:3])][0] += 100 * patch.deviation
    spoilt = replace(patch.volume, poles=poles)
    bound = bound_volume(RestrictedMap(checked.analysis, patch.cell), spoilt, model.directions)
    assert bound is not None
    assert bound.largest > 2 * patch.deviation


def test_exact_splines_are_as_small_as_they_can_be() -> None:
    degrees = {
        name: volume_of(name).patches[0].volume
        for name in ("pyramid", "triquadratic_cube", "hollow_cylinder", "torus")
    }
    assert degrees["pyramid"].degrees == (1, 1, 1)
    assert degrees["triquadratic_cube"].degrees == (2, 2, 2)
    assert degrees["hollow_cylinder"].poles.shape == (2, 9, 2, 3)
    # a full turn is four quarter arcs of degree 2
    assert sorted(degrees["torus"].poles.shape) == [2, 3, 9, 9]
    assert degrees["torus"].weights is not None


def test_waves_are_found_with_their_angle_and_order() -> None:
    t = 2 * pc.pi * u
    assert wave_in((pc.sin(t) * pc.cos(t) + v, v), "u").order == 2  # type: ignore[union-attr]
    wave = wave_in((pc.cos(3 * t), pc.sin(2 * t)), "u")
    assert wave is not None
    assert (wave.order, wave.extent) == (3, pytest.approx(2 * np.pi))
    assert wave_in((pc.cos(t) * u, v), "u") is None
    assert wave_in((pc.sqrt(2 + pc.cos(t)), v), "u") is None
    assert wave_in((pc.cos(t) + pc.cos(pc.e * t), v), "u") is None
    assert wave_in((pc.cos(u * v), v), "u") is None
    assert wave_in((pc.cos(t) / (1 + pc.sin(t)), v), "u") is None


def test_the_cubic_profile_has_neither_weights_nor_high_degrees() -> None:
    checked = checked_of("hollow_ball")
    model = represent_volume(checked, CompileOptions(1e-4, profile="cubic"))
    assert not model.rational
    assert max(model.patches[0].volume.degrees) <= 3
    assert model.evidence == "bounded"
    assert model.deviation <= 1e-4


def test_creases_part_patches_which_are_joined_in_order() -> None:
    corners = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
    x, y = pc.polygon(corners, v)
    shape = (0.5 + (x - 0.5) * u, 0.5 + (y - 0.5) * u, 2 * w)
    model = pc.spline_part(shape, name="angle")
    assert model.pieces == (1, 6, 1)
    assert len(model.patches) == 6
    assert model.volume() == pytest.approx(8.0, rel=1e-13)
    joined = interfaces(model)
    assert {frozenset((i.first, i.second)) for i in joined} == {
        frozenset((k, (k + 1) % 6)) for k in range(6)
    }


# -- files in other libraries ----------------------------------------------------------------------

QUICK = {"hollow_ball", "triquadratic_cube", "turned_ring", "pyramid_cut"}
#: the wall of a stellarator takes a minute and more, and shows nothing that others do not
FILES = [
    pytest.param(path.stem, marks=[] if path.stem in QUICK else [pytest.mark.slow])
    for path in TEMPLATES
    if path.stem != "stellarator_wall"
]


@pytest.mark.interop
@pytest.mark.parametrize("name", FILES)
def test_files_are_evaluated_elsewhere_at_a_thousand_points(tmp_path: Path, name: str) -> None:
    splinepy = pytest.importorskip("splinepy")
    from splipy.io import G2

    checked, model = checked_of(name), volume_of(name)
    allowed = model.deviation + 1e-14 * (checked.scale.size + checked.scale.magnitude)
    for ending in (".xml", ".itd", ".g2"):
        write_splines(model, tmp_path / f"part{ending}")
    irit = splinepy.io.load(str(tmp_path / "part.itd"))
    gismo = splinepy.io.gismo.load(str(tmp_path / "part.xml"))[0].patches
    with G2(str(tmp_path / "part.g2")) as file:
        gotools = file.read()
    assert len(irit) == len(gismo) == len(gotools) == len(model.patches)
    count = -(-1000 // len(model.patches))
    random = np.random.default_rng(7)
    for patch in range(len(model.patches)):
        places = random.random((count, 3))
        expected = truth(checked, model, patch, places)
        volume = gotools[patch]
        found = {
            ".itd": irit[patch].evaluate(places),
            ".xml": gismo[patch].evaluate(places),
            ".g2": np.array([volume(*place) for place in places]),
        }
        for ending, points in found.items():
            gap = np.sqrt(((points - expected) ** 2).sum(axis=1)).max()
            assert gap <= allowed, ending


@pytest.mark.interop
@pytest.mark.parametrize("name", FILES)
def test_mfem_evaluates_its_file_at_a_thousand_points(tmp_path: Path, name: str) -> None:
    mfem = pytest.importorskip("mfem.ser")
    checked, model = checked_of(name), volume_of(name)
    path = tmp_path / "part.mesh"
    write_splines(model, path)
    mesh = mfem.Mesh(str(path), 1, 1)
    assert not any(mesh.GetElement(k).GetNVertices() != 8 for k in range(mesh.GetNE()))
    closed = [
        axis for axis, d in enumerate(model.directions) if d in closed_directions(checked.analysis)
    ]
    open_sides = {2 * axis + side for axis in range(3) if axis not in closed for side in (1, 2)}
    assert {mesh.GetBdrAttribute(k) for k in range(mesh.GetNBE())} == open_sides
    random = np.random.default_rng(3)
    node, points = mfem.IntegrationPoint(), []
    for element in random.integers(mesh.GetNE(), size=1000):
        node.Set3(*random.random(3))
        transformation = mesh.GetElementTransformation(int(element))
        points.append(np.array(transformation.Transform(node)))
        transformation.SetIntPoint(node)
        assert transformation.Weight() >= -1e-12 * checked.scale.size**3
    # every point of the file's solid is a point of the equation's, to the stated deviation
    found = locate(checked, points)
    allowed = model.deviation + 1e-13 * (checked.scale.size + checked.scale.magnitude)
    assert found.distance.max() <= max(allowed, 1e-12 * checked.scale.size)
    measures = sum(_volume(mfem, mesh, k) for k in range(mesh.GetNE()))
    assert measures == pytest.approx(checked.mass.volume, rel=1e-7)


def _volume(mfem, mesh, element: int) -> float:  # type: ignore[no-untyped-def]
    transformation = mesh.GetElementTransformation(element)
    rule = mfem.IntRules.Get(mfem.Geometry.CUBE, 24 if mesh.GetNE() < 50 else 15)
    total = 0.0
    for k in range(rule.GetNPoints()):
        node = rule.IntPoint(k)
        transformation.SetIntPoint(node)
        total += node.weight * transformation.Weight()
    return total


def test_parts_of_a_volume_are_the_volume() -> None:
    volume = volume_of("torus").patches[0].volume
    for axis, count in ((0, 3), (1, 4), (2, 2)):
        parts = volume.split(axis, count)
        assert len(parts) == count
        assert sum(part.volume() for part in parts) == pytest.approx(volume.volume(), rel=1e-13)
    third = volume.split(0, 3)[1]
    places = [np.linspace(0, 1, 5)] * 3
    cuts = volume.axes[0].space.points
    low, high = cuts[1], cuts[3]
    assert third(*places) == pytest.approx(
        volume(low + (high - low) * places[0], places[1], places[2]), abs=1e-12
    )


@pytest.mark.interop
def test_gismo_reads_patches_glued_sides_and_boundaries(tmp_path: Path) -> None:
    pygismo = pytest.importorskip("pygismo")
    found = {}
    for name in ("turned_ring", "triquadratic_cube"):
        path = tmp_path / f"{name}.xml"
        write_splines(volume_of(name), path)
        patches = pygismo.core.gsMultiPatch()
        pygismo.io.gsFileData(str(path)).getFirst(patches)
        found[name] = (patches.nPatches(), len(patches.boundaries()), len(patches.interfaces()))
    assert found == {"turned_ring": (1, 4, 1), "triquadratic_cube": (1, 6, 0)}


@pytest.mark.interop
def test_mfem_joins_the_patches_of_a_closed_polygon(tmp_path: Path) -> None:
    mfem = pytest.importorskip("mfem.ser")
    x, y = pc.polygon([(0, 0), (3, 0), (3, 2), (0, 2)], v)
    tube = (1.5 + (x - 1.5) * (1 + u), 1 + (y - 1) * (1 + u), 2 * w)
    model = pc.spline_part(tube, name="tube")
    write_splines(model, tmp_path / "tube.mesh")
    mesh = mfem.Mesh(str(tmp_path / "tube.mesh"), 1, 1)
    assert (mesh.GetNE(), mesh.GetNV(), mesh.GetNBE()) == (4, 16, 16)
    assert sum(mesh.GetElementVolume(k) for k in range(4)) == pytest.approx(36.0, rel=1e-12)


@pytest.mark.interop
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_mfem_joins_what_closes_with_a_turn(tmp_path: Path, quarters: int) -> None:
    mfem = pytest.importorskip("mfem.ser")
    path = next(path for path in TEMPLATES if path.stem == "turned_ring")
    checked = check_map(read_template(path).bind({"quarters": quarters}))
    # three quarters of a turn are exact with the degree 14, which MFEM does not hold
    options = CompileOptions(1e-3, profile="cubic" if quarters == 3 else "compact")
    write_splines(represent_volume(checked, options), tmp_path / "ring.mesh")
    mesh = mfem.Mesh(str(tmp_path / "ring.mesh"), 1, 1)
    # the halves of the square run towards its middle, and meet their like: 9 vertices per section
    sections = mesh.GetNE() // 4
    assert (mesh.GetNE(), mesh.GetNV(), mesh.GetNBE()) == (4 * sections, 9 * sections, 8 * sections)
    assert {mesh.GetBdrAttribute(k) for k in range(mesh.GetNBE())} == {1, 2, 5, 6}
    volume = sum(_volume(mfem, mesh, k) for k in range(mesh.GetNE()))
    assert volume == pytest.approx(checked.mass.volume, rel=1e-6)


def test_degrees_that_mfem_does_not_hold_are_refused(tmp_path: Path) -> None:
    path = next(path for path in TEMPLATES if path.stem == "turned_ring")
    checked = check_map(read_template(path).bind({"quarters": 3}))
    with pytest.raises(InputError, match=r"the degree 1\d, and MFEM holds 10 .* --profile cubic"):
        write_splines(represent_volume(checked, CompileOptions(1e-3)), tmp_path / "ring.mesh")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.interop
def test_mfem_joins_pieces_that_a_turn_shifts(tmp_path: Path) -> None:
    mfem = pytest.importorskip("mfem.ser")
    x, y = pc.polygon([(1, 0), (0, 1), (-1, 0), (0, -1)], v)
    theta, beta, out = 2 * pc.pi * u, pc.pi * u / 2, (1 + w) / 2
    across = 4 + out * (x * pc.cos(beta) - y * pc.sin(beta))
    up = out * (x * pc.sin(beta) + y * pc.cos(beta))
    ring = point_equation((across * pc.cos(theta), across * pc.sin(theta), up), name="ring")
    checked = check_map(ring)
    write_splines(represent_volume(checked, CompileOptions(1e-3)), tmp_path / "ring.mesh")
    mesh = mfem.Mesh(str(tmp_path / "ring.mesh"), 1, 1)
    sections = mesh.GetNE() // 4
    assert (mesh.GetNE(), mesh.GetNV(), mesh.GetNBE()) == (4 * sections, 8 * sections, 8 * sections)
    volume = sum(_volume(mfem, mesh, k) for k in range(mesh.GetNE()))
    assert volume == pytest.approx(checked.mass.volume, rel=1e-6)


def test_python_and_the_verb_write_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "ball.g2"
    assert main(["spline", "hollow_ball", "-o", str(out)]) == 0
    assert "1 rational patch, exact" in capsys.readouterr().out
    other = tmp_path / "same.g2"
    pc.write_splines(volume_of("hollow_ball"), other)
    assert out.read_bytes() == other.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "x.step"], "use one of .xml"),
        (["-o", "x.g2", "-o", "./x.g2"], "same file"),
        (["-o", "x.g2", "--tolerance", "0"], "positive length"),
    ],
)
def test_the_verb_refuses_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["spline", "ball", *arguments]) == InputError.exit_code
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_map_that_folds_has_no_splines() -> None:
    with pytest.raises(NotASolidError):
        pc.spline_part((u * u - u / 2, v, w), name="folded")
