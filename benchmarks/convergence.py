"""Draws docs/pictures/convergence.png: hexahedra, tetrahedra and splines at equal unknowns.

    python benchmarks/convergence.py

Heat through the wall of the bent pipe (template elbow_pipe) and of the paper's elliptic channel
(channel_ellipse): CalculiX on order-2 hexahedra and tetrahedra, MFEM on splines. The pipe's spline
is exact and rational; its degrees are raised and its spans halved. The channel's is fitted anew for
every size, of the degree that the temperature shall have: MFEM's own raising of degrees fails where
they differ. The reference is the finest spline's value. Prints the figures.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "examples"))

import solvers  # noqa: E402

from pc2cad.checked import check_map  # noqa: E402
from pc2cad.compiler import mesh_equation  # noqa: E402
from pc2cad.domain.restrictions import RestrictedMap  # noqa: E402
from pc2cad.equation.point_equation import PointEquation  # noqa: E402
from pc2cad.geometry.splines.rational import Parametrisation  # noqa: E402
from pc2cad.geometry.splines.spline_space import SplineSpace  # noqa: E402
from pc2cad.geometry.splines.trivariate import fit_volume  # noqa: E402
from pc2cad.mesh.meshing import MeshOptions  # noqa: E402
from pc2cad.mesh.volume_mesh import VolumeMesh  # noqa: E402
from pc2cad.representation.volume import Patch, VolumeModel, turned  # noqa: E402
from pc2cad.templates.file import read_template  # noqa: E402


def unknowns(mesh: VolumeMesh) -> int:
    return len(mesh.points) - len(mesh.node_sets["w=0"]) - len(mesh.node_sets["w=1"])


def fitted(equation: PointEquation, spans: tuple[int, int, int], degree: int) -> VolumeModel:
    """Return M as splines of one degree over even spans along u, v and w."""
    checked = check_map(equation)
    analysis, directions = checked.analysis, checked.orientation.axes
    function = turned(RestrictedMap(analysis, (1, 1, 1), degree), directions)
    spaces = [SplineSpace(degree, np.linspace(0, 1, n + 1), [1] * (n - 1)) for n in spans]
    a, b, c = (Parametrisation(spaces[d]) for d in directions)
    volume = fit_volume(function, (a, b, c))
    patch = Patch((1, 1, 1), volume, math.nan, 0)
    return VolumeModel(equation.name, equation.units, directions, (patch,), (1, 1, 1),
                       analysis.boundary, "sampled", math.nan)  # fmt: skip


Found = dict[str, list[tuple[int, float]]]


def meshes(equation: PointEquation, cells: list[tuple[int, int, int]], sizes: list[float]) -> Found:
    found: Found = {"hexahedra, order 2 (CalculiX)": [], "tetrahedra, order 2 (gmsh, CalculiX)": []}
    hexahedra, tetrahedra = found.values()
    for counts in cells:
        mesh = solvers.mesh(equation, counts)
        hexahedra.append((unknowns(mesh), solvers.conductance(mesh)))
    for size in sizes:
        mesh, _ = mesh_equation(equation, MeshOptions(size=size, order=2, shape="tetrahedra"))
        tetrahedra.append((unknowns(mesh), solvers.conductance(mesh)))
    return found


def pipe() -> tuple[Found, float]:
    equation = read_template(ROOT / "templates" / "elbow_pipe.toml").bind({})
    _, reference = solvers.isogeometric_conductance(equation, 1, 4)
    splines = [
        solvers.isogeometric_conductance(equation, halved, raised)
        for raised, halved in ((1, 0), (2, 0), (3, 0), (3, 1), (4, 0))
    ]
    cells = [(n, n, max(1, n // 6)) for n in (4, 8, 12, 16, 24, 32)]
    found = meshes(equation, cells, [2.0, 1.0, 0.5, 0.3, 0.2, 0.14])
    return {"splines (MFEM)": splines, **found}, reference


def channel() -> tuple[Found, float]:
    equation = read_template(ROOT / "templates" / "channel_ellipse.toml").bind({})
    splines = [
        solvers.conductance_of_splines(fitted(equation, (n, 2 * n, 1), degree))
        for n, degree in ((3, 2), (3, 3), (6, 3), (6, 4), (9, 4), (12, 4))
    ]
    _, reference = solvers.conductance_of_splines(fitted(equation, (15, 30, 1), 5))
    cells = [(n, 2 * n, max(1, n // 8)) for n in (4, 6, 8, 12, 16, 24)]
    found = meshes(equation, cells, [2.0, 1.0, 0.7, 0.5, 0.35])
    return {"splines (MFEM)": splines, **found}, reference


def main() -> None:
    problems = {"bent pipe": pipe(), "elliptic channel of the paper": channel()}
    for title, (found, reference) in problems.items():
        print(f"{title}: reference {reference:.10g}")
        for name, values in found.items():
            print(" ", name, ", ".join(f"{n}: {abs(q / reference - 1):.1e}" for n, q in values))
    draw(problems)


def draw(problems: dict[str, tuple[Found, float]]) -> None:
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(10.4, 4.2), layout="constrained", sharey=True)
    for axes, (title, (found, reference)) in zip(panels, problems.items(), strict=True):
        for (name, values), mark, colour in zip(
            found.items(), "so^", ("#0072b2", "#d55e00", "#009e73"), strict=True
        ):
            count, value = np.array(values).T
            axes.loglog(count, np.abs(value / reference - 1), mark + "-", color=colour, label=name)
        axes.set_xlabel("unknowns")
        axes.set_title(f"Heat through the wall: {title}", fontsize=10)
        axes.grid(visible=True, which="major", alpha=0.4)
    panels[0].set_ylabel("relative error of the heat flow")
    panels[0].legend(fontsize=8)
    figure.savefig(ROOT / "docs" / "pictures" / "convergence.png", dpi=110)


if __name__ == "__main__":
    main()
