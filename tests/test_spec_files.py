"""Every shipped template as a file: what readers that share nothing with the writer find in it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from consumers.fresh_kernel import read_in_fresh_process
from consumers.step_file import StepSolid, check_step
from shipped import part_of

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.export.model import ExportOptions
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import template_paths

#: template -> exact volume and area of its defaults (points P1 and G1), faces, edges, vertices
SOLIDS = {
    "pyramid": (63 / 2, 72.4910591854677, 4, 6, 4),
    "pyramid_truncated": (441 / 16, 62.7572752568821, 5, 9, 6),
    "pyramid_cut": (1827 / 64, 65.2796013488524, 5, 9, 6),
    "pyramid_cut_off": (189 / 64, 18.5549926141880, 4, 6, 4),
    "pyramid_sum": (1827 / 64, 65.2796013488524, 5, 9, 6),
    "channel_ellipse": (77.074041557967, 419.36053163579, 4, 6, 4),
    "channel_sine": (75.845394697557, 636.3841331629, 4, 6, 4),
    "channel_contour": (72.7442151959, 496.58218045264, 4, 6, 4),
}
every_template = pytest.mark.parametrize("template", SOLIDS)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("files")


def step_of(template: str, folder: Path, options: ExportOptions | None = None) -> Path:
    schema = options.step_schema if options else "default"
    path = folder / f"{template}_{schema}.step"
    if not path.exists():
        part_of(template).write(path, options=options)
    return path


def is_exact(template: str) -> bool:
    return template.startswith("pyramid")


def test_every_template_of_the_table_is_shipped():
    assert set(SOLIDS) <= set(template_paths())


# -- STEP ------------------------------------------------------------------------------------------


@every_template
def test_step_without_a_kernel(template, folder):
    volume, area, faces, edges, vertices = SOLIDS[template]
    part, found = part_of(template), check_step(step_of(template, folder))
    own, true = (1e-12, 1e-12) if is_exact(template) else (1e-9, 1e-7)
    assert found.volume == pytest.approx(part.report.solid.volume, rel=own)
    assert found.area == pytest.approx(part.report.solid.area, rel=own)
    assert found.volume == pytest.approx(volume, rel=true)
    assert found.area == pytest.approx(area, rel=true)
    assert found.shells == 1
    assert (len(found.faces), found.edges, found.vertices) == (faces, edges, vertices)
    assert {face.name for face in found.faces} == set(part.faces)
    assert_carriers(template, found)


def assert_carriers(template: str, found: StepSolid) -> None:
    carriers = {face.name: face.carrier for face in found.faces}
    planes = {name for name, carrier in carriers.items() if carrier == "PLANE"}
    assert planes == (set(carriers) if is_exact(template) else {"u=0", "u=1"})


@every_template
def test_step_states_the_equations_figures(template, folder):
    volume, area, *_ = SOLIDS[template]
    stated = check_step(step_of(template, folder)).properties
    assert stated.volume == pytest.approx(volume, rel=2e-12)
    assert stated.area == pytest.approx(area, rel=2e-12)
    centroid = part_of(template).report.equation.centroid
    assert stated.centroid == pytest.approx(centroid, abs=1e-12 * part_of(template).report.size)


@pytest.mark.parametrize("template", ["pyramid_cut", "channel_sine"])
def test_step_in_the_older_protocol(template, folder):
    path = step_of(template, folder, ExportOptions(step_schema="AP214"))
    volume, *_ = SOLIDS[template]
    assert check_step(path).volume == pytest.approx(volume, rel=1e-7)


@every_template
def test_step_in_a_fresh_process(template, folder):
    volume, area, faces, edges, vertices = SOLIDS[template]
    found = read_in_fresh_process(step_of(template, folder))
    assert (found["shape_type"], found["valid"], found["free_edges"]) == ("SOLID", True, 0)
    counts = [found[name] for name in ("solids", "shells", "faces", "edges", "vertices")]
    assert counts == [1, 1, faces, edges, vertices]
    tolerance = 0.0 if is_exact(template) else part_of(template).report.tolerance
    for kind in ("vertex", "edge", "face"):
        assert found[f"max_{kind}_tolerance"] <= max(1e-7 * 1.001, tolerance)
    # with spline faces the kernel's own integral is good to 2e-8
    own, true = (1e-12, 1e-12) if is_exact(template) else (2e-8, 1e-7)
    assert found["volume"] == pytest.approx(part_of(template).report.solid.volume, rel=own)
    assert found["volume"] == pytest.approx(volume, rel=true)
    assert found["area"] == pytest.approx(area, rel=true)


DEGENERATE = {
    "1 1/2 0": (63 / 2, 5, 8, 5),
    "0 0 0": (63 / 2, 4, 6, 4),
    "1 1 1/2": (63 / 4, 4, 6, 4),
    "1 1/2 1/2": (189 / 8, 5, 8, 5),
}


@pytest.mark.parametrize("cut", DEGENERATE)
def test_step_of_degenerate_cuts(cut, tmp_path):
    volume, *counts = DEGENERATE[cut]
    template = pc.read_template(template_paths()["pyramid_cut"])
    part = compile_equation(template.bind(dict(zip("pqr", cut.split(), strict=True))))
    path = tmp_path / "cut.step"
    part.write(path)
    found = check_step(path)
    assert found.volume == pytest.approx(volume, rel=1e-12)
    assert [len(found.faces), found.edges, found.vertices] == counts
    fresh = read_in_fresh_process(path)
    assert (fresh["valid"], fresh["free_edges"], fresh["solids"]) == (True, 0, 1)
    assert [fresh[name] for name in ("faces", "edges", "vertices")] == counts
    assert fresh["volume"] == pytest.approx(volume, rel=1e-12)
    assert max(fresh[f"max_{kind}_tolerance"] for kind in ("vertex", "edge")) <= 1e-7 * 1.001


@pytest.mark.parametrize(("units", "in_mm"), [("cm", 10.0), ("m", 1000.0), ("in", 25.4)])
def test_step_in_other_units(units, in_mm, tmp_path):
    text = template_paths()["pyramid_cut"].read_text(encoding="utf-8")
    part = compile_equation(parse_template(f'units = "{units}"\n{text}', "cut").bind())
    path = tmp_path / "part.step"
    part.write(path)
    found = check_step(path)
    assert found.unit_m == pytest.approx(in_mm / 1000, rel=1e-15)
    assert found.volume_mm3 == pytest.approx(1827 / 64 * in_mm**3, rel=1e-12)
    fresh = read_in_fresh_process(path)
    assert (fresh["valid"], fresh["faces"], fresh["edges"], fresh["vertices"]) == (True, 5, 9, 6)
    assert fresh["volume"] == pytest.approx(1827 / 64 * in_mm**3, rel=1e-12)


@every_template
def test_step_has_the_same_bytes_each_time(template, tmp_path):
    options = ExportOptions(timestamp="2026-01-31T12:00:00Z")
    for name in ("one.step", "two.step"):
        part_of(template).write(tmp_path / name, options=options)
    assert (tmp_path / "one.step").read_bytes() == (tmp_path / "two.step").read_bytes()


# -- STL -------------------------------------------------------------------------------------------


def triangles(path: Path) -> np.ndarray:
    """Corners in single precision as in the file, (m, 3, 3)."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count
    record = np.dtype([("floats", "<f4", (4, 3)), ("attribute", "<u2")])
    return np.frombuffer(data[84:], dtype=record)["floats"][:, 1:]


