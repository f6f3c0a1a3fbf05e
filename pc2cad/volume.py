"""The second way through: from the analysis to what fills the solid, without the kernel.

PointEquation  ─analyse→   Analysis     which sides collapse, coincide, bound
               ─integrate→ Properties   volume and areas of the equation
               ─solidity→  Solidity     no fold, no overlap, or it is refused
               ─mesh→      VolumeMesh   structured hexahedra on a (u,v,w) grid
            or ─represent→ VolumeModel  M itself as trivariate splines
            or ─sample→    PointSet     points of the interior (room `interior`)

Tetrahedra are made of the kernel's solid instead, which is compiled as usual.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from pc2cad.analysis import Analysis, analyse
from pc2cad.equation.point_equation import Domain, Equation, PointEquation, point_equation
from pc2cad.errors import InputError, require
from pc2cad.geometry.profile import COMPACT, SplineProfile
from pc2cad.isogeometry import VolumeModel, represent_volume
from pc2cad.mesh.closure import check_whole
from pc2cad.mesh.grid import Grading, make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.quality import Quality, measure
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.properties import Properties, integrate
from pc2cad.solidity import check_solidity

Progress = Callable[[str], None]


@dataclass(frozen=True)
class MeshOptions:
    """What is asked of a mesh of hexahedra; lengths in model units."""

    #: cells along u, v and w
    cells: tuple[int, int, int] | None = None
    #: or the length that no cell exceeds by much
    size: float | None = None
    order: Literal[1, 2] = 1
    #: hexahedra of the (u,v,w) grid, or tetrahedra of the B-rep by gmsh
    shape: Literal["hexahedra", "tetrahedra"] = "hexahedra"
    grading: tuple[Grading, Grading, Grading] = (Grading(), Grading(), Grading())
    #: elements at an axis: cells of the grid that lose corners there, or those of an O-grid
    core: Literal["grid", "ogrid"] = "grid"

    def __post_init__(self) -> None:
        if self.cells is not None and self.size is not None:
            raise InputError("give the cells of a mesh or their size, not both")
        if self.size is not None and not 0 < self.size < float("inf"):
            raise InputError(f"the size of cells must be a positive length, not {self.size}")
        if self.shape == "tetrahedra" and self.cells is not None:
            raise InputError("tetrahedra have a size of cells, not numbers of them along u, v, w")
        if self.shape == "tetrahedra" and self.core == "ogrid":
            raise InputError("tetrahedra have no core; an O-grid is one of hexahedra")
        if self.order not in (1, 2):
            raise InputError(f"elements have order 1 or 2, not {self.order}")


@dataclass(frozen=True)
class SideMeasure:
    """A side of the solid: its facets against the equation (areas in model units squared)."""

    facets: int
    area: float
    equation_area: float


@dataclass(frozen=True)
class LayerMeasure:
    """A layer of the solid: its elements against the equation (volumes in model units cubed)."""

    elements: int
    volume: float
    equation_volume: float


@dataclass(frozen=True)
class MeshReport:
    """What a mesh is, how good its elements are, and how it compares with the equation."""

    name: str
    units: str
    order: int
    #: cells of the parameter grid along u, v, w; None for a mesh that is not structured
    cells: tuple[int, int, int] | None
    nodes: int
    elements: Mapping[str, int]
    quality: Quality
    volume: float
    equation_volume: float
    sides: Mapping[str, SideMeasure]
    layers: Mapping[str, LayerMeasure] = field(default_factory=dict)
    times: Mapping[str, float] = field(default_factory=dict)

    @property
    def volume_difference(self) -> float:
        """Relative difference of the mesh's volume from the equation's."""
        return self.volume / self.equation_volume - 1

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        return {**asdict(self), "volume_difference": self.volume_difference}


def analyse_solid(
    equation: PointEquation, progress: Progress | None = None
) -> tuple[Analysis, Properties]:
    """Return what is known of a point equation without the kernel; raise NotASolidError."""
    tell = progress or (lambda stage: None)
    tell("analyse")
    analysis = analyse(equation)
    tell("integrate")
    properties = integrate(analysis)
    tell("solidity")
    check_solidity(analysis)
    return analysis, properties


def mesh_equation(
    equation: PointEquation,
    options: MeshOptions | None = None,
    progress: Progress | None = None,
) -> tuple[VolumeMesh, MeshReport]:
    """Return the mesh of a point equation and the report on it.

    Raises NotASolidError where the image is no solid, an element of the mesh is inverted or its
    facets do not hold what its elements fill, and UnsuitableGridError where the cells do not fit
    the solid.
    """
    options = options or MeshOptions()
    clock = _Clock(progress)
    analysis, properties = analyse_solid(equation, clock)
    clock("mesh")
    areas = _areas(analysis, properties)
    cells = None
    if options.shape == "tetrahedra":
        mesh, areas = _tetrahedra(equation, options, properties)
    else:
        grid = make_grid(analysis, options.cells, options.size, options.grading)
        if options.core == "ogrid":
            mesh = o_grid(analysis, grid, options.order)
        else:
            cells = grid.cells
            mesh = hexahedra(analysis, grid, options.order)
    clock("quality")
    quality = measure(mesh)
    check_whole(mesh, quality.volume)
    report = report_on(mesh, quality, properties, areas, cells)
    clock("")
    return mesh, MeshReport(**{**vars(report), "times": clock.times})


def spline_equation(
    equation: PointEquation,
    tolerance: float | None = None,
    profile: SplineProfile = COMPACT,
    progress: Progress | None = None,
) -> tuple[VolumeModel, float]:
    """Return M as trivariate splines, and the volume of the equation itself.

    `tolerance` bounds the distance from the equation (a length, 1e-7 of the size by default) where
    no exact form is known. Raises NotASolidError, ToleranceNotReachedError.
    """
    analysis, properties = analyse_solid(equation, progress)
    return represent_volume(analysis, tolerance, profile), properties.volume


def spline_part(
    equation: Equation,
    domain: Domain | None = None,
    tolerance: float | None = None,
    *,
    name: str = "part",
    units: str = "mm",
) -> VolumeModel:
    """Return a Python point equation over a box as trivariate splines; see `spline_equation`."""
    return spline_equation(point_equation(equation, domain, name=name, units=units), tolerance)[0]


def mesh_part(
    equation: Equation,
    domain: Domain | None = None,
    *,
    name: str = "part",
    units: str = "mm",
    cells: tuple[int, int, int] | None = None,
    size: float | None = None,
    order: Literal[1, 2] = 1,
    shape: Literal["hexahedra", "tetrahedra"] = "hexahedra",
    core: Literal["grid", "ogrid"] = "grid",
) -> VolumeMesh:
    """Mesh a Python point equation over a box; see `MeshOptions` and `mesh_equation`."""
    bound = point_equation(equation, domain, name=name, units=units)
    return mesh_equation(bound, MeshOptions(cells, size, order, shape, core=core))[0]


def report_on(
    mesh: VolumeMesh,
    quality: Quality,
    properties: Properties,
    areas: Mapping[str, float],
    cells: tuple[int, int, int] | None,
) -> MeshReport:
    """Return the report on a mesh; `properties` and the sides' `areas` are the equation's."""
    sides = {
        side: SideMeasure(sum(len(f.elements) for f in facets), mesh.area(side), areas[side])
        for side, facets in mesh.sides.items()
    }
    layers = {
        name: LayerMeasure(sum(map(len, layer.values())), quality.layers[name], volume)
        for (name, layer), (volume, _) in zip(mesh.layers.items(), properties.layers, strict=False)
    }
    return MeshReport(
        mesh.name, mesh.units, mesh.order, cells, len(mesh.points),
        {kind: len(block) for kind, block in mesh.blocks.items()},
        quality, mesh.volume(), properties.volume, sides, layers,
    )  # fmt: skip


def _areas(analysis: Analysis, properties: Properties) -> dict[str, float]:
    """Return the equation's area of every side, and of every patch of a creased one."""
    names = [analysis.boundary.name(face.patch) for face in analysis.boundary.faces]
    return _summed(zip(names, properties.face_areas, strict=True))


