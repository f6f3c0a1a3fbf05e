"""The boundary model as sheets: what was built, for a comparison of all faces with one another.

Splines and surfaces whose region is a rectangle of their own parameters are taken as they are. A
plane's region is held by any surface in the plane that has the region's boundary: one is made from
the sides, as their neighbours carry them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import assert_never

import numpy as np

from pc2cad.arrays import Array
from pc2cad.geometry.carriers import (
    AnalyticSurface,
    Arc,
    Cone,
    CurveCarrier,
    Cylinder,
    Extrusion,
    Frame,
    Line,
    Plane,
    Revolution,
    Sphere,
    SplineSurface,
    Torus,
)
from pc2cad.geometry.sheets import (
    Sheet,
    SheetSide,
    circle_pieces,
    curve_pieces,
    elevated,
    patches_of,
    restriction,
    surface_limits,
    surface_patches,
)
from pc2cad.representation.boundary_model import BoundaryModel, ModelEdge, ModelFace
from pc2cad.representation.rectangles import AT_LIMIT, Range, rectangle_of
from pc2cad.representation.trimming import is_upwards
from pc2cad.topology.complex import BoundaryComplex, EdgeUse

#: with an axis, and a meridian in the half plane beside it
_Turned = Cylinder | Cone | Sphere | Torus | Revolution
#: weights that differ by less are one
SAME_WEIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class _Pieces:
    """A side as Bézier pieces (k, p+1, 4) along a sheet's own parameter, with their coordinates."""

    nets: Array
    #: of the ends of the pieces: along the sheet's parameter from 0 to 1, and along the edge
    places: Array
    along: Array

    def reversed(self) -> _Pieces:
        return _Pieces(self.nets[::-1, ::-1], 1 - self.places[::-1], self.along[::-1])

    def at(self, places: Array) -> _Pieces:
        """Return the same side in pieces that end at some places, its own among them."""
        middles = (places[:-1] + places[1:]) / 2
        if np.array_equal(places, self.places):
            return self
        index = np.clip(np.searchsorted(self.places, middles) - 1, 0, len(self.nets) - 1)
        start, step = self.places[index], np.diff(self.places)[index]
        low, high = ((x - start) / step for x in (places[:-1], places[1:]))
        matrices = restriction(self.nets.shape[1] - 1, low, high)
        nets = np.einsum("kij,kjc->kic", matrices, self.nets[index])
        return _Pieces(nets, places, np.interp(places, self.places, self.along))


def sheets_of(model: BoundaryModel) -> tuple[list[Sheet], list[int]]:
    """Return the sheets of all faces that can be taken so, and the faces that cannot."""
    sheets: list[Sheet] = []
    left: list[int] = []
    splines = {
        index: face.carrier
        for index, face in enumerate(model.faces)
        if isinstance(face.carrier, SplineSurface)
    }
    places = dict(zip(splines, surface_limits(list(splines.values())), strict=True))
    for index, face in enumerate(model.faces):
        if isinstance(face.carrier, Plane):
            continue
        sheet = _curved(model.complex, index, face, places.get(index))
        if sheet is None:
            left.append(index)
        else:
            sheets.append(sheet)
    rows = _rows(sheets)
    for index, face in enumerate(model.faces):
        if isinstance(face.carrier, Plane):
            flat = [_flat(model, index, cell, rows) for cell in face.cells]
            if any(sheet is None for sheet in flat):
                left.append(index)
            sheets += [sheet for sheet in flat if sheet is not None]
    return sheets, left


def _curved(
    boundary: BoundaryComplex, index: int, face: ModelFace, places: tuple[Array, Array] | None
) -> Sheet | None:
    """Return the sheet of a face, of a spline's with the ends of its pieces along s and t."""
    carrier, cell = face.carrier, face.cells[0]
    if isinstance(carrier, SplineSurface):
        assert places is not None
        sides = tuple(
            _side(boundary, use, is_upwards(k, use), places[k % 2])
            for k, use in enumerate(face.uses)
        )
        patches = surface_patches(carrier, places)
    else:
        assert not isinstance(carrier, Plane)
        region = rectangle_of(face)
        if region is None:
            return None
        (a, b), uses = region
        nets, tables = _analytic_nets(carrier, a, b)
        patches = patches_of(nets)
        sides = tuple(
            _side(boundary, use, upwards, tables[k % 2]) for k, (use, upwards) in enumerate(uses)
        )
    own = isinstance(carrier, SplineSurface)
    named = (sides[0], sides[1], sides[2], sides[3])
    return Sheet(index, cell, patches, named, name=face.name, own=own)


