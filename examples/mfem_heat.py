"""A volume as splines in MFEM: the heat that flows round a pipe elbow, from one end to the other.

    python examples/mfem_heat.py        (needs the package mfem)

The elbow is one rational spline, exact, so there is no error of the geometry: what is left is the
temperature's, which falls with every degree. It is linear in the angle of the bend, and the flow is
k/angle · ∫ dA/distance from the axis = 2πk/angle · ((R - √(R² - b²)) - (R - √(R² - a²))).
Boundary attributes count the sides: 1 and 2 are the lower and upper one of the first axis.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import mfem.ser as mfem

import pc2cad as pc

BEND, INNER, OUTER, ANGLE = 3, 0.5, 1, math.pi / 2

u, v, w = pc.parameters()


def elbow():
    theta, phi, r = pc.pi / 2 * w, 2 * pc.pi * v, INNER + (OUTER - INNER) * u
    distance = BEND + r * pc.cos(phi)
    return distance * pc.cos(theta), distance * pc.sin(theta), r * pc.sin(phi)


def stiffness(space):
    form = mfem.BilinearForm(space)
    form.AddDomainIntegrator(mfem.DiffusionIntegrator())
    form.Assemble()
    form.Finalize()
    return form


def heat_flow(model, raised):
    """Return the heat flow from the end w=1, at 1 degree, to the end w=0, at none."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "elbow.mesh")
        pc.write_splines(model, path)
        mesh = mfem.Mesh(path, 1, 1)
    mesh.DegreeElevate(raised)
    space = mfem.FiniteElementSpace(mesh, mesh.GetNodes().OwnFEC())
    temperature = mfem.GridFunction(space)
    temperature.Assign(0.0)
    temperature.ProjectBdrCoefficient(mfem.ConstantCoefficient(1.0), mfem.intArray([0] * 5 + [1]))
    ends = mfem.intArray()
    space.GetEssentialTrueDofs(mfem.intArray([0] * 4 + [1, 1]), ends)
    load, x, b = mfem.Vector(space.GetVSize()), mfem.Vector(), mfem.Vector()
    load.Assign(0.0)
    matrix = mfem.SparseMatrix()
    form = stiffness(space)
    form.FormLinearSystem(ends, temperature, load, matrix, x, b)
    mfem.PCG(matrix, mfem.GSSmoother(matrix), b, x, 0, 1000, 1e-24, 0.0)
    form.RecoverFEMSolution(x, load, temperature)
    return stiffness(space).InnerProduct(temperature, temperature)


def main():
    model = pc.spline_part(elbow(), name="elbow")
    assert model.evidence == "exact"
    rings = (math.sqrt(BEND**2 - r**2) for r in (INNER, OUTER))
    exact = 2 * math.pi / ANGLE * (next(rings) - next(rings))
    return {
        f"heat flow, degrees raised by {raised}": (heat_flow(model, raised), exact)
        for raised in (1, 2, 3)
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
