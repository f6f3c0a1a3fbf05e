"""The same bytes whatever the threads, the hash seed, the order of work and the locale."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pc2cad.arrays.linear import inverse, product, solve, tensor, thickness

SCRIPT = """
import json
import sys
import pc2cad
from pc2cad.compiler import compile_equation
from pc2cad.templates.shipped import find_template
folder, solids, meshes, names = sys.argv[1:]
for name in names.split(","):
    template, *given = name.split("_with_")
    values = dict(pair.split("=") for pair in given)
    part = compile_equation(pc2cad.read_template(find_template(template)).bind(values))
    for ending in solids.split():
        part.write(f"{folder}/{name}.{ending}")
    report = part.report.to_dict()
    del report["times"]
    with open(f"{folder}/{name}-report.json", "w") as stream:
        json.dump(report, stream, default=str)
    if meshes:
        mesh = part.mesh()
        for ending in meshes.split():
            pc2cad.write_mesh(mesh, f"{folder}/{name}-mesh.{ending}")
"""
WAYS = (
    {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "1"},
    {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "PYTHONHASHSEED": "2", "LC_ALL": "C"},
)


def written(folder: Path, names: list[str], solids: str, meshes: str) -> list[dict[str, str]]:
    """Return the hashes of files that two processes write at once, in opposite orders."""
    running = []
    for number, way in enumerate(WAYS):
        own = folder / str(number)
        own.mkdir()
        command = [sys.executable, "-c", SCRIPT, str(own), solids, meshes,
                   ",".join(names[:: 1 - 2 * number])]  # fmt: skip
        environment = {**os.environ, "SOURCE_DATE_EPOCH": "0", **way}
        running.append((own, subprocess.Popen(command, env=environment)))
    assert [process.wait(timeout=300) for _, process in running] == [0] * len(WAYS)
    return [
        {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in sorted(own.iterdir())}
        for own, _ in running
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "other"),
    # a variant is built in a process of its own, and after another one of its template
    [("channel_sine", "channel_sine_with_delta=0.31"), ("duct", "ball")],
)
def test_files_of_all_formats_are_the_same(tmp_path: Path, name: str, other: str) -> None:
    solids, meshes = "step brep igs stl ast 3mf glb vtp", "vtu inp msh vtk"
    first, second = written(tmp_path, [name, other], solids, meshes)
    assert len(first) == 2 * 13
    assert first == second


def test_each_variant_is_that_of_a_process_of_its_own(tmp_path: Path) -> None:
    # in the one process a variant is the first, in the other it comes after all the others
    names = [f"channel_ellipse_with_delta={x}_with_s={y}" for x, y in (
        ("0.2", "0.5"), ("0.31", "0.5"), ("0.45", "0.25"), ("0.5", "0.5"), ("0.6", "0.5"),
    )]  # fmt: skip
    names[2:2] = [f"pyramid_cut_with_p={x}" for x in ("0.2", "0.45", "0.7")]
    first, second = written(tmp_path, names, "step", "")
    assert len(first) == 2 * 8
    assert first == second


@pytest.mark.parametrize(
    "shape",
    [(3, 4, 5), (500, 60, 600), (70, 3000, 90), (5000, 64, 64), (64, 64, 5000), (90_000, 3, 3)],
)
def test_products_in_blocks_are_products(shape: tuple[int, int, int]) -> None:
    m, k, n = shape
    random = np.random.default_rng(3)
    a, b = random.normal(size=(m, k)), random.normal(size=(k, n))
    size = np.sqrt(k)
    assert np.abs(product(a, b) - a @ b).max() <= 1e-13 * size**2
    assert np.abs(product(a, b[:, 0]) - a @ b[:, 0]).max() <= 1e-13 * size**2
    assert np.abs(product(a[0], b) - a[0] @ b).max() <= 1e-13 * size**2


@pytest.mark.parametrize(
    ("shape", "rows", "columns"),
    [((3, 5, 7), 11, 13), ((4, 40, 3), 9, 500), ((3, 300, 20), 1000, 20), ((1, 2, 400), 3, 700)],
)
def test_sums_over_two_axes_are_those_of_each_part(
    shape: tuple[int, int, int], rows: int, columns: int
) -> None:
    draw = np.random.default_rng(3)
    a, values, b = (
        draw.random(size) for size in ((rows, shape[1]), shape, (columns, shape[2]))
    )  # fmt: skip
    found = tensor(rows, values, b)
    wanted = np.einsum("pi,kij,qj->kpq", a, values, b, optimize=True)
    assert found(a) == pytest.approx(wanted, rel=1e-13)
    assert found(a[:2]) == pytest.approx(wanted[:, :2], rel=1e-13)


@pytest.mark.parametrize("size", [1, 60, 73, 200])
def test_systems_are_solved_with_pivots(size: int) -> None:
    random = np.random.default_rng(4)
    matrix = random.normal(size=(size, size))
    matrix[0, 0] = 0.0 if size > 1 else 1.0
    right = random.normal(size=(size, 3))
    assert solve(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-8)
    assert solve(matrix, right[:, 0]) == pytest.approx(solve(matrix, right)[:, 0], rel=1e-12)
    assert product(matrix, inverse(matrix)) == pytest.approx(np.eye(size), abs=1e-9)


def test_a_singular_system_is_said_to_be() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solve(np.ones((80, 80)), np.ones(80))


@pytest.mark.parametrize("flat", [1.0, 1e-2, 1e-5, 1e-9, 0.0])
@pytest.mark.parametrize("size", [1.0, 1e-8, 1e40])
def test_the_least_singular_value_is_bounded_from_below(flat: float, size: float) -> None:
    random = np.random.default_rng(5)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    for count in (3, 20, 500):
        vectors = random.normal(size=(count, 3)) * (1.0, 0.5, flat) @ axes * size
        values = np.linalg.svd(vectors, compute_uv=False)
        least, whole = thickness(vectors)
        assert 0 <= least <= values[2]
        assert whole == pytest.approx(np.linalg.norm(vectors), rel=1e-12)
        if flat >= 1e-2:
            assert least > 0.2 * values[2]


def test_what_is_no_number_has_no_thickness() -> None:
    for value in (0.0, np.nan, 1e120):
        assert thickness(np.full((4, 3), value))[0] == 0.0
