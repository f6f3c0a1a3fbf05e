"""Ten million nodes of hexahedra: seconds and memory, beside plain NumPy and the disk.

    python benchmarks/hexahedra.py [FOLDER] [MILLIONS]

Each step runs in a process of its own. Plain NumPy is the coordinate-wise system as one expression
per coordinate (SymPy's lambdify) on full arrays of u, v and w; the disk writes as many bytes as the
mesh file has, from memory in 1 MB pieces, and syncs. Either writes three times and the fastest
counts: the first time pays for memory that the system had not given out before. CPU seconds; the
ratios are what travels from machine to machine.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

TEMPLATES = ("channel_sine", "channel_contour", "hollow_ball", "torus")
ROOT = Path(__file__).parent.parent
WRITES = 3


def grid_of(name: str, nodes: float) -> tuple[int, int, int]:
    thin = name.startswith("channel")
    w = 8 if thin else round(nodes ** (1 / 3))
    side = round((nodes / (w + 1)) ** 0.5)
    return side, side, w


def equation_of(name: str):
    from pc2cad.templates.file import read_template

    return read_template(ROOT / "templates" / f"{name}.toml").bind({})


def mesh_and_write(name: str, nodes: float, path: str) -> dict[str, float]:
    from pc2cad.checked import check_map
    from pc2cad.export.mesh_files import write_mesh
    from pc2cad.mesh.grid import make_grid
    from pc2cad.mesh.hexahedra import hexahedra
    from pc2cad.mesh.quality import measure

    checked = check_map(equation_of(name))
    grid = make_grid(checked, grid_of(name, nodes))
    laps = [clock()]
    mesh = hexahedra(checked, grid)
    laps.append(clock())
    wall = min(timed(lambda: write_mesh(mesh, path)) for _ in range(WRITES))
    laps.append(clock())
    peak = memory()
    measure(mesh)
    laps.append(clock())
    cpu = np.diff([lap[0] for lap in laps])
    return {
        "nodes": len(mesh.points), "mesh": cpu[0], "write": cpu[1] / WRITES, "quality": cpu[2],
        "write wall": wall, "bytes": Path(path).stat().st_size, "peak": peak,
    }  # fmt: skip


def points_only(name: str, nodes: float, path: str) -> dict[str, float]:
    """Only M on the grid, in slabs that stay in the cache."""
    from pc2cad.domain.map import local_map, open_grid
    from pc2cad.expression.parameters import PARAMETERS  # noqa: F401

    mapping = local_map(equation_of(name))
    u, v, w = (np.linspace(0, 1, n + 1) for n in grid_of(name, nodes))
    points = np.empty((len(u), len(v), len(w), 3))
    start = clock()
    step = max(1, (1 << 16) // (len(v) * len(w)))
    for i in range(0, len(u), step):
        points[i : i + step] = mapping.points(*open_grid(u[i : i + step], v, w))
    return {"seconds": clock()[0] - start[0], "peak": memory()}


def plain_numpy(name: str, nodes: float, path: str) -> dict[str, float]:
    import sympy

    import pc2cad as pc

    equation = equation_of(name)
    trees = [pc.to_sympy(tree) for tree in equation.coordinates]
    arguments = sympy.symbols("u v w")
    functions = [sympy.lambdify(arguments, tree, "numpy", cse=True) for tree in trees]
    axes = [np.linspace(a, b, n + 1)
            for (a, b), n in zip(equation.limits, grid_of(name, nodes), strict=True)]  # fmt: skip
    u, v, w = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
    start = clock()
    points = np.empty((len(u), 3))
    for axis, function in enumerate(functions):
        points[:, axis] = function(u, v, w)
    return {"seconds": clock()[0] - start[0], "peak": memory()}


def disk(name: str, size: float, path: str) -> dict[str, float]:
    data = memoryview(np.random.default_rng(1).bytes(int(size)))

    def write() -> None:
        with open(path, "wb", buffering=0) as stream:
            for start in range(0, len(data), 1 << 20):
                stream.write(data[start : start + (1 << 20)])
            os.fsync(stream.fileno())

    return {"wall": min(timed(write) for _ in range(WRITES))}


def timed(run: Callable[[], object]) -> float:
    """Return the wall seconds that a call takes."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def clock() -> tuple[float, float]:
    return time.process_time(), time.perf_counter()


def memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def alone(run: Callable[..., dict[str, float]], *arguments: object) -> dict[str, float]:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(run, arguments)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
    nodes = 1e6 * (float(sys.argv[2]) if len(sys.argv) > 2 else 10.0)
    path = str(folder / "benchmark.vtu")
    rows = {}
    for name in TEMPLATES:
        ours = alone(mesh_and_write, name, nodes, path)
        points = alone(points_only, name, nodes, path)
        plain = alone(plain_numpy, name, nodes, path)
        raw = alone(disk, name, ours["bytes"], path)
        Path(path).unlink()
        rows[name] = {"mesh": ours, "points": points, "numpy": plain, "disk": raw}
        print(
            f"{name}: {ours['nodes'] / 1e6:.1f}e6 nodes; points {points['seconds']:.2f} s "
            f"({points['seconds'] / plain['seconds']:.2f} of NumPy's {plain['seconds']:.2f} s); "
            f"mesh {ours['mesh']:.2f} s, write {ours['write']:.2f} s CPU, "
            f"{ours['write wall']:.2f} s wall ({ours['write wall'] / raw['wall']:.2f} of the "
            f"disk's {raw['wall']:.2f} s); quality {ours['quality']:.2f} s; peak "
            f"{ours['peak'] / 1e6:.0f} MB ({ours['peak'] / plain['peak']:.2f} of NumPy's)",
            flush=True,
        )
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
