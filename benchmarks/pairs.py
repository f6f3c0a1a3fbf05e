"""Random pairs of templates, joined three ways: ``python -m benchmarks.pairs FOLDER``.

Two shipped templates, both made 10 long, lie at a random angle with the middle of the second
anywhere in the box of the first; their union, cut and common part are made by pc2cad and, of the
same two solids, by plain CadQuery (``fuse``, ``cut``, ``intersect``, ``exportStep``). Each STEP
file is read by three programs: the kernel, pc2cad's ``receipt`` (which shares nothing with it) and
gmsh with healing off, where that is installed. A file holds if it is one valid solid with one
volume for all readers; the volumes of the three have to add up. Each pair runs in a process of its
own, which may take so long and no longer. What is found goes to FOLDER/pairs.jsonl, a line each,
and a run goes on where the last one ended; files that are wrong stay in the folder.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import resource
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import pc2cad as pc
from pc2cad.brep.inspect import bounding_box
from pc2cad.checked import halved
from pc2cad.compiler import compile_checked, compile_solid
from pc2cad.csg.bodies import EmptyResultError, SeveralPiecesError
from pc2cad.csg.contacts import TouchingBodiesError
from pc2cad.csg.ways import compile_bodies
from pc2cad.equation.point_equation import Expectations, PointEquation
from pc2cad.errors import KernelError, PointCadError
from pc2cad.expression.tree import number
from pc2cad.options import CompileOptions
from pc2cad.part import Body
from pc2cad.templates.bodies import Bodies, Operation, Pattern
from pc2cad.templates.patterns import Placement
from pc2cad.templates.shipped import template_paths

#: templates whose faces in many pieces, or splines of thousands of poles, take minutes a Boolean
LEFT_OUT = (
    "bellows", "channel_contour", "channel_ellipse", "channel_sine", "coil", "duct", "gerotor",
    "helical_channel", "layered_pipe", "propeller_blade", "spring", "square_to_round",
    "stellarator_wall", "trefoil",
)  # fmt: skip
KINDS = ("union", "cut", "intersect")
#: how large each body is made (mm), what volumes may differ by, of the larger body's, and how
#: many seconds of CPU a pair may take
SIZE, AGREE, MOST = 10, 1e-6, 240
#: what is found of one Boolean
Row = dict[str, Any]
#: refusals whose reason is where the bodies lie
GEOMETRIC = (EmptyResultError, SeveralPiecesError, TouchingBodiesError)


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.pairs", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="leave those before it out")
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=60, help="begin no pair after that")
    options = parser.parse_args()
    for name in ("cadquery", "gmsh"):  # once, and not in each pair's process
        if find_spec(name):
            import_module(name)
    options.folder.mkdir(parents=True, exist_ok=True)
    path = options.folder / "pairs.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    known = {row["pair"]: row for row in rows if row["seed"] == options.seed}
    bodies: dict[str, Body] = {}
    end = time.monotonic() + 60 * options.minutes
    for k in range(options.first, options.pairs):
        if k in known:
            continue
        if time.monotonic() > end:
            break
        names, placement = _pair(options.seed, k, bodies)
        row = {"seed": options.seed, "pair": k, "names": names}
        row |= _in_a_process(lambda n=names, p=placement, k=k: _row(n, p, bodies, options, k))
        known[k] = row
        with path.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(_line(row), flush=True)
    print(summary(list(known.values())))


def _pair(seed: int, k: int, bodies: dict[str, Body]) -> tuple[list[str], Placement]:
    """Return the names of two templates, and where the second lies; both are compiled."""
    dice = random.Random(f"{seed} {k}")
    usual = [name for name in template_paths() if name not in LEFT_OUT]
    names = [dice.choice(usual), dice.choice(usual)]
    for name in names:
        if name not in bodies:
            bodies[name] = compile_solid(_sized(name)).body
    q = np.array([dice.gauss(0, 1) for _ in range(4)])
    w, x, y, z = q / np.linalg.norm(q)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    low, high = bounding_box(bodies[names[0]].shape)
    share = np.array([dice.random() for _ in range(3)])
    middle = bounding_box(bodies[names[1]].shape).mean(axis=0)
    return names, Placement(turn, low + share * (high - low) - turn @ middle)


def _sized(name: str) -> PointEquation:
    """Return a template's equation, scaled so that its box is about as long as all others'."""
    equation = pc.read_template(template_paths()[name]).bind()
    low, high = bounding_box(compile_solid(equation).body.shape)
    factor = number(Fraction(SIZE / float((high - low).max())).limit_denominator(1000))
    x, y, z = (factor * c for c in equation.coordinates)
    return replace(
        equation, coordinates=(x, y, z), units="mm", guide=None, frame="", layers=(), depth=None,
        fields=(), written=(), mover=None, freer=None, parameters={}, expectations=Expectations(),
    )  # fmt: skip


def _in_a_process(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what a child process finds, or how it ended."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)

    def run() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (MOST, MOST + 5))
        theirs.send(work())

    start = time.monotonic()
    child = context.Process(target=run)
    child.start()
    theirs.close()
    try:
        found = ours.recv()
    except EOFError:  # it has ended without a word
        found = None
    child.join()
    found = found or {"ended": f"exit {child.exitcode}"}
    return found | {"seconds": round(time.monotonic() - start, 1)}


def _row(
    names: list[str], placement: Placement, bodies: Mapping[str, Body], options: Any, k: int
) -> dict[str, Any]:
    first, second = (bodies[name] for name in names)
    volumes = [body.report.solid.volume for body in (first, second)]
    scale = max(volumes)
    made = {}
    for route, make in (("pc2cad", _ours), ("cadquery", _plain)):
        made[route] = {}
        for kind in KINDS:
            path = options.folder / f"{route}-{options.seed}-{k}-{kind}.step"
            start = time.process_time()
            try:
                stated = make(kind, first, second, placement, path)
                row = stated | {"seconds": time.process_time() - start}
                row |= {"readers": readers(path)}
            except PointCadError as error:
                row = {
                    "refused": type(error).__name__, "why": str(error)[:300],
                    "geometric": isinstance(error, GEOMETRIC),
                    "seconds": time.process_time() - start,
                }  # fmt: skip
            except Exception as error:  # CadQuery raises whatever the kernel does
                row = {"refused": type(error).__name__, "why": str(error)[:300]}
            row["holds"] = "readers" in row and _agree(row["readers"], scale)
            made[route][kind] = row
        made[route]["gaps"] = _gaps(made[route], volumes, scale)
    _compared(made, scale)
    for route, kind in ((route, kind) for route in made for kind in KINDS):
        if made[route][kind]["holds"]:
            (options.folder / f"{route}-{options.seed}-{k}-{kind}.step").unlink(missing_ok=True)
    return {"volumes": volumes, **made}


def _compared(made: Mapping[str, Mapping[str, Any]], scale: float) -> None:
    """Mark files of CadQuery whose volume is not that of pc2cad's, whose steps add up."""
    ours, theirs = made["pc2cad"], made["cadquery"]
    known = not any(abs(gap) > AGREE for gap in ours["gaps"])
    for kind in KINDS:
        if known and ours[kind]["holds"] and "readers" in theirs[kind]:
            a, b = (row[kind]["readers"]["kernel"]["volume"] for row in (ours, theirs))
            theirs[kind]["holds"] &= abs(a - b) <= AGREE * scale


