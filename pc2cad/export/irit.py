"""IRIT data (.itd): trivariate B-splines, the weight of rational ones before the pole."""

from __future__ import annotations

from pc2cad.export.spline_files import numbers, rows
from pc2cad.representation.volume import VolumeModel


def encode(model: VolumeModel) -> str:
    """Return the text of the file: one object with one trivariate per patch."""
    lines = ["[OBJECT PC2CAD"]
    for patch in model.patches:
        volume = patch.volume
        spaces = [axis.space for axis in volume.axes]
        sizes = " ".join(str(s.size) for s in spaces)
        orders = " ".join(str(s.degree + 1) for s in spaces)
        lines.append(
            f"  [TRIVAR BSPLINE {sizes} {orders} {'E3' if volume.weights is None else 'P3'}"
        )
        lines += [f"    [KV {numbers(s.knots)}]" for s in spaces]
        lines += [f"    [{row}]" for row in rows(volume, homogeneous=True, weight="first")]
        lines.append("  ]")
    lines.append("]\n")
    return "\n".join(lines)
