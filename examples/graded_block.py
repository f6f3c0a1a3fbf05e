"""A graded block: cells that grow from the wall, written into the equation.

    python examples/graded_block.py

The parameters of a point equation are yours. A block whose height runs with exp(kw) is the same
block, and its B-rep says so: six planes, exact. But an even grid of (u, v, w), mapped by it, has
layers that grow by the same factor each, as flow along a wall wants them: n layers with the ratio
q = exp(k/n) begin with H (q - 1)/(qⁿ - 1).
"""

from __future__ import annotations

import math

import numpy as np

import pc2cad as pc

LENGTH, WIDTH, HEIGHT = 40, 20, 10
#: the last layer's height over the first one's, nearly: exp(k)
RATIO, LAYERS = 50, 16

u, v, w = pc.parameters()


def block():
    k = math.log(RATIO)
    return LENGTH * u, WIDTH * v, HEIGHT * (pc.exp(k * w) - 1) / (RATIO - 1)


def main():
    part = pc.compile_part(block(), name="graded block")
    report = part.report
    assert report.evidence == "exact"
    assert {face.carrier for face in report.faces} == {"plane"}
    mesh = part.mesh(cells=(8, 4, LAYERS))
    heights = np.diff(np.unique(mesh.points[:, 2].round(9)))
    q = RATIO ** (1 / LAYERS)
    return {
        "volume": (report.solid.volume, LENGTH * WIDTH * HEIGHT),
        "volume of the mesh": (mesh.volume(), LENGTH * WIDTH * HEIGHT),
        "height of the first layer": (heights[0], HEIGHT * (q - 1) / (RATIO - 1)),
        "ratio of neighbouring layers": ((heights[1:] / heights[:-1]).mean(), q),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
