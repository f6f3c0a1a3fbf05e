"""Every template in the programs that people open it with, and that each can find a fault.

Volumes agree to 1e-9 where they are read exactly: by the kernel-free reader on every template, by
the others on plane faces. On others a program's own quadrature is good to 1e-3 only, as the
kernel's plain rule is everywhere (FreeCAD is 2e-4 off on the contour channel), and to 2e-2 on
rational ones (9e-3 on the ellipsoid).
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from consumers.editor_window import installed as cq_editor_installed
from consumers.editor_window import render_in_cq_editor
from consumers.freecad_reader import freecad, read_in_freecad
from consumers.netgen_reader import read_in_netgen
from consumers.step_file import check_step

import pc2cad as pc
from pc2cad.library import template_paths
from pc2cad.part import Part

pytestmark = pytest.mark.interop

TEMPLATES = list(template_paths())
#: reading of volumes by a program's own quadrature, on curved faces and on rational ones
OWN, OWN_RATIONAL = 1e-3, 2e-2


def needs(tool: object, name: str):
    return pytest.mark.skipif(not tool, reason=f"{name} is not installed")


@cache
def part_of(template: str) -> Part:
    return pc.compile_equation(pc.read_template(template_paths()[template]).bind())


def in_mm3(part: Part) -> float:
    return (
        part.report.solid.volume
        * {"mm": 1.0, "cm": 1e3, "m": 1e9, "in": 25.4**3}[part.report.units]
    )


def agreement(part: Part) -> float:
    carriers = {face.carrier for face in part.report.faces}
    if any("rational" in carrier for carrier in carriers):
        return OWN_RATIONAL
    return 1e-9 if carriers == {"plane"} else OWN


@pytest.fixture(scope="session")
def files(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    for template in TEMPLATES:
        for ending in (".step", ".stl"):
            part_of(template).write(folder / f"{template}{ending}")
    text = (folder / "pyramid_cut.step").read_text()
    torn = re.sub(r"(CLOSED_SHELL\('[^']*',\()#\d+,", r"\1", text)
    assert torn != text
    (folder / "torn.step").write_text(torn)
    data = (folder / "pyramid_cut.stl").read_bytes()
    count = int.from_bytes(data[80:84], "little") - 1
    (folder / "torn.stl").write_bytes(data[:80] + count.to_bytes(4, "little") + data[84:-50])
    return folder


def steps(files: Path) -> list[Path]:
    return [files / f"{template}.step" for template in TEMPLATES]


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_reader_without_a_kernel(template, files):
    found = check_step(files / f"{template}.step")
    assert found.volume_mm3 == pytest.approx(in_mm3(part_of(template)), rel=1e-9)
    assert found.shells == part_of(template).report.shells


def test_the_reader_without_a_kernel_finds_a_missing_face(files):
    with pytest.raises(ValueError, match=r"."):
        check_step(files / "torn.step")


@needs(freecad(), "FreeCAD")
def test_freecad_reads_every_template_as_valid_with_its_strictest_check(files):
    found = read_in_freecad([*steps(files), files / "torn.step"], files)
    torn = found.pop(files / "torn.step")
    assert not torn["valid"] or torn["solids"] != 1
    for template in TEMPLATES:
        part, one = part_of(template), found[files / f"{template}.step"]
        assert one["valid"], f"{template}: {one['complaint']}"
        counts = (1, part.report.shells, len(part.report.faces))
        assert (one["solids"], one["shells"], one["faces"]) == counts, template
        assert one["volume"] == pytest.approx(in_mm3(part), rel=agreement(part)), template


@needs(find_spec("netgen"), "netgen")
def test_netgen_reads_every_template_and_meshes_without_healing(files):
    meshed = [files / "pyramid_cut.step", files / "turned_ring.step"]
    found = read_in_netgen([*steps(files), files / "torn.step"], meshed)
    torn = found.pop(files / "torn.step")
    assert torn["volume"] != pytest.approx(in_mm3(part_of("pyramid_cut")), rel=1e-3)
    for template in TEMPLATES:
        part, one = part_of(template), found[files / f"{template}.step"]
        assert (one["solids"], one["faces"]) == (1, len(part.report.faces)), template
        assert one["volume"] == pytest.approx(in_mm3(part), rel=agreement(part)), template
    flat, ring = (found[path] for path in meshed)
    assert flat["mesh volume"] == pytest.approx(in_mm3(part_of("pyramid_cut")), rel=1e-9)
    assert ring["mesh volume"] == pytest.approx(in_mm3(part_of("turned_ring")), rel=0.05)
    assert ring["tetrahedra"] > 20


def stls(files: Path) -> list[Path]:
    return [files / f"{template}.stl" for template in TEMPLATES]


def test_trimesh_takes_every_stl_for_a_volume(files):
    for template, path in zip(TEMPLATES, stls(files), strict=True):
        mesh = trimesh.load(path)
        assert mesh.is_volume, template
        assert mesh.body_count == part_of(template).report.shells, template
        assert mesh.volume == pytest.approx(part_of(template).report.solid.volume, rel=0.0101)
    assert not trimesh.load(files / "torn.stl").is_volume


@needs(find_spec("manifold3d"), "manifold3d")
def test_manifold_accepts_every_stl(files):
    import manifold3d

    def manifold(path: Path) -> manifold3d.Manifold:
        mesh = trimesh.load(path)
        return manifold3d.Manifold(
            manifold3d.Mesh(
                np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
            )
        )

    for template, path in zip(TEMPLATES, stls(files), strict=True):
        solid = manifold(path)
        assert solid.status() == manifold3d.Error.NoError, template
        genus = sum(part_of(template).report.genus) - part_of(template).report.shells + 1
        assert solid.genus() == genus, template
        assert solid.volume() == pytest.approx(part_of(template).report.solid.volume, rel=0.0101)
    assert manifold(files / "torn.stl").status() != manifold3d.Error.NoError


@needs(shutil.which("admesh"), "admesh")
def test_admesh_has_nothing_to_mend_in_any_stl(files):
    def disconnected(path: Path) -> list[int]:
        done = subprocess.run(
            ["admesh", str(path)], capture_output=True, text=True, timeout=60, check=True
        )
        rows = re.findall(r"^(?:Facets with|Total disconnected).*?: +(\d+)", done.stdout, re.M)
        mended = re.findall(
            r"^(?:Edges fixed|Facets removed|Facets added|Facets reversed|"
            r"Degenerate facets|Backwards edges) +: +(\d+)",
            done.stdout,
            re.M,
        )
        assert len(rows) == 4
        assert len(mended) == 6
        return [int(number) for number in (*rows, *mended)]

    for path in stls(files):
        assert not any(disconnected(path)), path.name
    assert any(disconnected(files / "torn.stl"))


@needs(find_spec("build123d"), "build123d")
def test_build123d_takes_and_gives_shapes_unchanged():
    code = """
