"""GoTools spline volumes (.g2): class 700, poles with the first axis fastest."""

from __future__ import annotations

from pc2cad.export.spline_files import numbers, rows
from pc2cad.representation.volume import VolumeModel


def encode(model: VolumeModel) -> str:
    """Return the text of the file: one volume per patch; rational poles are homogeneous."""
    lines = []
    for patch in model.patches:
        volume = patch.volume
        lines += ["700 1 0 0", f"3 {int(volume.weights is not None)}"]
        for axis in volume.axes:
            lines.append(f"{axis.space.size} {axis.space.degree + 1}")
            lines.append(numbers(axis.space.knots))
        lines += rows(volume, homogeneous=True)
        lines.append("")
    return "\n".join(lines)
