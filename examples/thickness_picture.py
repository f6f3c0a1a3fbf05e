"""A picture: an eccentric pipe, coloured by the thickness of its wall.

    python examples/thickness_picture.py pipe.png        (or .svg; no display is needed)

The bore of radius r lies e beside the middle of the outer circle of radius R, so that the wall is
R - r - e thick where it is thinnest and R - r + e where it is thickest: the ends of the picture's
scale. What `pc2cad render --map thickness` draws of a template is made by the same two calls.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pc2cad as pc
from pc2cad.picture.camera import VIEWS
from pc2cad.picture.drawing import drawing
from pc2cad.picture.image import camera_for, write_picture
from pc2cad.picture.style import Style

BORE, OUTER, OFFSET, LENGTH = 20, 30, 4, 80

u, v, w = pc.parameters()


def pipe():
    angle, radius = 2 * pc.pi * u, BORE + (OUTER - BORE) * w
    return radius * pc.cos(angle) + OFFSET * (1 - w), radius * pc.sin(angle), LENGTH * v


def main(path=None):
    scene = drawing(pc.compile_part(pipe(), name="eccentric pipe"), Style(map="thickness"))
    camera = camera_for(scene, VIEWS["iso"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(path or Path(folder) / "pipe.png")
        write_picture(scene, camera, path)
        assert path.read_bytes().startswith(b"\x89PNG" if path.suffix == ".png" else b"<")
    return {
        "thinnest wall": (scene.bar.low, OUTER - BORE - OFFSET),
        "thickest wall": (scene.bar.high, OUTER - BORE + OFFSET),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main(*sys.argv[1:2]).items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
