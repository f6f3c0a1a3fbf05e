"""Where only the kernel is: pc2cad builds, and says in one sentence what is missing."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest

#: a process for which packages are not installed
BLOCKED = """
import importlib.util, sys
blocked = {blocked!r}
class Missing:
    def find_spec(self, name, *rest):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name in blocked else found(name, *rest)
sys.meta_path.insert(0, Missing())
"""
ALL = {
    "part.to_cadquery()": "CadQuery's solids need the package cadquery, which is not installed",
    "importlib.import_module('pc2cad.cadquery')": (
        "pc2cad.cadquery and its methods need the package cadquery, which is not installed"
    ),
    "part.write(folder + '/p.vtp')": ".vtp files need the package vtkmodules",
    "part.write(folder + '/p.3mf')": ".3mf files need the package lib3mf",
    "check_ending('p.png')": "pictures need the package vtkmodules",
}


def test_builds_and_says_what_is_missing(tmp_path) -> None:
    script = (
        BLOCKED.format(blocked={"cadquery", "vtkmodules", "vtk", "lib3mf", "trame"})
        + f"""
import pc2cad as pc
from pc2cad.errors import PackageMissingError
from pc2cad.picture.style import check_ending
folder = {str(tmp_path)!r}
u, v, w = pc.parameters()
part = pc.compile_part((3*u, 2*v, w*(1 + u)))
part.write(folder + "/p.step")
print(part.report.solid.volume)
for line in {list(ALL)!r}:
    try:
        eval(line)
    except PackageMissingError as error:
        print(error)
"""
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stderr == ""
    volume, *sentences = done.stdout.splitlines()
    assert float(volume) == pytest.approx(9, rel=1e-13)
    assert [said.split(":")[0] for said in sentences] == [
        words if words.endswith("installed") else f"{words}, which is not installed"
        for words in ALL.values()
    ]
    assert all(": pip install " in said for said in sentences)
    assert (tmp_path / "p.step").read_text().startswith("ISO-10303-21")


@pytest.mark.interop
@pytest.mark.skipif(not find_spec("build123d"), reason="needs build123d")
def test_build123d_and_pc2cad_exchange_solids(tmp_path) -> None:
    script = f"""
import build123d as bd
import pc2cad as pc
u, v, w = pc.parameters()
part = pc.compile_part((3*u, 2*v, w*(1 + u)))
solid = bd.Solid(part.shape)
part.write({str(tmp_path / "p.step")!r})
read = bd.import_step({str(tmp_path / "p.step")!r})
rest = solid - bd.Solid.make_box(1, 1, 1)
bd.export_step(rest, {str(tmp_path / "rest.step")!r})
receipt = pc.receipt({str(tmp_path / "rest.step")!r})
guide = pc.guide_from_wire(bd.Line((0, 0, 0), (0, 0, 5)))
pipe = pc.compile_equation(pc.channel(guide, pc.ellipse(1, 1, pc.parameters()[1])))
print(solid.volume, rest.volume, read.volume, receipt["solids"][0]["volume"])
print(solid.is_valid, receipt["sound"], pipe.report.solid.volume > 0)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    first, second = done.stdout.splitlines(), done.stderr
    assert second == ""
    volumes, said = first
    assert [float(v) for v in volumes.split()] == pytest.approx([9, 8, 9, 8], rel=1e-12)
    assert said.split() == ["True"] * 3
