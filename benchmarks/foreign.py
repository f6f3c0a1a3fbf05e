"""Random valid STEP files of other programs, judged: ``python -m benchmarks.foreign FOLDER``.

Each seed makes one solid in CadQuery, build123d or FreeCAD (where `freecadcmd` is) that its own
kernel calls valid; files that lose faces or volume on the way into their own program again are no
valid files and are made anew. A receipt with a defect is a false alarm. With ``--second`` gmsh and
CadQuery read each file as well, and all must agree on solids, faces, volume and area.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

#: relative error that the kernel's adaptive rule is asked for
ADAPTIVE = 1e-7
#: Gmsh's plain rule is up to a hundredth off on trimmed splines, the adaptive one on extrusions:
#: that which is nearer is asked for this much
RULES, AGREE = ("", "adaptive "), 1e-3

#: makes solids in FreeCAD, whose Python is reached through freecadcmd alone
FREECAD = """
import random
import FreeCAD, Part
from FreeCAD import Vector

def made(dice):
    r = lambda a, b: round(dice.uniform(a, b), 3)
    kind = dice.randrange(9)
    a, b, c = r(4, 12), r(4, 12), r(4, 12)
    if kind == 0:
        shape = Part.makeBox(a, b, c)
    elif kind == 1:
        turn = dice.choice([360, r(40, 300)])
        shape = Part.makeCylinder(a / 3, b, Vector(), Vector(0, 0, 1), turn)
    elif kind == 2:
        shape = Part.makeCone(a / 3, dice.choice([0, b / 4]), c)
    elif kind == 3:
        shape = Part.makeSphere(a / 2)
    elif kind == 4:
        shape = Part.makeTorus(a, a / 4)
    elif kind == 5:
        shape = Part.makeWedge(0, 0, 0, a / 4, a / 4, a, b, c, 3 * a / 4, 3 * a / 4)
    elif kind == 6:
        shape = Part.makeBox(a, b, c).makeFillet(r(0.3, 1), Part.makeBox(a, b, c).Edges[:4])
    elif kind == 7:
        wire = Part.makePolygon([Vector(a, 0, 0), Vector(a + b, 0, 0), Vector(a + b / 2, 0, c),
                                 Vector(a, 0, 0)])
        shape = Part.Face(wire).revolve(Vector(), Vector(0, 0, 1), dice.choice([360, r(40, 300)]))
    else:
        points = [Vector(0, 0, 0), Vector(a, b / 4, 0), Vector(a, b, 0), Vector(0, b, 0)]
        curve = Part.BSplineCurve()
        curve.interpolate(points, PeriodicFlag=True)
        shape = Part.Face(Part.Wire(curve.toShape())).extrude(Vector(r(0, 2), 0, c))
    if dice.random() < 0.5:
        tool = Part.makeCylinder(r(0.5, 1), 60, Vector(r(1, 3), r(1, 3), -30))
        shape = shape.cut(tool) if dice.random() < 0.5 else shape.fuse(tool)
    if dice.random() < 0.2:  # all on rational splines
        turn = FreeCAD.Rotation(Vector(r(-1, 1), r(-1, 1), 1), r(0, 360))
        return shape.transformGeometry(FreeCAD.Placement(Vector(a, b, 0), turn).toMatrix())
    return shape.translated(Vector(r(-99, 99), r(-99, 99), 0))

for seed, path in SEEDS:
    dice = random.Random(seed)
    for _ in range(20):
        try:
            shape = made(dice)
        except Exception:
            continue
        faces = sum(len(solid.Faces) for solid in shape.Solids)
        if not (shape.isValid() and 0 < faces == len(shape.Faces)):
            continue
        shape.exportStep(path)
        back = Part.read(path)
        same = abs(back.Volume - shape.Volume) < 1e-6 * shape.Volume
        if back.isValid() and len(back.Faces) == faces and same:
            break
    else:
        import os
        if os.path.exists(path):
            os.remove(path)
