"""Files that are what their ending says, to its end, as another program reads them."""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import cadquery as cq
import trimesh
from vtkmodules.vtkIOImage import vtkPNGReader
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from pc2cad.templates.file import parse_template


def _solid(path: Path) -> bool:
    return all(s.isValid() and s.Volume() > 0 for s in cq.importers.importStep(str(path)).solids())


def _picture(path: Path) -> bool:
    reader = vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    low, high = reader.GetOutput().GetScalarRange()
    return low < high == 255


def _grid(path: Path) -> bool:
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput().GetNumberOfCells() > 0


def _gmsh(path: Path) -> bool:
    data = path.read_bytes()
    return b"$Nodes" in data and data.rstrip().endswith(b"$EndElementData")


def _deck(path: Path) -> bool:
    words = [line.split(",")[0].upper() for line in path.read_text().splitlines()]
    return {"*NODE", "*ELEMENT", "*SURFACE"} <= set(words)


def _study(path: Path) -> bool:
    with open(path / "results.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    named = [Path(row["step"]) for row in rows if row.get("step")]
    for file in named:
        assert_whole(path / file)
    return bool(rows) and all(row["status"] == "built" for row in rows)


_READERS: dict[str, Callable[[Path], bool]] = {
    "": _study,
    ".3mf": lambda path: b"<triangle " in zipfile.ZipFile(path).read("3D/3dmodel.model"),
    ".g2": lambda path: path.read_text().split()[0] == "700",  # a trivariate spline
    ".html": lambda path: path.read_text().rstrip().endswith("</html>"),
    ".inp": _deck,
    ".json": lambda path: json.loads(path.read_text())["solid"]["volume"] > 0,
    ".msh": _gmsh,
    ".ply": lambda path: len(trimesh.load(path).vertices) > 0,
    ".png": _picture,
    ".step": _solid,
    ".stl": lambda path: trimesh.load(path).is_volume,
    ".toml": lambda path: bool(parse_template(path.read_text(), path.stem).title),
    ".vtu": _grid,
    ".xml": lambda path: ElementTree.parse(path).find("MultiPatch") is not None,
}


def assert_whole(path: Path) -> None:
    """Fail unless the file, or a study's folder, is there and whole."""
    assert path.exists(), path.name
    assert _READERS[path.suffix](path), f"{path.name} is not whole"