def _summed(named: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return areas by name, and those of whole sides where they come in pieces."""
    areas: dict[str, float] = {}
    for name, area in named:
        for key in {name, name.partition(" (")[0]}:
            areas[key] = areas.get(key, 0.0) + area
    return areas


def _tetrahedra(
    equation: PointEquation, options: MeshOptions, properties: Properties
) -> tuple[VolumeMesh, dict[str, float]]:
    """Compile the solid, mesh it, and return the equation's areas of its faces too."""
    require("gmsh", "tetrahedra")
    from pc2cad.compiler import compile_equation
    from pc2cad.mesh.tetrahedra import tetrahedra

    part = compile_equation(equation)
    size = options.size or float(properties.volume ** (1 / 3)) / 10
    mesh = tetrahedra(part.shape, part.faces, size, options.order,
                      name=equation.name, units=equation.units, layers=part.layers)  # fmt: skip
    outer = [part.model.faces[i] for i in part.model.outer]
    areas = ((f.name, sum(properties.face_areas[c] for c in f.cells)) for f in outer)
    return mesh, _summed(areas)


class _Clock:
    """Names the stages as they begin and notes how long each took."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._stage, self._start = "", time.perf_counter()
        self.times: dict[str, float] = {}

    def __call__(self, stage: str) -> None:
        now = time.perf_counter()
        if self._stage:
            self.times[self._stage] = now - self._start
        self._stage, self._start = stage, now
        if stage and self._progress is not None:
            self._progress(stage)