"""


def cadquery_solid(dice: random.Random) -> Any:
    """Return a Workplane of a random solid."""
    import cadquery as cq

    def r(low: float, high: float) -> float:
        return round(dice.uniform(low, high), 3)

    a, b, c = r(4, 12), r(4, 12), r(4, 12)
    plane = cq.Workplane(dice.choice(["XY", "XZ", "YZ"]), origin=(r(-9, 9), r(-9, 9), r(-99, 99)))
    bases = {
        "box": lambda: plane.box(a, b, c),
        "filleted": lambda: plane.box(a, b, c).edges(dice.choice(["|Z", ">Z", ""])).fillet(0.7),
        "chamfered": lambda: plane.box(a, b, c).edges(dice.choice(["|Z", ">Z", ""])).chamfer(0.6),
        "cylinder": lambda: plane.circle(a / 2).extrude(b, taper=dice.choice([0, r(1, 9)])),
        "ellipse": lambda: plane.ellipse(a, b).extrude(c),
        "polygon": lambda: plane.polygon(dice.randrange(3, 9), a).extrude(b),
        "slot": lambda: plane.slot2D(2 * a, 3).extrude(b),
        "ball": lambda: plane.sphere(a / 2),
        "wedge": lambda: plane.wedge(a, b, c, 1, 1, a - 1, c - 1),
        "torus": lambda: plane.add(cq.Solid.makeTorus(a, a / 4)),
        "cone": lambda: plane.add(cq.Solid.makeCone(a, dice.choice([0, a / 3]), b)),
        "turned": lambda: plane.moveTo(a, 0).lineTo(a + b, 1).lineTo(a + b, c).close()
        .revolve(dice.choice([360, r(30, 330)]), (0, 0, 0), (0, 1, 0)),
        "turned spline": lambda: plane.moveTo(2, 0).spline([(4, 2), (3, c)], includeCurrent=True)
        .lineTo(0, c).lineTo(0, 0).close().revolve(360, (0, 0, 0), (0, 1, 0)),
        "twisted": lambda: plane.polygon(4, a).twistExtrude(b, r(10, 60)),
        "loft": lambda: plane.rect(a, b).workplane(offset=c).circle(a / 3)
        .loft(ruled=dice.random() < 0.5),
        "spline": lambda: plane.spline([(0, 0), (a, 1), (a, b), (1, b)]).close().extrude(c),
        "swept": lambda: cq.Workplane().circle(1).sweep(
            cq.Workplane("XZ").spline([(0, 0), (r(1, 3), b), (0, 2 * b)])),
        "shelled": lambda: plane.box(a, b, c).faces(">Z").shell(-0.5),
        "hollow": lambda: plane.sphere(a).cut(plane.sphere(a / 2)),
    }  # fmt: skip
    solid = bases[dice.choice(sorted(bases))]()
    more = dice.randrange(5)
    if more == 1:
        solid = solid.cut(cq.Workplane().circle(r(0.5, 1.5)).extrude(99, both=True))
    elif more == 2:
        solid = solid.union(plane.box(3, 3, 3).translate((r(0, 2), r(0, 2), r(0, 2))))
    elif more == 3:
        solid = solid.intersect(plane.sphere(r(5, 20)))
    return solid.rotate((0, 0, 0), (1, r(0, 1), 0), dice.choice([0, r(0, 90)]))


def cadquery_files(seeds: Sequence[tuple[int, Path]]) -> None:
    import cadquery as cq

    for seed, path in seeds:
        dice = random.Random(seed)
        for _ in range(20):
            try:
                shape = cadquery_solid(dice).combine().val()
            except Exception:  # what cannot be made is no file
                continue
            if not (shape.isValid() and shape.Solids() and shape.Volume() > 0.0):
                continue
            cq.exporters.export(cq.Workplane(shape), str(path), "STEP")
            back = cq.importers.importStep(str(path))
            if _as_written([shape], back.vals()):
                break
            path.unlink()


def _as_written(shapes: Sequence[Any], back: Sequence[Any]) -> bool:
    """Say whether a file reads back valid, with as many faces and the same volume."""
    faces, volume = (sum(len(s.Faces()) for s in shapes), sum(s.Volume() for s in shapes))
    return (
        all(s.isValid() for s in back)
        and sum(len(s.Faces()) for s in back) == faces
        and faces == sum(len(solid.Faces()) for s in shapes for solid in s.Solids())
        and abs(sum(s.Volume() for s in back) - volume) <= 1e-6 * volume
    )


def build123d_files(seeds: Sequence[tuple[int, Path]]) -> None:
    import build123d as bd

    for seed, path in seeds:
        dice = random.Random(seed)
        for _ in range(20):
            try:
                shape = build123d_solid(dice)
            except Exception:  # what cannot be made is no file
                continue
            if not (shape.is_valid and shape.solids() and shape.volume > 0.0):
                continue
            bd.export_step(shape, str(path))
            back = bd.import_step(str(path))
            faces = sum(len(solid.faces()) for solid in shape.solids())
            if (
                back.is_valid
                and len(back.faces()) == faces
                and abs(back.volume - shape.volume) <= 1e-6 * shape.volume
            ):
                break
            path.unlink()


def build123d_solid(dice: random.Random) -> Any:
    import build123d as bd

    def r(low: float, high: float) -> float:
        return round(dice.uniform(low, high), 3)

    a, b, c = r(4, 12), r(4, 12), r(4, 12)
    kind = dice.randrange(9)
    if kind == 0:
        shape = bd.fillet(bd.Box(a, b, c).edges().filter_by(bd.Axis.Z), 0.8)
    elif kind == 1:
        shape = bd.chamfer(bd.Cylinder(a / 2, b).edges()[:1], 0.4)
    elif kind == 2:
        shape = bd.Cone(a, dice.choice([0, a / 2]), b)
    elif kind == 3:
        shape = bd.Sphere(a)
    elif kind == 4:
        shape = bd.Torus(a, a / 3)
    elif kind == 5:
        shape = bd.extrude(bd.RegularPolygon(a, dice.randrange(3, 8)), b, taper=dice.choice([0, 3]))
    elif kind == 6:
        circle = bd.Plane.XY.offset(c) * bd.Circle(a / 3)
        shape = bd.loft([(bd.Plane.XY * bd.Rectangle(a, b)).face(), circle.face()])
    elif kind == 7:
        shape = bd.extrude(bd.Ellipse(a, b), c)
    else:
        profile = bd.Plane.XZ * bd.Pos(a + 4, 0) * bd.Rectangle(a / 2, b)
        shape = bd.revolve(profile, bd.Axis.Z, dice.choice([360, r(30, 330)]))
    more = dice.randrange(4)
    if more == 1:
        shape = shape - bd.Pos(r(0, 2), r(0, 2), 0) * bd.Cylinder(r(0.5, 1.5), 99)
    elif more == 2:
        shape = shape + bd.Pos(r(0, 2), r(0, 2), r(0, 2)) * bd.Box(3, 3, 3)
    return bd.Pos(r(-9, 9), r(-9, 9), r(-99, 99)) * bd.Rot(r(0, 90), r(0, 90), 0) * shape


def freecad_files(seeds: Sequence[tuple[int, Path]]) -> None:
    command = next((c for c in ("freecadcmd", "FreeCADCmd") if shutil.which(c)), None)
    if command is None or not seeds:
        return
    script = seeds[0][1].with_suffix(".py")
    listed = [(seed, str(path.resolve())) for seed, path in seeds]
    script.write_text(f"SEEDS = {listed!r}\n{FREECAD}")
    subprocess.run(
        [command, "-c", f"exec(open({str(script.resolve())!r}).read())"],
        stdin=subprocess.DEVNULL, capture_output=True, timeout=3600, check=True,
    )  # fmt: skip
    script.unlink()


MAKERS = {"cadquery": cadquery_files, "build123d": build123d_files, "freecad": freecad_files}


def make(folder: Path, count: int, seed: int, programs: Sequence[str]) -> list[Path]:
    """Write so many files, of each program in turn; return those there are."""
    folder.mkdir(parents=True, exist_ok=True)
    plan: dict[str, list[tuple[int, Path]]] = {program: [] for program in programs}
    for k in range(count):
        program = programs[k % len(programs)]
        path = folder / f"{program}-{seed + k}.step"
        plan[program].append((seed + k, path))
    for program, seeds in plan.items():
        MAKERS[program]([item for item in seeds if not item[1].exists()])
    return [path for seeds in plan.values() for _, path in seeds if path.exists()]


def judge(paths: Sequence[Path]) -> Iterator[tuple[Path, dict[str, Any], float]]:
    """Yield the receipt of every file, and the seconds of CPU it took."""
    from pc2cad.verify.receipt import receipt

    for path in paths:
        start = time.process_time()
        yield path, receipt(path), time.process_time() - start


def second(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Return what two kernels find in the files: gmsh's without healing, CadQuery's adaptively."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    import cadquery as cq
    from consumers.gmsh_reader import read_all_in_gmsh
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = []
    for path, other in zip(paths, read_all_in_gmsh(list(paths), timeout=1800.0), strict=True):
        volume, area = GProp_GProps(), GProp_GProps()
        for shape in cq.importers.importStep(str(path)).vals():
            BRepGProp.VolumeProperties_s(shape.wrapped, volume, ADAPTIVE)
            BRepGProp.SurfaceProperties_s(shape.wrapped, area, ADAPTIVE)
        found.append(
            {
                **other,
                "adaptive volume": volume.Mass(),
                "adaptive area": area.Mass(),
            }
        )
    return found


def disagreement(found: dict[str, Any], other: dict[str, Any]) -> str:
    """Say in what a receipt differs from what both kernels find; empty where in nothing."""
    solids = found["solids"]
    scale = solids[0]["unit_m"] * 1e3 if solids else 1.0
    told = []
    for key, own in (("volumes", len(solids)), ("surfaces", sum(s["faces"] for s in solids))):
        if own != other[key]:
            told.append(f"{key} {own} against {other[key]}")
    for key, power in (("volume", 3), ("area", 2)):
        own = sum(solid[key] or 0.0 for solid in solids) * scale**power
        if not min(abs(own - other[rule + key]) for rule in RULES) <= AGREE * own:
            told.append(f"{key} {own:.10g} against {[other[rule + key] for rule in RULES]}")
    return ", ".join(told)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--programs", nargs="+", choices=MAKERS, default=list(MAKERS))
    parser.add_argument("--second", action="store_true", help="ask gmsh and CadQuery as well")
    options = parser.parse_args()
    paths = make(options.folder, options.count, options.seed, options.programs)
    found, told = {}, Counter[str]()
    for path, receipt, seconds in judge(paths):
        found[path] = receipt
        told[str(receipt["sound"])] += 1
        for sentence in [*receipt["defects"], *receipt["unknown"]]:
            print(f"{path.name} ({receipt['sound']}, {seconds:.1f} s): {sentence}", flush=True)
    print(f"{len(paths)} files: {json.dumps(told)}")
    if options.second:
        others = second(paths)
        wrong = [(path.name, words) for (path, receipt), other in
                 zip(found.items(), others, strict=True)
                 if (words := disagreement(receipt, other))]  # fmt: skip
        for name, words in wrong:
            print(f"{name}: {words}")
        print(f"gmsh and CadQuery agree on {len(paths) - len(wrong)} of {len(paths)}")


if __name__ == "__main__":
    main()
