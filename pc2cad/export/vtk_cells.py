"""How VTK numbers the types and the nodes of cells: for .vtu and .vtk alike."""

from __future__ import annotations

from pc2cad.arrays import Integers
from pc2cad.export.mesh_files import CellBlock

#: type numbers of VTK by element and order
VTK_TYPES = {
    ("hexahedron", 1): 12, ("hexahedron", 2): 25, ("wedge", 1): 13, ("wedge", 2): 26,
    ("pyramid", 1): 14, ("pyramid", 2): 27, ("tetra", 1): 10, ("tetra", 2): 24,
    ("quad", 1): 9, ("quad", 2): 23, ("triangle", 1): 5, ("triangle", 2): 22,
}  # fmt: skip
#: nodes of cells that VTK numbers otherwise than pc2cad. The first triangle of VTK_WEDGE runs
#: anti-clockwise as seen from outside, that of VTK_QUADRATIC_WEDGE clockwise, as all bases do:
#: so VTK's faces, sizes, checks of validity and measures of quality have them
_COLUMNS = {("wedge", 1): (0, 2, 1, 3, 5, 4)}


def nodes_for_vtk(block: CellBlock, order: int) -> Integers:
    """Return the nodes of cells in the order of VTK, (n, k)."""
    columns = _COLUMNS.get((block.kind, order))
    return block.nodes if columns is None else block.nodes[:, list(columns)]
