"""What gmsh reads from a STEP file with every kind of healing switched off, in millimetres."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

_HEALING = ("AutoFix", "FixDegenerated", "FixSmallEdges", "FixSmallFaces", "SewFaces", "MakeSolids")


def read_in_gmsh(path: str | Path, *, timeout: float = 300.0) -> dict[str, Any]:
    """Import in a new process: volumes, surfaces, volume and area as gmsh's kernel has them."""
    return read_all_in_gmsh([path], timeout=timeout)[0]


def read_all_in_gmsh(paths: list[str | Path], *, timeout: float = 300.0) -> list[dict[str, Any]]:
    """Import files in one new process, each into an empty model: as `read_in_gmsh`."""
    return _run(paths, 0.0, timeout)


def mesh(path: str | Path, size: float, *, timeout: float = 600.0) -> dict[str, Any]:
    """Import and mesh with curved second-order tetrahedra of about this size."""
    return _run([path], size, timeout)[0]


def _run(paths: list[str | Path], size: float, timeout: float) -> list[dict[str, Any]]:
    from consumers.fresh_kernel import run_json

    found: list[dict[str, Any]] = run_json(__file__, size, *paths, timeout=timeout)["found"]
    return found


def _imported(gmsh: Any, path: str) -> dict[str, Any]:
    for name in _HEALING:
        gmsh.option.setNumber(f"Geometry.OCC{name}", 0)
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    gmsh.model.occ.importShapes(path)
    gmsh.model.occ.synchronize()
    volumes, surfaces = gmsh.model.getEntities(3), gmsh.model.getEntities(2)
    return {
        "volumes": len(volumes),
        "surfaces": len(surfaces),
        "curves": len(gmsh.model.getEntities(1)),
        "volume": sum(gmsh.model.occ.getMass(*entity) for entity in volumes),
        "area": sum(gmsh.model.occ.getMass(*entity) for entity in surfaces),
    }


def _meshed(gmsh: Any, size: float) -> dict[str, Any]:
    """Order-2 tetrahedra: their exact volume and the least Jacobian determinant in any."""
    import numpy as np

    for option, value in (
        ("Mesh.MeshSizeMin", size),
        ("Mesh.MeshSizeMax", size),
        ("Mesh.ElementOrder", 2),
        ("Mesh.SecondOrderLinear", 0),
        ("Mesh.HighOrderOptimize", 2),
    ):
        gmsh.option.setNumber(option, value)
    gmsh.model.mesh.generate(3)
    volume, least, count = 0.0, np.inf, 0
    for kind, tags, _ in zip(*gmsh.model.mesh.getElements(3), strict=True):
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points)
        volume += float(np.sum(determinants.reshape(-1, len(weights)) @ weights))
        least = min(least, float(gmsh.model.mesh.getElementQualities(tags, "minDetJac").min()))
        count += len(tags)
    return {"mesh_volume": volume, "min_jacobian": float(least), "tetrahedra": count}


def main(size: str, *paths: str) -> None:
    import gmsh

    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    found = []
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for path in paths:
            gmsh.clear()
            found.append(_imported(gmsh, path))
            if float(size) > 0.0:
                found[-1] |= _meshed(gmsh, float(size))
    finally:
        gmsh.finalize()
    sys.stdout.write("\n" + json.dumps({"found": found}) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