def _ours(kind: str, first: Body, second: Body, placement: Placement, path: Path) -> Row:
    """Write what pc2cad makes; return the volume that it states, and if no edge is missing."""
    parts = {"a": first, "b": second}
    tree = Operation(kind, ("a", Pattern("polar", "b", ("1",), (placement,))))  # type: ignore[arg-type]
    equations = {name: replace(body.equation, name=name) for name, body in parts.items()}
    bodies = Bodies(equations, tree, "pair", "pair", "", "mm", {}, Expectations(), lambda *_: tree)

    def halve(body: Body) -> Body:
        checked = halved(body.checked)
        return body if checked is body.checked else compile_checked(checked).body

    def fit(body: Body, tolerance: float) -> Body:
        return compile_checked(body.checked, CompileOptions(tolerance)).body

    part = compile_bodies(bodies, lambda equation, tell: parts[equation.name], halve, fit)
    part.write(path)
    topology = part.report.steps[-1].topology
    return {"volume": part.volume, "topology": topology.evidence if topology else ""}


def _plain(kind: str, first: Body, second: Body, placement: Placement, path: Path) -> Row:
    """Write what CadQuery makes of the same solids; return what it takes the volume for."""
    import cadquery as cq

    from pc2cad.brep.booleans import NamedShape, moved

    there = moved(NamedShape(second.shape, ()), placement.turn, placement.offset, "").shape
    a, b = cq.Shape.cast(first.shape), cq.Shape.cast(there)
    shape = {"union": a.fuse, "cut": a.cut, "intersect": a.intersect}[kind](b)
    shape.exportStep(str(path))
    return {"volume": float(shape.Volume())}


def readers(path: Path) -> dict[str, Any]:
    """Return what each reader finds: number of solids, volume, and whether it is valid."""
    found = {"kernel": _by_kernel(path), "receipt": _by_receipt(path)}
    if find_spec("gmsh"):
        found["gmsh"] = _by_gmsh(path)
    return found


def _by_kernel(path: Path) -> dict[str, Any]:
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPControl import STEPControl_Reader

    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        return {"solids": 0, "volume": 0.0, "valid": False}
    reader.TransferRoots()
    return _measured(reader.OneShape())


