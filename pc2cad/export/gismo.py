"""G+Smo multi-patch (.xml): tensor B-splines or NURBS with interfaces and labelled boundaries.

A field has a file of its own, a multi-patch on the same bases: many readers take all patches of a
file for one geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from pc2cad.export.patches import Interface, interfaces, sides
from pc2cad.export.spline_files import numbers, rows
from pc2cad.geometry.splines.trivariate import SplineVolume
from pc2cad.representation.volume import VolumeModel
from pc2cad.trust.names import clean


def encode(model: VolumeModel) -> str:
    """Return the text of the file; boundary sides carry the names of the solid's sides."""
    return _encoded(model, [patch.volume for patch in model.patches])


def encode_field(model: VolumeModel, name: str) -> str:
    """Return the text of a field's file; raise InputError where there is no such field."""
    return _encoded(model, model.field(name).volumes)


def _encoded(model: VolumeModel, volumes: Sequence[SplineVolume]) -> str:
    count = len(model.patches)
    joined = interfaces(model)
    taken = {(i.first, i.first_side) for i in joined} | {(i.second, i.second_side) for i in joined}
    free: dict[str, list[str]] = {}
    for patch, side, key, _ in sides(model):
        if (patch, side) not in taken:
            free.setdefault(key.whole.label, []).append(f"{patch} {side + 1}")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "<xml>",
        f'<MultiPatch parDim="3" id="{count}">',
        f'<patches type="id_range">0 {count - 1}</patches>',
        f"<interfaces>{chr(10).join(_joint(i) for i in joined)}</interfaces>",
    ]
    for name, places in free.items():
        listed = "\n".join(places)
        lines.append(f"<boundary name={quoteattr(clean(name))}>{listed}</boundary>")
    lines.append("</MultiPatch>")
    for identifier, volume in enumerate(volumes):
        lines += _geometry(volume, identifier)
    lines.append("</xml>\n")
    return "\n".join(lines)


def _joint(i: Interface) -> str:
    axes = " ".join(map(str, i.axes))
    forward = " ".join(str(int(f)) for f in i.forward)
    return f"{i.first} {i.first_side + 1} {i.second} {i.second_side + 1} {axes} {forward}"


def _geometry(volume: SplineVolume, identifier: int) -> list[str]:
    kind = "BSpline" if volume.weights is None else "Nurbs"
    lines = [f'<Geometry type="Tensor{kind}3" id="{identifier}">']
    if volume.weights is not None:
        lines.append('<Basis type="TensorNurbsBasis3">')
    lines.append('<Basis type="TensorBSplineBasis3">')
    for k, axis in enumerate(volume.axes):
        lines += [
            f'<Basis type="BSplineBasis" index="{k}">',
            f'<KnotVector degree="{axis.space.degree}">{numbers(axis.space.knots)}</KnotVector>',
            "</Basis>",
        ]
    lines.append("</Basis>")
    if volume.weights is not None:
        weights = numbers(volume.weights.transpose(2, 1, 0).ravel())
        lines += [f"<weights>{weights}</weights>", "</Basis>"]
    poles = "\n".join(rows(volume, homogeneous=False, weight="nowhere"))
    lines += [f'<coefs geoDim="{volume.poles.shape[-1]}">\n{poles}\n</coefs>', "</Geometry>"]
    return lines
