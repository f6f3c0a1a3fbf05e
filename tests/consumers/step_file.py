"""A STEP file held to the digits that are written, by the reader of `pc2cad.verify`.

That reader shares nothing with what writes files, and allows files of anybody's what they state of
gaps. Here no gap may be more than rounding of 1e-9 of the size, nor any residual of the theorem of
Stokes; and what the file holds comes back as figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.receipt import StepFile, read_step, require_sound
from pc2cad.verify.solids import Solid
from pc2cad.verify.units import Stated

#: largest gap over the solid's size, and largest residual of the theorem of Stokes
LIMIT = 1e-9


@dataclass(frozen=True)
class StepFace:
    """A face's name, the keyword of its surface, and its area."""

    name: str
    carrier: str
    area: float


@dataclass(frozen=True)
class StepSolid:
    """A sound solid; all lengths in the file's own unit, which unit_m gives in metres."""

    volume: float
    area: float
    centroid: tuple[float, float, float]
    shells: int
    faces: tuple[StepFace, ...]
    edges: int
    vertices: int
    unit_m: float
    properties: Stated
    max_stokes_residual: float
    max_vertex_gap: float
    max_edge_gap: float

    @property
    def volume_mm3(self) -> float:
        """The volume in cubic millimetres, as the other readers of this package report it."""
        return self.volume * (self.unit_m * 1e3) ** 3

    @property
    def area_mm2(self) -> float:
        """The area in square millimetres."""
        return self.area * (self.unit_m * 1e3) ** 2

    @property
    def centroid_mm(self) -> tuple[float, float, float]:
        """The centroid in millimetres."""
        x, y, z = (part * self.unit_m * 1e3 for part in self.centroid)
        return x, y, z


def check_step(path: str | Path) -> StepSolid:
    """Check the one solid of a STEP file; raise StepDefectError where anything is wrong."""
    file = _sound(path)
    if len(file.solids) != 1:
        raise StepDefectError(f"the file holds {len(file.solids)} solids; one is needed")
    return _measured(file, file.solids[0])


def check_solids(path: str | Path) -> dict[str, StepSolid]:
    """Check each solid of a part of several; return them by name."""
    file = _sound(path)
    found = {solid.name: _measured(file, solid) for solid in file.solids}
    if len(found) != len(file.solids):
        raise StepDefectError("two solids of the file have one name")
    return found


def _sound(path: str | Path) -> StepFile:
    """Return a file of one product in which nothing contradicts itself or was left unjudged."""
    file = read_step(path)
    require_sound(file)
    if len(file.products) != 1:
        raise StepDefectError(f"the file holds {len(file.products)} products; one is needed")
    return file


def _measured(file: StepFile, solid: Solid) -> StepSolid:
    stokes = max(face.stokes for face in solid.faces)
    for what, figure, most in (
        ("an edge misses its vertex by", solid.vertex_gap, LIMIT * solid.size),
        ("an edge leaves its surface by", solid.edge_gap, LIMIT * solid.size),
        ("the theorem of Stokes fails by", stokes, LIMIT),
    ):
        if not figure <= most:
            raise StepDefectError(f"{what} {figure:.2g}")
    if solid.volume is None or solid.area is None or solid.centroid is None:
        raise StepDefectError(f"the solid {solid.ref} has no volume")
    x, y, z = solid.centroid.tolist()
    return StepSolid(
        volume=solid.volume,
        area=solid.area,
        centroid=(x, y, z),
        shells=len(solid.shells),
        faces=tuple(StepFace(f.face.name, f.face.carrier, f.moments.area) for f in solid.faces),
        edges=solid.edges,
        vertices=solid.vertices,
        unit_m=solid.units.metres,
        properties=file.stated,
        max_stokes_residual=stokes,
        max_vertex_gap=solid.vertex_gap,
        max_edge_gap=solid.edge_gap,
    )
