"""Every template in the programs that people open it with, and that each can find a fault.

Volumes agree to 1e-9: with the equation's where a reader integrates exactly (the kernel-free one),
and where a program takes its kernel's plain rule, which is up to 1e-2 off on curved faces, with
what the same rule gives on the solid that was written. Netgen's adaptive rule is 3e-7 off at most.
Each reader has to find two faults: a face left out, and a pole moved inside a face, which breaks
no border and shows in the volume only.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from consumers.editor_window import installed as cq_editor_installed
from consumers.editor_window import render_in_cq_editor
from consumers.freecad_reader import freecad, read_in_freecad
from consumers.gmsh_reader import read_all_in_gmsh
from consumers.netgen_reader import read_in_netgen
from consumers.step_edits import move, pole, read_instances, without_face
from consumers.step_file import check_solids, check_step
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL
from shipped import LONG, part_of

from pc2cad.export.kernel import subshapes
from pc2cad.part import Part
from pc2cad.templates.shipped import bodies_paths, template_paths
from pc2cad.verify.defects import StepDefectError

pytestmark = pytest.mark.interop

BODIES = bodies_paths()
PATHS = template_paths() | BODIES
TEMPLATES = list(PATHS)
#: a solid with an inner pole on a face
MOVED = "triquadratic_cube"


def needs(tool: object, name: str):
    return pytest.mark.skipif(not tool, reason=f"{name} is not installed")


@dataclass(frozen=True)
class Written:
    """What is known of a part whose files are written; its files are in mm."""

    volume: float
    volume_mm3: float
    #: by the kernel's plain rule, which programs on the same kernel take
    plain_mm3: float
    solids: int
    shells: int
    faces: int
    #: whether all faces are planes
    plane: bool
    #: closed surfaces of the whole boundary, and their genus
    surfaces: int
    genus: int

    @classmethod
    def of(cls, part: Part) -> Written:
        report, found = part.report, GProp_GProps()
        BRepGProp.VolumeProperties_s(part.shape, found)
        unit = {"mm": 1.0, "cm": 1e3, "m": 1e9, "in": 25.4**3}[report.units]
        bodies = part.exportable().bodies
        shells, faces = (
            sum(len(subshapes(body, kind)) for body in bodies)
            for kind in (TopAbs_SHELL, TopAbs_FACE)
        )
        return cls(
            report.solid.volume, report.solid.volume * unit, found.Mass() * unit, len(bodies),
            shells, faces, all(face.carrier == "plane" for face in report.faces),
            report.shells, 1 - report.euler // 2,
        )  # fmt: skip


def known(files: Path, template: str) -> Written:
    return Written(**json.loads((files / f"{template}.json").read_text()))


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Every template as STEP and STL, by what process of the run comes first to each."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "files"
    (folder / "begun").mkdir(parents=True, exist_ok=True)
    for template in TEMPLATES:
        try:
            (folder / "begun" / template).touch(exist_ok=False)
        except FileExistsError:
            continue
        part = part_of(template)
        for ending in (".stl", ".step"):
            whole(folder / f"{template}{ending}", part.write)
        text = json.dumps(asdict(Written.of(part)))
        whole(folder / f"{template}.json", lambda path, text=text: path.write_text(text))
    await_all(folder / f"{template}.json" for template in TEMPLATES)
    wrong(folder)
    return folder


def whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that nobody sees before it is finished."""
    aside = path.with_stem(f"{path.stem}-{os.getpid()}")
    write(aside)
    aside.rename(path)


def await_all(paths: Iterable[Path]) -> None:
    end = time.monotonic() + 300
    for path in paths:
        while not path.exists():
            assert time.monotonic() < end, f"nobody has written {path.name}"
            time.sleep(0.1)


def wrong(folder: Path) -> None:
    """Write files that are torn, or have a pole moved."""
    sound = {name: read_instances(folder / f"{name}.step") for name in ("pyramid_cut", MOVED)}
    inner = pole(sound[MOVED], 1, 1)  # of w=1
    moved = move(sound[MOVED], inner, 0.05, axis=2)
    for name, text in (("torn", without_face(sound["pyramid_cut"])), ("moved", moved)):
        whole(folder / f"{name}.step", lambda path, text=text: path.write_text(text))
    data = (folder / "pyramid_cut.stl").read_bytes()
    count = int.from_bytes(data[80:84], "little") - 1
    torn = data[:80] + count.to_bytes(4, "little") + data[84:-50]
    whole(folder / "torn.stl", lambda path: path.write_bytes(torn))


def wrong_at_the_end(files: Path, templates: Sequence[str] = TEMPLATES) -> list[Path]:
    """Return the files of templates, then one that is torn and one with a pole moved."""
    return [files / f"{name}.step" for name in (*templates, "torn", "moved")]


@pytest.mark.parametrize("template", template_paths())
def test_a_reader_without_a_kernel(template, files):
    part, path = known(files, template), files / f"{template}.step"
    found = list(check_solids(path).values()) if part.solids > 1 else [check_step(path)]
    assert sum(one.volume_mm3 for one in found) == pytest.approx(part.volume_mm3, rel=1e-9)
    shells, faces = (sum(x) for x in zip(*((o.shells, len(o.faces)) for o in found), strict=True))
    assert (len(found), shells, faces) == (part.solids, part.shells, part.faces)