import build123d as bd, cadquery as cq
import pc2cad.cadquery as pcq
solid = pcq.point_solid("pyramid")
taken = bd.Solid(solid.wrapped)
half = taken & bd.Pos(0, 0, -3) * bd.Box(100, 100, 100, align=bd.Align.CENTER)
print(taken.volume, taken.is_valid, cq.Shape.cast(taken.wrapped).Volume(), len(taken.faces()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    volume, valid, back, faces = done.stdout.split()
    assert float(volume) == pytest.approx(31.5, rel=1e-12)
    assert float(back) == pytest.approx(31.5, rel=1e-12)
    assert (valid, faces) == ("True", "4")


SCRIPT = """
import cadquery as cq
import pc2cad.cadquery

duct = cq.Workplane().channelSolid("ellipse", delta=0.3)
tip = cq.Workplane().box(6, 6, 1).faces(">Z").workplane().pointSolid("pyramid_cut")
result = duct
show_object(duct, name="duct")
show_object(tip.faces(tag="w=1"), name="cut")
"""


@needs(shutil.which("cq-cli") or (Path(sys.executable).parent / "cq-cli").exists(), "cq-cli")
def test_cq_cli_writes_a_channel_and_reports_a_broken_script(tmp_path):
    command = shutil.which("cq-cli") or str(Path(sys.executable).parent / "cq-cli")

    def run(text: str, target: str) -> subprocess.CompletedProcess[str]:
        script = tmp_path / "script.py"
        script.write_text(text)
        return subprocess.run(
            [command, "--codec", "step", "--infile", str(script),
             "--outfile", str(tmp_path / target)],
            capture_output=True, text=True, timeout=180, check=False,
        )  # fmt: skip

    done = run(SCRIPT.split("show_object(tip")[0], "duct.step")
    assert done.returncode == 0, done.stderr
    assert "B_SPLINE_SURFACE" in (tmp_path / "duct.step").read_text()
    broken = run(SCRIPT.replace("delta=0.3", "delta=-1"), "none.step")
    assert broken.returncode != 0
    assert not (tmp_path / "none.step").exists()


@needs(cq_editor_installed(), "CQ-editor with an X server")
def test_cq_editor_renders_ten_times_and_shows_a_broken_script(tmp_path):
    script, picture = tmp_path / "script.py", tmp_path / "shown.png"
    # the editor meshes to 1e-5 of the size, which takes minutes on splines: cylinders will do
    quick = SCRIPT.replace('"ellipse", delta=0.3', '"hollow_cylinder"')
    script.write_text(quick)
    found = render_in_cq_editor(script, 10, picture)
    assert found == {"tracebacks": [], "objects": [2] * 10}
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOImage import vtkPNGReader

    reader = vtkPNGReader()
    reader.SetFileName(str(picture))
    reader.Update()
    values = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    assert len(np.unique(values, axis=0)) > 50
    script.write_text(SCRIPT.replace("delta=0.3", "delta=-1"))
    broken = render_in_cq_editor(script, 1, picture)
    assert "ParameterRangeError" in broken["tracebacks"][0]