def _side(boundary: BoundaryComplex, use: EdgeUse, upwards: bool, places: Array) -> SheetSide:
    """Return a side whose patches end at some places of the sheet's parameter, from 0 to 1."""
    if use.edge is None:
        return SheetSide(None, (use.vertex, use.vertex), places)
    edge = boundary.edges[use.edge]
    if upwards:
        return SheetSide(use.edge, (edge.start, edge.end), places)
    return SheetSide(use.edge, (edge.end, edge.start), 1 - places)


# -- surfaces with parameters of their own ---------------------------------------------------------


def _even(count: int) -> Array:
    return np.arange(count + 1) / count


def _straight(a: Range) -> Array:
    return np.array([[[a[0], 1.0], [a[1], 1.0]]])


def _analytic_nets(
    carrier: AnalyticSurface, a: Range, b: Range
) -> tuple[Array, tuple[Array, Array]]:
    """Return patches of a rectangle of parameters, and where they end along both from 0 to 1."""
    if isinstance(carrier, Extrusion):
        basis, places = _curve(carrier.basis, a)
        lengths = _straight(b)[0]
        nets = np.repeat(basis[:, None, :, None, :], 2, axis=3)
        nets[..., :3] += basis[:, None, :, None, 3:] * lengths[:, 0, None] * carrier.direction
        return nets, (places, _even(1))
    frame = carrier.frame
    profile, places = _meridian(carrier, b)
    arcs = circle_pieces(*a)
    x, y, z = frame.axes
    r, h, w = (profile[:, None, None, :, k, None] for k in range(3))
    c, s, v = (arcs[None, :, :, None, k, None] for k in range(3))
    points = r * (c * x + s * y) + h * v * z + w * v * frame.origin
    nets = np.concatenate((points, w * v), axis=-1).transpose(1, 0, 2, 3, 4)
    return np.ascontiguousarray(nets), (_even(len(arcs)), places)


def _meridian(carrier: _Turned, b: Range) -> tuple[Array, Array]:
    """Return pieces (radius, height, 1) times the weight, (k, p+1, 3), and where they end."""
    if isinstance(carrier, Revolution):
        pieces, places = _curve(carrier.basis, b)
        gap = pieces[..., :3] - pieces[..., 3:] * carrier.frame.origin
        axes = carrier.frame.axes
        return np.stack((gap @ axes[0], gap @ axes[2], pieces[..., 3]), axis=-1), places
    if isinstance(carrier, Sphere | Torus):
        arcs = circle_pieces(*b)
        radius = carrier.radius if isinstance(carrier, Sphere) else carrier.minor
        major = 0.0 if isinstance(carrier, Sphere) else carrier.major
        arcs[..., :2] *= radius
        arcs[..., 0] += major * arcs[..., 2]
        return arcs, _even(len(arcs))
    if not isinstance(carrier, Cylinder | Cone):
        assert_never(carrier)
    angle = carrier.angle if isinstance(carrier, Cone) else 0.0
    t = np.array(b)
    ends = np.stack(
        (carrier.radius + t * np.sin(angle), t * np.cos(angle), np.ones(2)), axis=-1
    )  # fmt: skip
    return ends[None], _even(1)


