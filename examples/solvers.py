"""Runs solvers on meshes and splines of pc2cad's, and reads what they found.

CalculiX (``ccx``) is a program that is given a mesh and the rest of its input; MFEM is a library.
Used by analyses.py and by benchmarks/convergence.py.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pc2cad as pc
from pc2cad.compiler import mesh_equation, spline_equation
from pc2cad.equation.point_equation import PointEquation
from pc2cad.export.inp import facets
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.options import CompileOptions
from pc2cad.representation.volume import VolumeModel

E, NU = 1000.0, 0.3


@dataclass(frozen=True)
class Answer:
    """One number of an analysis and what it should be."""

    problem: str
    solver: str
    unknowns: int
    found: float
    exact: float
    source: str

    @property
    def error(self) -> float:
        return abs(self.found / self.exact - 1)


class SolverFailed(RuntimeError):  # noqa: N818
    """The solver ended with an error."""


def calculix(mesh: VolumeMesh, model: str) -> str:
    """Return the text output of CalculiX on a mesh with materials, supports and a step."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pc.write_mesh(mesh, folder / "part.inp")
        (folder / "job.inp").write_text(f"*INCLUDE, INPUT=part.inp\n{model}")
        done = subprocess.run(
            ["ccx", "-i", "job"], cwd=folder, capture_output=True, text=True, timeout=600,
            check=False,
        )  # fmt: skip
        if "*ERROR" in done.stdout or not (folder / "job.dat").exists():
            raise SolverFailed(done.stdout[-2000:])
        return (folder / "job.dat").read_text()


def node_values(text: str, title: str) -> dict[int, np.ndarray]:
    """Return the rows of a table of CalculiX's .dat file by node number."""
    start = text.index(title)
    rows = {}
    for line in text[start:].splitlines()[2:]:
        fields = line.split()
        if len(fields) < 2 or not fields[0].isdigit():
            break
        rows[int(fields[0])] = np.array([float(x) for x in fields[1:]])
    return rows


def totals(text: str, title: str) -> np.ndarray:
    """Return the last row of sums under a title."""
    found = re.findall(re.escape(title) + r"[^\n]*\n+\s*([-+.\dEe \t]+)", text)
    return np.array([float(x) for x in found[-1].split()])


ELASTIC = f"""*MATERIAL, NAME=m
*ELASTIC
{E}, {NU}
*EXPANSION
1e-3
*SOLID SECTION, ELSET=solid, MATERIAL=m
"""


def mesh(equation: PointEquation, cells: tuple[int, int, int], order: int = 2) -> VolumeMesh:
    return mesh_equation(equation, MeshOptions(cells=cells, order=order))[0]


def pressure(part: VolumeMesh, side: str, value: float = 1.0) -> str:
    """Return the *DLOAD lines of a pressure on a side."""
    return "".join(
        f"{element}, P{face}, {value}\n" for element, face in facets(part, side).tolist()
    )


CONDUCTION = """*MATERIAL, NAME=m
*CONDUCTIVITY
1.
*SOLID SECTION, ELSET=solid, MATERIAL=m
*INITIAL CONDITIONS, TYPE=TEMPERATURE
solid, 0.
*STEP
*HEAT TRANSFER, STEADY STATE
*BOUNDARY
{cold}, 11, 11, 0.
{hot}, 11, 11, 1.
*NODE PRINT, NSET={hot}, TOTALS=ONLY
RFL
*END STEP
"""


def conductance(part: VolumeMesh) -> float:
    """Return the heat that flows from w=1 at 1 degree to w=0 at 0, by CalculiX."""
    text = calculix(part, CONDUCTION.format(cold="w_0", hot="w_1"))
    return float(totals(text, "total heat")[0])


def isogeometric_conductance(
    equation: PointEquation, refinements: int = 0, raised: int = 1, tolerance: float | None = None
) -> tuple[int, float]:
    """Return unknowns and heat flow from the last axis's upper side to its lower one, by MFEM."""
    return conductance_of_splines(
        spline_equation(equation, CompileOptions(tolerance))[0], refinements, raised
    )


def conductance_of_splines(
    model: VolumeModel, refinements: int = 0, raised: int = 0
) -> tuple[int, float]:
    """Return the same of splines that are there, refined or not."""
    import mfem.ser as mfem
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import spsolve

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.mesh"
        pc.write_splines(model, path)
        grid = mfem.Mesh(str(path), 1, 1)
    if raised:
        grid.DegreeElevate(raised)
    for _ in range(refinements):
        grid.UniformRefinement()
    space = mfem.FiniteElementSpace(grid, grid.GetNodes().OwnFEC())
    form = mfem.BilinearForm(space)
    form.AddDomainIntegrator(mfem.DiffusionIntegrator())
    form.Assemble()
    form.Finalize()
    table = form.SpMat()
    stiffness = csr_matrix(
        (table.GetDataArray().copy(), table.GetJArray().copy(), table.GetIArray().copy())
    )
    held, value = np.zeros(space.GetVSize(), dtype=bool), np.zeros(space.GetVSize())
    for attribute, temperature in ((5, 0.0), (6, 1.0)):
        marker = mfem.intArray([int(k + 1 == attribute) for k in range(grid.bdr_attributes.Max())])
        dofs = mfem.intArray()
        space.GetEssentialTrueDofs(marker, dofs)
        held[dofs.ToList()] = True
        value[dofs.ToList()] = temperature
    free = ~held
    value[free] = spsolve(stiffness[free][:, free], -stiffness[free][:, held] @ value[held])
    return int(free.sum()), float(value @ (stiffness @ value))
