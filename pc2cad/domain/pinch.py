"""What a refusal says where the boundary touches itself in a vertex.

A pinch alone refuses nothing: two cones with one apex make a solid that is built. Where the shells
or the kernel's solid are not as they should be, however, it is the reason.
"""

from __future__ import annotations

from pc2cad.domain.analysis import Analysis
from pc2cad.errors import NotASolidError
from pc2cad.topology.pinches import pinches


class PinchedBoundaryError(NotASolidError):
    """The boundary touches itself in a vertex, where the solid has no thickness."""


def pinch_of(analysis: Analysis) -> PinchedBoundaryError | None:
    """Return what to raise of the first vertex in which the boundary touches itself, if any."""
    boundary = analysis.boundary
    found = pinches(boundary, range(len(boundary.faces)))
    if not found:
        return None
    pinch = found[0]
    corner = boundary.vertices[pinch.vertex].corners[0]
    place = [analysis.bounds[d][corner[d] // 2] for d in range(3)]
    noise = analysis.scale.same_point
    point = ", ".join(f"{x if abs(x) > noise else 0:.6g}" for x in analysis.map.points(*place))
    rows = [sorted({boundary.name(boundary.faces[face].patch) for face in row})
            for row in pinch.sheets]  # fmt: skip
    shown = " and ".join(", ".join(row) for row in rows)
    return PinchedBoundaryError(
        f"the boundary touches itself in the point ({point}), at {analysis.map.shown(place)}: "
        f"{len(rows)} sheets of it ({shown}) meet there and nowhere nearby, so that the solid is "
        "pinched to nothing; leave that end out of the domain, or keep the sheets apart there"
    )