def _curve(curve: CurveCarrier, a: Range) -> tuple[Array, Array]:
    """Return pieces of a carrier between two parameters, and where they end from 0 to 1."""
    if isinstance(curve, Line):
        length = float(np.linalg.norm(curve.end - curve.start))
        t = np.array(a)[:, None] / length
        points = curve.start + t * (curve.end - curve.start)
        return np.concatenate((points, np.ones((2, 1))), axis=1)[None], _even(1)
    if isinstance(curve, Arc):
        return _conic(curve.frame, curve.radii, a)
    pieces, places = curve_pieces(curve)
    slack = AT_LIMIT * (a[1] - a[0])
    if abs(a[0]) <= slack and abs(a[1] - 1) <= slack:
        return pieces, places
    inner = places[(places > a[0] + slack) & (places < a[1] - slack)]
    some = np.concatenate(([a[0]], inner, [a[1]]))
    cut = _Pieces(pieces, places, places).at(some)
    return cut.nets, (some - a[0]) / (a[1] - a[0])


def _conic(frame: Frame, radii: tuple[float, float], a: Range) -> tuple[Array, Array]:
    arcs = circle_pieces(*a)
    c, s, w = (arcs[..., k, None] for k in range(3))
    points = c * radii[0] * frame.axes[0] + s * radii[1] * frame.axes[1] + w * frame.origin
    return np.concatenate((points, w), axis=-1), _even(len(arcs))


# -- planes ----------------------------------------------------------------------------------------


def _rows(sheets: Sequence[Sheet]) -> dict[int, tuple[Sheet, int]]:
    """Return sheets and their sides by their edges."""
    found: dict[int, tuple[Sheet, int]] = {}
    for sheet in sheets:
        for k, side in enumerate(sheet.sides):
            if side.edge is not None:
                found.setdefault(side.edge, (sheet, k))
    return found


def _row(sheet: Sheet, k: int) -> _Pieces:
    """Return a side of a sheet along its edge's own direction."""
    row, along = sheet.row(k), sheet.sides[k].along
    if along[0] < along[-1]:
        return _Pieces(row, along, along)
    return _Pieces(row, 1 - along, along).reversed()


def _flat(
    model: BoundaryModel, index: int, cell: int, rows: dict[int, tuple[Sheet, int]]
) -> Sheet | None:
    """Return a sheet in a plane with the sides of a patch, or None."""
    face, boundary = model.faces[index], model.complex
    uses = boundary.faces[cell].uses
    sides = []
    for k, use in enumerate(uses):
        pieces = _plane_side(model, use, rows)
        sides.append(pieces if is_upwards(k, use) else pieces.reversed())
    bent = [k for k, side in enumerate(sides) if len(side.nets) > 1 or side.nets.shape[1] > 2]
    if bent in ([], [0], [2], [0, 2]):
        nets, cuts, separable = _ruled(sides[0], sides[2])
    elif bent in ([1], [3], [1, 3]):
        nets, cuts, separable = _ruled(sides[3], sides[1])
        nets, cuts = nets.transpose(1, 0, 3, 2, 4), cuts[::-1]
    else:
        nets, cuts, separable = _coons(sides)
    if not (nets[..., 3] > 0).all():
        return None
    made = []
    for k, (use, side) in enumerate(zip(uses, sides, strict=True)):
        made.append(
            replace(
                _side(boundary, use, is_upwards(k, use), cuts[k % 2]),
                along=np.interp(cuts[k % 2], side.places, side.along),
            )
        )
    assert isinstance(face.carrier, Plane)
    return Sheet(index, cell, patches_of(nets), (made[0], made[1], made[2], made[3]), separable,
                 face.carrier, face.name)  # fmt: skip


def _plane_side(model: BoundaryModel, use: EdgeUse, rows: dict[int, tuple[Sheet, int]]) -> _Pieces:
    """Return a side in pieces along its edge's own direction."""
    unit = np.array([0.0, 1.0])
    if use.edge is None:
        ends = model.vertices[[use.vertex, use.vertex]]
        return _Pieces(np.column_stack((ends, np.ones(2)))[None], unit, unit)
    edge, carrier = model.complex.edges[use.edge], model.edges[use.edge].carrier
    if isinstance(carrier, Line):
        # of a line that was joined with the next one only its own part
        ends = model.vertices[[edge.start, edge.end]]
        return _Pieces(np.column_stack((ends, np.ones(2)))[None], unit, unit)
    if use.edge in rows:
        return _row(*rows[use.edge])
    limits = (carrier.start, carrier.end) if isinstance(carrier, Arc) else (0.0, 1.0)
    nets, places = _curve(carrier, limits)
    return _Pieces(nets, places, places)


