"""What Netgen finds in STEP files, without its healing; run as a script in a process of its own."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def read_in_netgen(paths: list[Path], meshed: list[Path]) -> list[dict[str, Any]]:
    """Read files: volume (mm³) and counts; of `meshed` ones also the volume of the tetrahedra."""
    from consumers.fresh_kernel import run_json

    names = json.dumps([str(path) for path in paths]), json.dumps([str(path) for path in meshed])
    return list(run_json(__file__, *names, timeout=400.0).values())


def main(paths: str, meshed: str) -> None:
    import numpy as np
    from netgen.occ import OCCGeometry

    found: dict[str, dict[str, Any]] = {}
    for path in json.loads(paths):
        geometry = OCCGeometry(path)  # Heal is a call of its own
        shape = geometry.shape
        found[path] = {
            "volume": shape.mass, "solids": len(shape.solids), "faces": len(shape.faces),
        }  # fmt: skip
        if path in json.loads(meshed):
            mesh = geometry.GenerateMesh()
            points = np.array([point.p for point in mesh.Points()])
            corners = np.array([[v.nr - 1 for v in e.vertices[:4]] for e in mesh.Elements3D()])
            sides = points[corners[:, 1:]] - points[corners[:, :1]]
            found[path]["tetrahedra"] = len(corners)
            found[path]["mesh volume"] = float(np.abs(np.linalg.det(sides)).sum() / 6)
    sys.stdout.write("\n" + json.dumps(found) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
