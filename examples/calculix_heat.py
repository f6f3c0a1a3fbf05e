"""A mesh into CalculiX: the heat that an elliptical duct loses through its wall.

    python examples/calculix_heat.py        (needs the program ccx)

The wall lies between two confocal ellipses, x = c cosh(μ) cos(ν), y = c sinh(μ) sin(ν), so the
temperature is linear in μ and the heat flow per length is 2πk/(μ₂ - μ₁) per degree, as for a tube,
whose 1/ln(b/a) it is (Carslaw & Jaeger, Conduction of Heat in Solids, §16.1). The mesh is written
for CalculiX, whose deck names the sides of the parameter box: ``w_0`` is the inner surface.
"""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
from pathlib import Path

import pc2cad as pc

FOCUS, INNER, OUTER, LENGTH = 50.0, 0.5, 0.8, 300.0
CONDUCTIVITY, INSIDE, OUTSIDE = 0.04, 80.0, 20.0

#: what stands behind the mesh in CalculiX's input
DECK = f"""*INCLUDE, INPUT=duct.inp
*MATERIAL, NAME=wall
*CONDUCTIVITY
{CONDUCTIVITY}
*SOLID SECTION, ELSET=solid, MATERIAL=wall
*INITIAL CONDITIONS, TYPE=TEMPERATURE
solid, {OUTSIDE}
*STEP
*HEAT TRANSFER, STEADY STATE
*BOUNDARY
w_0, 11, 11, {INSIDE}
w_1, 11, 11, {OUTSIDE}
*NODE PRINT, NSET=w_0, TOTALS=ONLY
RFL
*END STEP
"""

u, v, w = pc.parameters()


def duct():
    mu, nu = INNER + (OUTER - INNER) * w, 2 * pc.pi * u
    return FOCUS * pc.cosh(mu) * pc.cos(nu), FOCUS * pc.sinh(mu) * pc.sin(nu), LENGTH * v


def solve(mesh):
    """Return the heat flow through the inner surface that CalculiX finds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pc.write_mesh(mesh, folder / "duct.inp")
        (folder / "job.inp").write_text(DECK)
        subprocess.run(["ccx", "-i", "job"], cwd=folder, check=True, capture_output=True)
        text = (folder / "job.dat").read_text()
    return float(re.findall(r"total heat[^\n]*\n+\s*([-+.\dEe]+)", text)[-1])


def main():
    flow = 2 * math.pi * CONDUCTIVITY * LENGTH * (INSIDE - OUTSIDE) / (OUTER - INNER)
    return {
        f"heat flow, {24 * n} cells of order 2": (
            solve(pc.mesh_part(duct(), cells=(12 * n, 1, n), order=2, name="duct")), flow
        )
        for n in (1, 2)
    }  # fmt: skip


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