def _measured(shape: Any) -> dict[str, Any]:
    from OCP.BRepCheck import BRepCheck_Analyzer

    from pc2cad.brep.booleans import NamedShape
    from pc2cad.brep.integrals import solid_integrals

    if shape.IsNull():
        return {"solids": 0, "volume": 0.0, "valid": False}
    solids = NamedShape(shape, ()).solids
    try:
        volume = sum(solid_integrals(solid).volume for solid in solids)
    except KernelError:  # edges so far off their faces that nothing settles
        volume = 0.0
    return {
        "solids": len(solids), "volume": volume,
        "valid": bool(solids) and BRepCheck_Analyzer(shape).IsValid(),
    }  # fmt: skip


def _by_receipt(path: Path) -> dict[str, Any]:
    try:
        found = pc.receipt(path)
    except PointCadError as error:
        return {"solids": 0, "volume": 0.0, "valid": False, "why": str(error)[:200]}
    solids = found["solids"]
    return {
        "solids": len(solids), "volume": sum(solid["volume"] or 0.0 for solid in solids),
        "valid": found["sound"], "why": "; ".join((*found["defects"], *found["unknown"]))[:300],
    }  # fmt: skip


def _by_gmsh(path: Path) -> dict[str, Any]:
    """Return what gmsh reads, measured by our own rule on what it writes again as BREP.

    Its own volumes of rational faces are a hundredth off, by the kernel's rule.
    """
    import gmsh
    from OCP.BRep import BRep_Builder
    from OCP.BRepTools import BRepTools
    from OCP.TopoDS import TopoDS_Shape

    again = path.with_suffix(".brep")
    gmsh.initialize(["x", "-v", "0"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Geometry.OCCAutoFix", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        gmsh.write(str(again))
        shape = TopoDS_Shape()
        BRepTools.Read_s(shape, str(again), BRep_Builder())
        return _measured(shape)
    except Exception as error:  # gmsh raises the base class
        return {"solids": 0, "volume": 0.0, "valid": False, "why": str(error)[:200]}
    finally:
        gmsh.finalize()
        again.unlink(missing_ok=True)


def _agree(found: Mapping[str, Mapping[str, Any]], scale: float) -> bool:
    """Say whether all readers find valid solids, as many and of one volume.

    pc2cad makes one solid or none; CadQuery's file may hold several pieces, or none where nothing
    is left.
    """
    volumes = [row["volume"] for row in found.values()]
    return (
        len({row["solids"] for row in found.values()}) == 1
        and all(row["valid"] or not row["solids"] for row in found.values())
        and max(volumes) - min(volumes) <= AGREE * scale
    )


def _gaps(made: Mapping[str, Any], volumes: list[float], scale: float) -> list[float]:
    """Return what V(A) + V(B) = V(union) + V(common) and V(A) = V(cut) + V(common) miss."""
    read = {
        kind: row["readers"]["kernel"]["volume"]
        if row.get("readers") else 0.0 if row["refused"] == "EmptyResultError" else None
        for kind, row in ((kind, made[kind]) for kind in KINDS)
    }  # fmt: skip
    gaps = []
    if None not in (read["union"], read["intersect"]):
        gaps.append((sum(volumes) - read["union"] - read["intersect"]) / scale)
    if None not in (read["cut"], read["intersect"]):
        gaps.append((volumes[0] - read["cut"] - read["intersect"]) / scale)
    return gaps


def _line(row: Mapping[str, Any]) -> str:
    said = []
    for route in ("pc2cad", "cadquery"):
        if route in row:
            for kind in KINDS:
                x = row[route][kind]
                said.append("ok" if x["holds"] else x.get("refused", "WRONG"))
            said.append(" ".join(f"{gap:.0e}" for gap in row[route]["gaps"]))
    return f"{row['pair']:4d} {' + '.join(row['names'])}: {', '.join(said)} " + str(
        row.get("ended", "")
    )


def summary(rows: list[dict[str, Any]]) -> str:
    """Return what all pairs came to."""
    lines = [f"{len(rows)} pairs, {sum('ended' in row for row in rows)} without an answer"]
    for route in ("pc2cad", "cadquery"):
        made = [row[route][kind] for row in rows if route in row for kind in KINDS]
        gaps = [abs(gap) for row in rows if route in row for gap in row[route]["gaps"]]
        refused = Counter(x["refused"] for x in made if "refused" in x)
        wrong = [x for x in made if "refused" not in x and not x["holds"]]
        without = [x for x in made if "refused" in x and not x.get("geometric")]
        lines.append(
            f"{route}: {len(made)} Booleans, {sum(x['holds'] for x in made)} hold, {len(wrong)} "
            f"files wrong, {len(without)} refused without geometric cause; refused: "
            f"{dict(refused)}; {sum(g > AGREE for g in gaps)} of {len(gaps)} sums do not add up, "
            f"largest gap {max(gaps, default=0):.1e}; "
            f"{sum(x.get('seconds', 0) for x in made) / max(1, len(made)):.2f} s of CPU each"
        )
    ours = [row["pc2cad"][kind] for row in rows if "pc2cad" in row for kind in KINDS]
    known = Counter(x["topology"] for x in ours if "topology" in x)
    lines.append(f"no edge missing: {dict(known)}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
