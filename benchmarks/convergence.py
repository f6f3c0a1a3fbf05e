"""Draws docs/pictures/convergence.png: hexahedra, tetrahedra and splines at equal unknowns.

    python benchmarks/convergence.py

Heat through the wall of the bent pipe (template elbow_pipe): CalculiX on order-2 hexahedra and
tetrahedra, MFEM on the exact rational spline, its degrees raised and its spans halved. The
reference is MFEM's with degrees raised by four and spans halved once. Prints the figures.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "examples"))

import analyses  # noqa: E402

from pc2cad.equation.template_file import read_template  # noqa: E402
from pc2cad.mesh.volume_mesh import VolumeMesh  # noqa: E402
from pc2cad.volume import MeshOptions, mesh_equation  # noqa: E402


def unknowns(mesh: VolumeMesh) -> int:
    return len(mesh.points) - len(mesh.node_sets["w=0"]) - len(mesh.node_sets["w=1"])


def main() -> None:
    equation = read_template(ROOT / "templates" / "elbow_pipe.toml").bind({})
    _, reference = analyses.isogeometric_conductance(equation, 1, 4)
    found: dict[str, list[tuple[int, float]]] = {"splines (MFEM)": []}
    for raised, halved in ((1, 0), (2, 0), (3, 0), (3, 1), (4, 0)):
        found["splines (MFEM)"].append(analyses.isogeometric_conductance(equation, halved, raised))
    rows = []
    for n in (4, 8, 12, 16, 24, 32):
        mesh = analyses.mesh(equation, (n, n, max(1, n // 6)))
        rows.append((unknowns(mesh), analyses.conductance(mesh)))
    found["hexahedra, order 2 (CalculiX)"] = rows
    rows = []
    for size in (2.0, 1.0, 0.5, 0.3, 0.2, 0.14):
        mesh, _ = mesh_equation(equation, MeshOptions(size=size, order=2, shape="tetrahedra"))
        rows.append((unknowns(mesh), analyses.conductance(mesh)))
    found["tetrahedra, order 2 (gmsh, CalculiX)"] = rows
    print(f"reference {reference:.10g}")
    for name, values in found.items():
        print(name, ", ".join(f"{n}: {abs(q / reference - 1):.1e}" for n, q in values))
    draw(found, reference)


def draw(found: dict[str, list[tuple[int, float]]], reference: float) -> None:
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    for (name, values), mark, colour in zip(
        found.items(), "so^", ("#0072b2", "#d55e00", "#009e73"), strict=True
    ):
        count, value = np.array(values).T
        axes.loglog(count, np.abs(value / reference - 1), mark + "-", color=colour, label=name)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("relative error of the heat flow")
    axes.set_title("Heat through the wall of a bent pipe", fontsize=10)
    axes.grid(visible=True, which="major", alpha=0.4)
    axes.legend(fontsize=8)
    figure.savefig(ROOT / "docs" / "pictures" / "convergence.png", dpi=110)


if __name__ == "__main__":
    main()
