"""``pc2cad new``: a commented template to start from."""

from __future__ import annotations

import argparse
import os
import shlex
from typing import Final

from pc2cad.cli.output import say, shown
from pc2cad.errors import InputError

STARTER: Final = """\
# A solid is one point equation M(u,v,w): the current parameters u, v and w run through a box, and
# M runs through the solid. Compile this file with:   pc2cad build {name} -o part.step
# Look at its sides and figures with:                 pc2cad check {name}

title = "Quarter of a tube"
about = "Replace this text, and all the rest, by your own."      # optional
source = ""                                                      # optional: where it comes from
units = "mm"                                                     # mm, cm, m or in

# Scalars that a user may set, as in: pc2cad build {name} -s wall=5 -o part.step
[parameters]
radius = {{ default = 20, min = 1, max = 1000, about = "inner radius" }}
wall = {{ default = 3, min = 0.1, max = 100, about = "thickness of the wall" }}
height = {{ default = 30, min = 0.1, max = 1000 }}

# Fixed points: three coordinates, each a number or an expression of the parameters in quotes.
[points]
A = [1, 0, 0]
B = [0, 1, 0]
C = [0, 0, 1]
D = [0, 0, 0]

# Limits of u, v and w where they are not 0 and 1; numbers or expressions of the parameters.
[domain]
v = [0, "pi/2"]

# Intermediate scalars, points and free vectors, in order; each may use those before it.
# Operators + - * / ^ and functions such as sin, sqrt, dot, cross, unit, distance, diff(N, u).
# The weights of a point sum to 1 (D + (A-D)*u), those of a free vector to 0 (A - D).
[let]
r = "radius + wall*u"
N = "D + (A-D)*cos(v) + (B-D)*sin(v)"       # goes round the quarter of a circle
K = "D + (N-D)*r"                           # the section, from the inner radius to the outer

# A closed curve in the plane of a section gives two functions, contour_x(t) and contour_y(t),
# once round for t from 0 to 1:
# [curves.contour]
# kind = "contour"                          # or "sine", with radius, amplitude and waves
# points = [[2, 0], [1, 1.5], [-1, 1.8], [-2, 0], [0, -1.5]]

# The point equation, or its three coordinates: x = "...", y = "...", z = "..."
[solid]
M = "K + (C-D)*height*w"

# Optional: figures that build and check hold the solid against. Also: area, centroid.
[expect]
volume = "pi/4*((radius + wall)^2 - radius^2)*height"
faces = 6
edges = 12
vertices = 8
shells = 1
euler = 2
"""


class FileExistsAlreadyError(InputError):
    """A file of that name exists, and a starter file must not take its place."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the file name, and what to begin from."""
    from pc2cad.templates.importers import FORMS, MEASURED

    parser.add_argument("file", metavar="FILE.toml", help="the file to write; it must not exist")
    parser.add_argument(
        "--from",
        dest="source",
        metavar="NAME",
        help=f"what to begin from: a template's name, or {FORMS}",
    )
    parser.add_argument(
        "--layers", metavar="NAME=THICKNESS,…",
        help="vmec: layers from the boundary outwards, in metres, such as wall=0.1,blanket=0.5",
    )  # fmt: skip
    parser.add_argument("--measured", choices=MEASURED, help="vmec: how layers are measured")
    parser.add_argument("--periods", type=int, metavar="N", help="vmec: periods of the solid")
    parser.add_argument("--span", metavar="LENGTH", help="airfoil: length of the wing, in chords")


def run(arguments: argparse.Namespace) -> int:
    """Write the template."""
    from pc2cad.export.files import write_atomically

    path: str = arguments.file
    if not path.endswith(".toml"):
        raise InputError(f"new: '{path[-80:]}' must end in .toml")
    if "\0" not in path and os.path.lexists(path):
        raise FileExistsAlreadyError(f"new: {shown(path)} exists already; choose another name")
    name = os.path.basename(path)
    own = shlex.quote(name) if name.isascii() and name.isprintable() else "FILE.toml"
    write_atomically(path, _text(arguments, own).encode(), new=True)
    say(f"{shown(path)}: written; next: pc2cad build {shlex.quote(path)} -o part.step")
    return 0


def _text(arguments: argparse.Namespace, name: str) -> str:
    """Return the text of the template."""
    from pc2cad.templates.importers.kinds import imported, layers_of

    options = {
        key: value
        for key in ("layers", "measured", "periods", "span")
        if (value := getattr(arguments, key)) is not None
    }
    if arguments.source is None:
        if options:
            raise InputError(
                f"new: --{next(iter(options))} needs --from, which says what to import"
            )
        return STARTER.format(name=name)
    if "layers" in options:
        options["layers"] = layers_of(options["layers"])
    source: str = arguments.source
    return imported(source if ":" in source else f"template:{source}", options)
