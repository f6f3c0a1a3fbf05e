"""Triangles on the faces' own grids beside the kernel's mesher, and a sweep's beside both."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.Geom import Geom_Plane
from OCP.TopAbs import TopAbs_FACE
from OCP.TopLoc import TopLoc_Location

from benchmarks import peers
from benchmarks.channels import CHANNELS
from pc2cad.brep.display import ANGLE
from pc2cad.brep.face_patches import shapes_of
from pc2cad.brep.from_kernel import surface_function
from pc2cad.brep.kernel import as_face
from pc2cad.brep.triangle_grids import attach
from pc2cad.compiler import compile_equation

Row = tuple[str, ...]
HEAD: Row = ("part", "asked mm", "by", "triangles", "s", "measured mm", "volume off")


def triangles(quick: bool) -> Iterator[Row]:
    """Yield rows for the elliptic channel: our solid by both meshers, and a sweep's own."""
    channel = next(c for c in CHANNELS if c.name == "8a")
    part = compile_equation(channel.equation())
    sweep = peers.cadquery_sweep(channel)
    volume = part.report.integrals.volume
    for deflection in (1e-2,) if quick else (1e-2, 1e-3):
        for name, solid, gridded in (
            ("pc2cad", part.shape, True), ("pc2cad", part.shape, False), ("sweep", sweep, False),
        ):  # fmt: skip
            yield _row(name, solid, gridded, deflection, volume)


def _row(name: str, solid, gridded: bool, deflection: float, volume: float) -> Row:
    shape = BRepBuilderAPI_Copy(solid, False, False).Shape()
    start = time.process_time()
    if gridded:
        attach(shape, deflection, ANGLE)
    BRepMesh_IncrementalMesh(shape, deflection, False, ANGLE, False)
    took = time.process_time() - start
    count, off, enclosed = _measured(shape)
    by = "own grids" if gridded else "kernel"
    return (name, f"{deflection:g}", by, f"{count:,}", f"{took:.2f}", f"{off:.2e}",
            f"{(enclosed - volume) / volume:+.1e}")  # fmt: skip


def _measured(shape) -> tuple[int, float, float]:
    """Return triangles, the largest distance seen of surface points from theirs, and the volume."""
    count, worst, volume = 0, 0.0, 0.0
    random = np.random.default_rng(0)
    for face in map(as_face, shapes_of(shape, TopAbs_FACE)):
        mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
        surface = BRep_Tool.Surface_s(face, TopLoc_Location())
        nodes = np.array([mesh.Node(i + 1).Coord() for i in range(mesh.NbNodes())])
        corners = np.array([mesh.Triangle(i + 1).Get() for i in range(mesh.NbTriangles())]) - 1
        a, b, c = (nodes[corners[:, k]] for k in range(3))
        sign = -1 if face.Orientation().name.endswith("REVERSED") else 1
        volume += sign * float((a * np.cross(b, c)).sum()) / 6
        count += len(corners)
        if isinstance(surface, Geom_Plane):
            continue
        places = np.array([mesh.UVNode(i + 1).Coord() for i in range(mesh.NbNodes())])
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.sqrt((normals**2).sum(axis=1)), 1e-300)[:, None]
        jet = surface_function(surface, np.zeros(3)).jet
        for _ in range(4):
            shares = random.dirichlet((1.0, 1.0, 1.0), len(corners))
            at = (places[corners] * shares[:, :, None]).sum(axis=1)
            points = jet(at[:, 0], at[:, 1])[0]
            worst = max(worst, float(np.abs(((points - a) * normals).sum(axis=1)).max()))
    return count, worst, volume
