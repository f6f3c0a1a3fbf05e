"""Holes in an ellipsoidal tank, wherever they lie: ``python -m benchmarks.tanks``.

Each is compiled at the default tolerance, and its volume held against an integral over the hole's
disc: the wall between two ellipsoids is as high there as their roots say.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import pc2cad as pc
from benchmarks.pairs import readers
from pc2cad.errors import PointCadError
from pc2cad.templates.file import parse_template

INNER, OUTER, RADIUS = (500.0, 300.0, 300.0), (505.0, 305.0, 305.0), 40.0
TEXT = """
title = "Tank"
result = "cut(tank, hole)"
[[bodies]]
name = "tank"
[bodies.solid]
{tank}
[[bodies]]
name = "hole"
[bodies.solid]
M = "{hole}"
"""
#: poles at both ends of z, or of x
TANKS = {
    "z": """x = "(500 + 5*w)*cos(pi*(v - 1/2))*cos(2*pi*u)"
y = "(300 + 5*w)*cos(pi*(v - 1/2))*sin(2*pi*u)"
z = "(300 + 5*w)*sin(pi*(v - 1/2))" """,
    "x": """x = "(500 + 5*w)*sin(pi*(v - 1/2))"
y = "(300 + 5*w)*cos(pi*(v - 1/2))*cos(2*pi*u)"
z = "(300 + 5*w)*cos(pi*(v - 1/2))*sin(2*pi*u)" """,
}
#: where the poles are, the hole's axis, and where that is in the other two coordinates
POSITIONS = (
    ("z", 2, (200.0, 0.0)),
    ("z", 2, (-150.0, 60.0)),
    ("z", 2, (20.0, 10.0)),
    ("z", 1, (50.0, 100.0)),
    ("z", 0, (0.0, 0.0)),
    ("x", 0, (30.0, 20.0)),
    ("x", 2, (120.0, -80.0)),
    ("x", 1, (0.0, -60.0)),
    ("z", 2, (40.0, 0.0)),
    ("z", 2, (-24.0, 32.0)),
    ("x", 0, (40.0, 0.0)),
    ("x", 0, (24.0, 32.0)),
)


def volume(axis: int, centre: tuple[float, float]) -> float:
    """Return the bored tank's volume."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    r, w = (nodes + 1) * RADIUS / 2, weights * RADIUS / 2
    turn = 2 * np.pi * np.arange(120) / 120
    a, b = (k for k in ((axis + 1) % 3, (axis + 2) % 3))
    p = centre[0] + r[:, None] * np.cos(turn)
    q = centre[1] + r[:, None] * np.sin(turn)
    high = [
        axes[axis] * np.sqrt(1 - (p / axes[a]) ** 2 - (q / axes[b]) ** 2) for axes in (OUTER, INNER)
    ]
    hole = float(((high[0] - high[1]).mean(axis=1) * 2 * np.pi * r * w).sum())
    return float(4 / 3 * np.pi * (np.prod(OUTER) - np.prod(INNER))) - hole


def template(poles: str, axis: int, centre: tuple[float, float]) -> str:
    """Return a tank with a hole along an axis, outward from 100."""
    words = [""] * 3
    words[axis] = "100 + 500*v"
    words[(axis + 1) % 3] = f"{centre[0]} + 40*w*cos(2*pi*u)"
    words[(axis + 2) % 3] = f"{centre[1]} + 40*w*sin(2*pi*u)"
    return TEXT.format(tank=TANKS[poles], hole=f"[{', '.join(words)}]")


def main() -> None:
    """Print a line per position."""
    argparse.ArgumentParser(prog="benchmarks.tanks", description=__doc__).parse_args()
    for poles, axis, centre in POSITIONS:
        start = time.process_time()
        said = f"poles along {poles}, hole along {'xyz'[axis]} at {centre}: "
        try:
            bound = parse_template(template(poles, axis, centre), "tank").bind()
            part = pc.compile_equation(bound)
        except PointCadError as error:
            print(f"{said}{type(error).__name__}: {error}"[:300], flush=True)
            continue
        true = volume(axis, centre)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "tank.step"
            part.write(path)
            found = readers(path)
        read = ", ".join(
            f"{name} {row['volume'] / true - 1:+.0e}{'' if row['valid'] else ' NOT VALID'}"
            for name, row in found.items()
        )
        print(
            f"{said}{part.volume / true - 1:+.1e}; {read}; "
            f"{time.process_time() - start:.0f} s of CPU",
            flush=True,
        )


if __name__ == "__main__":
    main()