def assert_watertight(corners: np.ndarray) -> None:
    """Every directed edge is used once, and so is its reverse."""
    _, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    walks = index.reshape(-1, 3)
    edges = Counter(edge for a, b, c in walks.tolist() for edge in ((a, b), (b, c), (c, a)))
    assert set(edges.values()) == {1}
    assert all(a != b and (b, a) in edges for a, b in edges)


def enclosed(corners: np.ndarray) -> float:
    exact = corners.astype(float)
    return float(np.linalg.det(exact - exact.mean(axis=(0, 1))).sum() / 6)


@every_template
def test_stl_is_watertight_and_holds_the_volume(template, tmp_path):
    volume, *_ = SOLIDS[template]
    path = tmp_path / "part.stl"
    part_of(template).write(path)
    corners = triangles(path)
    assert_watertight(corners)
    assert enclosed(corners) == pytest.approx(volume, rel=1e-6 if is_exact(template) else 1e-2)


@pytest.mark.parametrize("template", ["channel_ellipse", "channel_contour"])
def test_a_finer_stl_holds_more_of_the_volume(template, tmp_path):
    volume, *_ = SOLIDS[template]
    errors = []
    for deflection in (0.1, 0.03, 0.01):
        path = tmp_path / "part.stl"
        options = ExportOptions(deflection=deflection, angular_deflection=1.0)
        part_of(template).write(path, options=options)
        corners = triangles(path)
        assert_watertight(corners)
        errors.append(abs(enclosed(corners) / volume - 1))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 3e-3
