"""Volume meshes: hexahedra of a checked map's own grid, or tetrahedra of a part's solid.

Input: CheckedMap (no kernel is loaded), or a compiled part. Output: VolumeMesh and MeshReport.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod
from typing import TYPE_CHECKING, Literal

from pc2cad.checked import CheckedMap, Stages
from pc2cad.errors import InputError, require
from pc2cad.mesh.closure import check_whole
from pc2cad.mesh.columns import Columns
from pc2cad.mesh.grid import MOST_CELLS, Grading, UnsuitableGridError, make_grid
from pc2cad.mesh.hexahedra import hexahedra
from pc2cad.mesh.ogrid import o_grid
from pc2cad.mesh.places import FoundPlaces, GridPlaces, Places
from pc2cad.mesh.quality import measure
from pc2cad.mesh.report import MeshReport, report_on, side_areas
from pc2cad.mesh.volume_mesh import VolumeMesh

if TYPE_CHECKING:
    from pc2cad.mesh.tetrahedra import KernelSolid


@dataclass(frozen=True)
class MeshOptions:
    """What is asked of a mesh; lengths in model units."""

    #: cells along u, v and w; of tetrahedra, cubes of their size that fill the volume
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
        if self.shape == "tetrahedra" and self.core == "ogrid":
            raise InputError("tetrahedra have no core; an O-grid is one of hexahedra")
        if self.shape == "tetrahedra" and any(g.ratio != 1 for g in self.grading):
            raise InputError("tetrahedra have one size of cells; hexahedra may grow along u, v, w")
        if self.order not in (1, 2):
            raise InputError(f"elements have order 1 or 2, not {self.order}")


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
    volumes = (checked.mass.volume, [volume for volume, _ in checked.mass.layers])
    return mesh, report_on(mesh, quality, volumes, areas, cells, run.times)


def mesh_solid(
    part: KernelSolid,
    checked: CheckedMap | None,
    options: MeshOptions | None = None,
    stages: Stages | None = None,
) -> tuple[VolumeMesh, MeshReport]:
    """Return tetrahedra of a part's own solid by gmsh, and the report on them.

    Of one equation, which is `checked`, the mesh has u, v, w and fields. Raises PackageMissingError
    without gmsh, and MeshingFailedError.
    """
    require("gmsh", "tetrahedra")
    from pc2cad.mesh.tetrahedra import tetrahedra

    options, run = options or MeshOptions(shape="tetrahedra"), stages or Stages()
    size = options.size or _size(part.volume, options.cells, checked is None)
    _check_number(part, size)
    mesh = run("mesh", lambda: tetrahedra(part, size, options.order))
    if checked is not None:
        mesh = replace(mesh, columns=Columns(checked, mesh, FoundPlaces(checked, mesh)))
    quality = run("quality", lambda: measure(mesh))
    check_whole(mesh, quality.volume)
    volumes = (part.volume, list(part.layers.values()))
    return mesh, report_on(mesh, quality, volumes, part.areas, None, run.times)


def _check_number(part: KernelSolid, size: float) -> None:
    """Refuse what no memory holds: gmsh would try. Cubes and squares are fewer than elements."""
    cubes = max(part.volume / size**3, sum(part.areas.values()) / size**2)
    if cubes > MOST_CELLS:
        raise UnsuitableGridError(
            f"tetrahedra of the size {size:g} are more than {cubes:.1e}, and {MOST_CELLS:.0e} are "
            "the most; make them larger"
        )


def _size(volume: float, cells: tuple[int, int, int] | None, several: bool) -> float:
    """Return the edge of the cubes, as many as there are cells, that fill a volume."""
    if cells is None:
        return float(volume ** (1 / 3)) / 10
    if several:
        raise InputError("several bodies have a size of cells, not numbers of them along u, v, w")
    if min(cells) < 1:
        raise InputError(f"there is at least one cell along u, v and w, not {min(cells)}")
    return float((volume / prod(cells)) ** (1 / 3))
