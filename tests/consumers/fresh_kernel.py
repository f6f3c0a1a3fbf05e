"""What a fresh process with the geometry kernel reads from a STEP file, in millimetres.

The process has loaded nothing but the kernel and only ever reads: whatever the writer has set or
left in the kernel of its own process is not there. It stays for the next file.

Which integral to trust was measured on solids of known volume:
  VolumeProperties_s(shape, properties)            2e-3 off on closed rational faces, 6e-8 on
                                                   polynomial faces of three spans;
  VolumeProperties_s(shape, properties, eps, ...)  1e-15 on analytic faces, 2e-11 on polynomial
                                                   ones, 2e-8 on closed rational faces whatever
                                                   eps says; fast;
  VolumePropertiesGK_s(..., IsUseSpan=True)        1e-14, but 0.2 s to 100 s a solid.
The second is the default here, the third is had with precise=True.
"""

from __future__ import annotations

import atexit
import json
import subprocess
import sys
from functools import cache
from pathlib import Path
from threading import Timer
from typing import Any

EPS = 1e-10
#: what the line begins with that holds an answer, among the kernel's own
ANSWER = "answer: "


def read_in_fresh_process(
    path: str | Path, *, precise: bool = False, timeout: float = 300.0
) -> dict[str, Any]:
    """Read a STEP file in another interpreter and report what arrived."""
    reader = _reader()
    assert reader.stdin is not None
    assert reader.stdout is not None
    timer = Timer(timeout, reader.kill)
    timer.start()
    try:
        reader.stdin.write(json.dumps([str(path), precise]) + "\n")
        reader.stdin.flush()
        answer = next(line for line in reader.stdout if line.startswith(ANSWER))
    except (StopIteration, BrokenPipeError):
        _reader.cache_clear()
        raise RuntimeError(f"the reader of {path} crashed or took {timeout} s") from None
    finally:
        timer.cancel()
    report: dict[str, Any] = json.loads(answer.removeprefix(ANSWER))
    if "error" in report:
        raise RuntimeError(report["error"])
    return report


@cache
def _reader() -> subprocess.Popen[str]:
    """Start the process that reads; it ends with this one."""
    process = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    atexit.register(process.communicate)
    return process


def run_json(script: str, *arguments: Any, timeout: float) -> dict[str, Any]:
    """Run a script of this package; its last line of output is a JSON object."""
    command = [sys.executable, script, *(str(argument) for argument in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{Path(script).name} failed: {done.stderr.strip()[-2000:]}")
    report: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return report


def _load(path: str) -> Any:
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_Controller, STEPControl_Reader

    STEPControl_Controller.Init_s()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_RetDone:
        raise RuntimeError(f"the kernel cannot read {path}")
    reader.TransferRoots()
    return reader.OneShape()


def _counts(shape: Any) -> dict[str, int]:
    from OCP.TopAbs import TopAbs_ShapeEnum as Kind
    from OCP.TopExp import TopExp

    from pc2cad.brep import kernel

    counts = {}
    for name in ("solid", "shell", "face", "edge", "vertex"):
        found = kernel.IndexedMapOfShape()
        TopExp.MapShapes_s(shape, getattr(Kind, f"TopAbs_{name.upper()}"), found)
        counts["vertices" if name == "vertex" else f"{name}s"] = found.Extent()
    return counts


def _free_edges(shape: Any) -> int:
    """Edges that bound one face only, and are neither its seam nor collapsed."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_ShapeEnum as Kind
    from OCP.TopExp import TopExp

    from pc2cad.brep import kernel

    parents = kernel.IndexedDataMapOfShapeListOfShape()
    TopExp.MapShapesAndUniqueAncestors_s(shape, Kind.TopAbs_EDGE, Kind.TopAbs_FACE, parents)
    free = 0
    for index in range(1, parents.Extent() + 1):
        edge = kernel.as_edge(parents.FindKey(index))
        faces = list(parents.FindFromIndex(index))
        if len(faces) >= 2 or BRep_Tool.Degenerated_s(edge):
            continue
        if not faces or not BRep_Tool.IsClosed_s(edge, kernel.as_face(faces[0])):
            free += 1
    return free


def _tolerances(shape: Any) -> dict[str, float]:
    from OCP.ShapeAnalysis import ShapeAnalysis_ShapeTolerance
    from OCP.TopAbs import TopAbs_ShapeEnum as Kind

    tool = ShapeAnalysis_ShapeTolerance()
    return {
        f"max_{name}_tolerance": tool.Tolerance(shape, 1, getattr(Kind, f"TopAbs_{name.upper()}"))
        for name in ("vertex", "edge", "face")
    }


def _integrals(shape: Any, precise: bool) -> dict[str, Any]:
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    volume, area = GProp_GProps(), GProp_GProps()
    if precise:
        BRepGProp.VolumePropertiesGK_s(shape, volume, EPS, False, True, True, False, False)
    else:
        BRepGProp.VolumeProperties_s(shape, volume, EPS, False, False)
    BRepGProp.SurfaceProperties_s(shape, area, EPS, False)
    centre = volume.CentreOfMass()
    return {
        "volume": volume.Mass(),
        "area": area.Mass(),
        "centroid": [centre.X(), centre.Y(), centre.Z()],
    }


def _report(path: str, precise: bool) -> dict[str, Any]:
    from OCP.BRepCheck import BRepCheck_Analyzer

    shape = _load(path)
    return {
        "shape_type": shape.ShapeType().name.removeprefix("TopAbs_"),
        "valid": BRepCheck_Analyzer(shape).IsValid(),
        "free_edges": _free_edges(shape),
        **_counts(shape),
        **_tolerances(shape),
        **_integrals(shape, precise),
    }


def main() -> None:
    """Answer every line of the input, a path and whether integrals are to be precise."""
    for line in sys.stdin:
        try:
            report = _report(*json.loads(line))
        except Exception as error:  # of this file; the next may be sound
            report = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(f"\n{ANSWER}{json.dumps(report)}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
