"""A duct in a CadQuery model: a flange with bolt holes, and an intake that turns round into oval.

    python examples/cadquery_duct.py

Flange and holes are CadQuery's. The duct's half-axes run linearly from A to B along its height: one
equation for the bore, which is cut out of the flange, and one for the wall, which is fused to it.
Faces keep the names of the sides they come from, as tags. The exact volume is that of polynomials.
"""

from __future__ import annotations

import cadquery as cq
import numpy as np

import pc2cad as pc
import pc2cad.cadquery as pcq

PLATE, THICKNESS, CORNER, HOLE, GRID = 80, 8, 8, 9, 60
A, B, HEIGHT, WALL = (18, 18), (26, 12), 60, 2

u, v, w = pc.parameters()


def duct(first, last):
    """Return what lies `first` to `last` outside the bore's section; -1: from the axis on."""
    angle = 2 * pc.pi * v
    a, b = (low + (high - low) * u for low, high in zip(A, B, strict=True))
    x, y = (w * c if first < 0 else c + first + (last - first) * w for c in (a, b))
    return x * pc.cos(angle), y * pc.sin(angle), HEIGHT * u


def model():
    """Return the flanged duct as a `cadquery.Workplane`."""
    return (
        cq.Workplane()
        .box(PLATE, PLATE, THICKNESS, centered=(True, True, False))
        .edges("|Z").fillet(CORNER)
        .rarray(GRID, GRID, 2, 2).circle(HOLE / 2).cutThruAll()
        .copyWorkplane(cq.Workplane()).invoke(pcq.placed(duct(-1, 0), combine="cut"))
        .copyWorkplane(cq.Workplane()).invoke(pcq.placed(duct(0, WALL)))
    )  # fmt: skip


def within(wall, low=0.0):
    """Return the volume within the duct from a share of its height on: ∫ π a b dz."""
    a, b = (np.poly1d([top - foot, foot + wall]) for foot, top in zip(A, B, strict=True))
    area = (np.pi * a * b).integ()
    return HEIGHT * float(area(1.0) - area(low))


def main():
    result = model()
    assert result.val().isValid()
    rim = result.faces(tag="u=1")
    _, wall = result.pointParts()
    areas = {face.name: face.area for face in wall.report.faces}
    volume = (
        (PLATE**2 - (4 - np.pi) * CORNER**2 - np.pi * HOLE**2) * THICKNESS
        + within(WALL, THICKNESS / HEIGHT)
        - within(0)
    )
    return {
        "volume": (result.val().Volume(tol=1e-6), volume),
        "height of the rim": (rim.val().Center().z, HEIGHT),
        "edges of the rim": (rim.edges().size(), 2),
        "area of the rim": (areas["u=1"], np.pi * WALL * (sum(B) + WALL)),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
