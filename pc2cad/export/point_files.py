"""Point sets: PLY (.ply, binary), NumPy archives (.npz) and VTK polydata (.vtp), with u, v, w."""

from __future__ import annotations

import io
import os
import sys
from typing import Protocol

import numpy as np

from pc2cad.export.files import by_ending, check_target, write_atomically
from pc2cad.sampling.interior import PointSet
from pc2cad.trust.names import percent


class PointEncoder(Protocol):
    """What makes the bytes of a point file."""

    def __call__(self, points: PointSet, /) -> bytes:
        """Return the file of a point set."""
        ...


def encode_ply(points: PointSet) -> bytes:
    """Return a binary PLY file: vertices with the double properties x, y, z, u, v, w."""
    order = "little" if sys.byteorder == "little" else "big"
    properties = "\n".join(f"property double {name}" for name in "xyzuvw")
    head = (
        f"ply\nformat binary_{order}_endian 1.0\ncomment {_plain(points)}\n"
        f"element vertex {len(points.points)}\n{properties}\nend_header\n"
    )
    return head.encode() + np.hstack((points.points, points.parameters)).tobytes()


def encode_npz(points: PointSet) -> bytes:
    """Return a NumPy archive with the arrays points, parameters and spacing."""
    stream = io.BytesIO()
    np.savez(
        stream, points=points.points, parameters=points.parameters, spacing=points.spacing,
        units=points.units,
    )  # fmt: skip
    return stream.getvalue()


def encode_vtp(points: PointSet) -> bytes:
    """Return VTK polydata (raw binary): vertices with the point data ``uvw``."""
    count = len(points.points)
    arrays = [points.points, points.parameters, np.arange(count), np.arange(1, count + 1)]
    offsets = np.cumsum([0] + [8 + array.nbytes for array in arrays])
    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"

    def tag(index: int, name: str, kind: str, components: int = 1) -> str:
        return (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" '
            f'format="appended" offset="{offsets[index]}"/>'
        )

    head = f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="{order}" header_type="UInt64">
<PolyData>
<Piece NumberOfPoints="{count}" NumberOfVerts="{count}">
<PointData>{tag(1, "uvw", "Float64", 3)}</PointData>
<Points>{tag(0, "Points", "Float64", 3)}</Points>
<Verts>{tag(2, "connectivity", "Int64")}{tag(3, "offsets", "Int64")}</Verts>
</Piece>
</PolyData>
<AppendedData encoding="raw">
_"""
    body = b"".join(np.uint64(array.nbytes).tobytes() + array.tobytes() for array in arrays)
    return head.encode() + body + b"\n</AppendedData>\n</VTKFile>\n"


POINT_FORMATS: dict[str, PointEncoder] = {
    ".ply": encode_ply,
    ".npz": encode_npz,
    ".vtp": encode_vtp,
}


def check_points_writable(path: str | os.PathLike[str]) -> None:
    """Find out before a computation whether points can be written to `path`."""
    by_ending(path, POINT_FORMATS, "point file")
    check_target(path)


def write_points(points: PointSet, path: str | os.PathLike[str]) -> None:
    """Write a point set in the format of the name's ending, whole or not at all.

    Raises InputError for an unknown ending, FileNotWrittenError.
    """
    write_atomically(path, by_ending(path, POINT_FORMATS, "point file")(points))


def _plain(points: PointSet) -> str:
    """Return name and unit for a comment; the word that ends the header is escaped."""
    name = percent(points.name, "", limit=200, words=("end_header", "texturefile"))
    return f"{name} ({points.units})"
