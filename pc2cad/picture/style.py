"""What a picture shows besides the shape."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pc2cad.errors import InputError, require
from pc2cad.export.files import by_ending
from pc2cad.picture.scene import Colour

STEEL: Colour = (0.60, 0.68, 0.76)
#: more points than this make a picture of half a minute and a page of hundreds of megabytes
LARGEST_CLOUD = 20_000_000

#: ending -> whether names and lines are vectors
VECTOR = {".png": False, ".svg": True}


def check_ending(path: str | os.PathLike[str]) -> None:
    """Raise InputError unless the name ends like a picture's and VTK is there to draw it."""
    by_ending(path, VECTOR, "picture")
    require("vtkmodules", "pictures", "vtk")


@dataclass(frozen=True)
class Style:
    """What a picture shows besides the shape."""

    #: each side of the box in its own colour
    colours: bool = False
    #: names of the sides
    labels: bool = False
    edges: bool = True
    #: how far the faces are moved apart, as a share of the part's size
    explode: float = 0.0
    #: inner parameter lines per direction and patch
    isolines: int = 0
    #: instead of faces, the points of an even grid of the whole box
    points: tuple[int, int, int] | None = None
    #: numbers shown as colours
    map: Literal["deviation", "thickness"] | None = None
    #: direction across the wall for the thickness: u, v, w or None for the thinnest
    across: str | None = None
    #: a scalar field of the equation that is shown as colours
    field: str | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.explode <= 10.0:
            raise InputError(f"faces are moved apart by 0 to 10 sizes, not by {self.explode:g}")
        if not 0 <= self.isolines <= 500:
            raise InputError(f"0 to 500 parameter lines can be drawn, not {self.isolines}")
        if self.points is not None and (
            min(self.points) < 1 or np.prod([float(n) for n in self.points]) > LARGEST_CLOUD
        ):
            raise InputError(
                f"a point set has 1 to {LARGEST_CLOUD:,} points; {self.points} is outside that"
            )
        if self.mapped and (self.points is not None or self.explode):
            raise InputError("a map is drawn on the faces in place: leave out points and explode")
        if self.map is not None and self.field is not None:
            raise InputError("faces have one colour at a place: a map or a field, not both")

    @property
    def mapped(self) -> bool:
        """Whether colours over the faces show numbers."""
        return self.map is not None or self.field is not None