def _cut(first: _Pieces, second: _Pieces) -> tuple[_Pieces, _Pieces, Array]:
    """Return two sides in pieces that end at equal places."""
    both = np.sort(np.concatenate((first.places, second.places)))
    places = both[np.concatenate(([True], np.diff(both) > AT_LIMIT))]
    places[-1] = 1.0
    return first.at(places), second.at(places), places


def _merged(first: _Pieces, second: _Pieces) -> tuple[_Pieces, _Pieces, Array]:
    """Return two sides in pieces that end at equal places and have one degree."""
    one, other, places = _cut(first, second)
    degree = max(part.nets.shape[1] for part in (one, other)) - 1
    raised = [replace(part, nets=elevated(part.nets, degree, 1)) for part in (one, other)]
    return raised[0], raised[1], places


def _ruled(first: _Pieces, second: _Pieces) -> tuple[Array, tuple[Array, Array], bool]:
    """Return the surface of lines between the sides t = 0 and t = 1."""
    one, other, places = _merged(first, second)
    a, b = one.nets, other.nets
    straight = [len(side.nets) == 1 and side.nets.shape[1] == 2 for side in (first, second)]
    # a straight side may run at any speed: at that which the other's weights give it
    if straight[0]:
        a = a * b[..., 3:]
    elif straight[1]:
        b = b * a[..., 3:]
    if np.abs(a[..., 3] - b[..., 3]).max() > SAME_WEIGHT:
        # each times the other's weight: then both have the same
        one, other, places = _cut(first, second)
        a, b = _times(one.nets, other.nets[..., 3]), _times(other.nets, one.nets[..., 3])
    return np.stack((a, b), axis=2)[:, None], (places, _even(1)), True


def _times(nets: Array, weights: Array) -> Array:
    """Return products of Bézier pieces (k, p+1, 4) and polynomials (k, q+1), (k, p+q+1, 4)."""
    p, q = nets.shape[1] - 1, weights.shape[1] - 1
    result = np.zeros((len(nets), p + q + 1, 4))
    for i in range(p + 1):
        for j in range(q + 1):
            share = comb(p, i) * comb(q, j) / comb(p + q, i + j)
            result[:, i + j] += share * nets[:, i] * weights[:, j, None]
    return result


def _coons(sides: Sequence[_Pieces]) -> tuple[Array, tuple[Array, Array], bool]:
    """Return the surface that blends four sides."""
    low, high, along_s = _merged(sides[0], sides[2])
    left, right, along_t = _merged(sides[3], sides[1])
    p, q = low.nets.shape[1] - 1, left.nets.shape[1] - 1
    s = along_s[:-1, None] + np.diff(along_s)[:, None] * np.arange(p + 1) / p
    t = along_t[:-1, None] + np.diff(along_t)[:, None] * np.arange(q + 1) / q
    s, t = s[:, None, :, None, None], t[None, :, None, :, None]
    across = (1 - t) * low.nets[:, None, :, None] + t * high.nets[:, None, :, None]
    along = (1 - s) * left.nets[None, :, None] + s * right.nets[None, :, None]
    corners = [
        side.nets[k, j] for side, k, j in ((low, 0, 0), (low, -1, -1), (high, 0, 0), (high, -1, -1))
    ]
    bilinear = ((1 - s) * corners[0] + s * corners[1]) * (1 - t)
    bilinear = bilinear + ((1 - s) * corners[2] + s * corners[3]) * t
    nets = across + along - bilinear
    plain = bool(np.abs(nets[..., 3] - 1).max() <= SAME_WEIGHT)
    return nets, (along_s, along_t), plain


def edge_lines(edges: Sequence[ModelEdge], boundary: BoundaryComplex, points: Array) -> Array:
    """Return start and step of the edges that are straight (E, 2, 3), NaN for others."""
    result = np.full((len(edges), 2, 3), np.nan)
    for index, (edge, own) in enumerate(zip(edges, boundary.edges, strict=True)):
        if isinstance(edge.carrier, Line):
            start, end = points[own.start], points[own.end]
            result[index] = start, end - start
    return result
