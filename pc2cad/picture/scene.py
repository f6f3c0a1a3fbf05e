"""What a picture shows, as plain data in model units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Integers

#: red, green, blue in 0…1
Colour = tuple[float, float, float]

INK: Colour = (0.12, 0.12, 0.14)
GREY: Colour = (0.55, 0.57, 0.60)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles (m, 3) on points (n, 3) with unit normals (n, 3) out of the solid."""

    name: str
    points: Array
    triangles: Integers
    normals: Array
    #: one colour, or one for each point, (n, 3)
    colour: Colour | Array
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Lines:
    """Polylines, each (k, 3); `width` in pixels."""

    paths: tuple[Array, ...]
    colour: Colour = INK
    width: float = 1.5


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (n, 3) with colours (n, 3); `width` in pixels."""

    points: Array
    colours: Array
    width: float = 2.0


@dataclass(frozen=True, eq=False)
class Label:
    """A name for something; its places (n, 3) are where it may point to.

    `whole` is what it is a part of, where several belong together.
    """

    text: str
    places: Array
    colour: Colour = INK
    whole: str = ""


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour scale: colours (n, 3) run evenly from `low` to `high`."""

    title: str
    low: float
    high: float
    colours: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in one picture."""

    surfaces: tuple[Surface, ...] = ()
    lines: tuple[Lines, ...] = ()
    clouds: tuple[Cloud, ...] = ()
    labels: tuple[Label, ...] = ()
    bar: Bar | None = None

    def extent(self) -> Array:
        """Return all points that have to be in the picture, (n, 3)."""
        rows = [s.points for s in self.surfaces] + [c.points for c in self.clouds]
        rows += [path for lines in self.lines for path in lines.paths]
        return np.concatenate(rows)
