"""Volume meshes: hexahedra of a checked map's own grid, or tetrahedra of a part's solid.

Input: CheckedMap (no kernel is loaded), or a compiled part. Output: VolumeMesh and MeshReport.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

from pc2cad.checked import CheckedMap, Stages
from pc2cad.errors import InputError, require
from pc2cad.mesh.closure import check_whole
from pc2cad.mesh.columns import Columns
from pc2cad.mesh.grid import Grading, make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.places import FoundPlaces, GridPlaces, Places
from pc2cad.mesh.quality import measure
from pc2cad.mesh.report import MeshReport, by_side, report_on, side_areas
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid


@dataclass(frozen=True)
class MeshOptions:
    """What is asked of a mesh; lengths in model units."""

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
        if self.shape == "tetrahedra" and any(g.ratio != 1 for g in self.grading):
            raise InputError("tetrahedra have one size of cells; hexahedra may grow along u, v, w")
        if self.order not in (1, 2):
            raise InputError(f"elements have order 1 or 2, not {self.order}")


class KernelSolid(Protocol):
    """A part as far as tetrahedra need it: its solid, and what its equation says of it."""

    @property
    def checked(self) -> CheckedMap:
        """What is known of the equation."""

    @property
    def shape(self) -> TopoDS_Solid:
        """The kernel's solid."""

    @property
    def kernel_sides(self) -> dict[SideKey, TopoDS_Face]:
        """The kernel's faces by their side."""

    @property
    def side_areas(self) -> dict[SideKey, float]:
        """The equation's areas of the same faces, in units squared."""

    @property
    def layers(self) -> dict[str, TopoDS_Solid]:
        """The solids that the part consists of by name, where there are several."""


def mesh_volume(
    checked: CheckedMap, options: MeshOptions | None = None, stages: Stages | None = None
) -> tuple[VolumeMesh, MeshReport]:
    """Return hexahedra of the (u,v,w) grid and the report on them.

    Raises NotASolidError where an element is inverted or the facets do not hold what the elements
    fill, and UnsuitableGridError where the cells do not fit the solid.
    """
    options, run = options or MeshOptions(), stages or Stages()
    if options.shape != "hexahedra":
        raise InputError("tetrahedra are made of a part's solid: see Part.mesh")
    grid = make_grid(checked, options.cells, options.size, options.grading)
    is_o_grid = options.core == "ogrid"
    fill = o_grid if is_o_grid else hexahedra
    mesh = run("mesh", lambda: fill(checked, grid, options.order))
    found: Places = FoundPlaces(checked, mesh)
    if not is_o_grid:
        found = GridPlaces(checked, grid, options.order, mesh)
    mesh = replace(mesh, columns=Columns(checked, mesh, found))
    quality = run("quality", lambda: measure(mesh))
    check_whole(mesh, quality.volume)
    cells = None if is_o_grid else grid.cells
    areas = side_areas(checked)
    return mesh, report_on(mesh, quality, checked.mass, areas, cells, run.times)


def mesh_solid(
    part: KernelSolid, options: MeshOptions | None = None, stages: Stages | None = None
) -> tuple[VolumeMesh, MeshReport]:
    """Return tetrahedra of a part's own solid by gmsh, and the report on them.

    Raises PackageMissingError without gmsh, and MeshingFailedError.
    """
    require("gmsh", "tetrahedra")
    from pc2cad.mesh.tetrahedra import tetrahedra

    options, run = options or MeshOptions(shape="tetrahedra"), stages or Stages()
    mass, equation = part.checked.mass, part.checked.equation
    size = options.size or float(mass.volume ** (1 / 3)) / 10
    mesh = run(
        "mesh",
        lambda: tetrahedra(part.shape, part.kernel_sides, size, options.order,
                           name=equation.name, units=equation.units, layers=part.layers),
    )  # fmt: skip
    mesh = replace(mesh, columns=Columns(part.checked, mesh, FoundPlaces(part.checked, mesh)))
    quality = run("quality", lambda: measure(mesh))
    check_whole(mesh, quality.volume)
    return mesh, report_on(mesh, quality, mass, by_side(part.side_areas.items()), None, run.times)