def test_the_reader_without_a_kernel_finds_what_is_wrong(files):
    with pytest.raises(StepDefectError, match="is open"):
        check_step(files / "torn.step")
    with pytest.raises(StepDefectError, match="states the volume"):
        check_step(files / "moved.step")


def test_gmsh_reads_every_template_without_healing(files):
    *found, torn, moved = read_all_in_gmsh(wrong_at_the_end(files))
    assert torn["volumes"] != 1
    assert moved["volume"] != pytest.approx(known(files, MOVED).plain_mm3, rel=1e-4)
    for template, one in zip(TEMPLATES, found, strict=True):
        part = known(files, template)
        assert (one["volumes"], one["surfaces"]) == (part.solids, part.faces), template
        assert one["volume"] == pytest.approx(part.plain_mm3, rel=1e-9), template


@needs(freecad(), "FreeCAD")
def test_freecad_reads_every_template_as_valid_with_its_strictest_check(files):
    # its check compares all faces with all others, for minutes where they are long tubes, and
    # takes the touching faces of two layers for one that meets itself
    templates = [name for name in TEMPLATES if name not in LONG]
    *found, torn, moved = read_in_freecad(wrong_at_the_end(files, templates), files)
    assert not torn["valid"] or torn["solids"] != 1
    assert moved["volume"] != pytest.approx(known(files, MOVED).plain_mm3, rel=1e-4)
    for template, one in zip(templates, found, strict=True):
        part = known(files, template)
        assert one["valid"], f"{template}: {one['complaint']}"
        seen = one["solids"], one["shells"], one["faces"]
        assert seen == (part.solids, part.shells, part.faces), template
        assert one["volume"] == pytest.approx(part.plain_mm3, rel=1e-9), template


@needs(find_spec("netgen"), "netgen")
def test_netgen_reads_every_template_and_meshes_without_healing(files):
    meshed = [files / "pyramid_cut.step", files / "turned_ring.step"]
    *found, torn, moved = read_in_netgen(wrong_at_the_end(files), meshed)
    assert torn["volume"] != pytest.approx(known(files, "pyramid_cut").volume_mm3, rel=1e-3)
    assert moved["volume"] != pytest.approx(known(files, MOVED).volume_mm3, rel=1e-4)
    for template, one in zip(TEMPLATES, found, strict=True):
        part = known(files, template)
        assert (one["solids"], one["faces"]) == (part.solids, part.faces), template
        near = pytest.approx(part.volume_mm3, rel=1e-12 if part.plane else 5e-7)
        assert one["volume"] == near, template
    flat, ring = (found[TEMPLATES.index(path.stem)] for path in meshed)
    whole_of = {path.stem: known(files, path.stem).volume_mm3 for path in meshed}
    assert flat["mesh volume"] == pytest.approx(whole_of["pyramid_cut"], rel=1e-9)
    assert ring["mesh volume"] == pytest.approx(whole_of["turned_ring"], rel=0.05)
    assert ring["tetrahedra"] > 20


def stls(files: Path) -> list[Path]:
    return [files / f"{template}.stl" for template in TEMPLATES]


def test_trimesh_takes_every_stl_for_a_volume(files):
    for template, path in zip(TEMPLATES, stls(files), strict=True):
        mesh = trimesh.load(path)
        assert mesh.is_volume, template
        assert mesh.body_count == known(files, template).surfaces, template
        assert mesh.volume == pytest.approx(known(files, template).volume, rel=0.0101)
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
        assert solid.genus() == known(files, template).genus, template
        assert solid.volume() == pytest.approx(known(files, template).volume, rel=0.0101)
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


@needs(find_spec("nbclient") and find_spec("ipykernel"), "nbclient with ipykernel")
def test_jupyter_shows_a_point_solid_and_says_what_is_wrong():
    import nbformat
    from nbclient import NotebookClient

    cells = [
        "import cadquery as cq, pc2cad.cadquery as pcq",
        "cq.Workplane().pointSolid('pyramid')",
        "pcq.point_solid('pyramid_cut', p=0.3)",
        "pcq.point_solid('pyramid_cut', p=3)",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in cells])
    NotebookClient(notebook, timeout=120, allow_errors=True).execute()
    chain, solid, wrong = (cell.outputs for cell in notebook.cells[1:])
    for outputs in (chain, solid):
        (shown,) = (o for o in outputs if o.output_type == "execute_result")
        drawn = shown.data.get("application/javascript") or shown.data["text/html"]
        assert "vtk" in drawn
        assert len(drawn) > 5000  # the triangles are in it
    assert wrong[0].ename == "ParameterRangeError"


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
    script.write_text(SCRIPT)
    found = render_in_cq_editor(script, 10, picture)
    assert found["tracebacks"] == []
    assert found["objects"] == [2] * 10
    # the kernel's own triangles of these splines, by the editor's settings: minutes
    assert found["seconds"][0] < 8, "CPU from the run to what is seen"
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
