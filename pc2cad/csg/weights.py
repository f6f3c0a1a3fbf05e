"""Mass, centre of mass and inertia of a solid of several bodies, and how they change.

Moments come from the kernel's faces by the divergence theorem. Where bodies differ in density, they
are cut along one another and the pieces weighed. By Reynolds' theorem the moment of f changes by
∫ f V·n dA, with V = ∂M/∂p of the body whose side a face is a part of; how the edges between bodies
move does not matter.

*Source:* J. Sokolowski, J.-P. Zolésio, Introduction to Shape Optimization (1992), chapter 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import symmetric
from pc2cad.brep.booleans import NamedShape, original
from pc2cad.brep.forms import PAIRS
from pc2cad.brep.inspect import bounding_box
from pc2cad.brep.integrals import face_integrals, faces_of, second_moments, solid_integrals
from pc2cad.csg.fields import field_formulas
from pc2cad.csg.graded import Graded
from pc2cad.csg.moving import COLUMNS, Moving, NoAngleError, places
from pc2cad.csg.regions import Piece, Told, pieces_of, regions
from pc2cad.domain.velocity import NotDifferentiableError
from pc2cad.equation.fields import DENSITY
from pc2cad.errors import InputError
from pc2cad.integrals.inertia import Mass, inertia_of, joined, made, weighed_by
from pc2cad.mesh.tetrahedra import KernelSolid
from pc2cad.part import Body
from pc2cad.part.several import BodiesSensitivity
from pc2cad.report import Report
from pc2cad.sampling.formulas import FieldFormula
from pc2cad.templates.bodies import Tree
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face

    #: a face as it is turned, and the sides that it is a part of
    NamedFace = tuple[TopoDS_Face, tuple[SideKey, ...]]


SOURCE = "B-rep (divergence theorem)"
HOW = "flux of the derivative of the equations"


@dataclass(frozen=True, eq=False)
class Joined:
    """The result of several bodies: see `Several`."""

    result: Tree
    parts: Mapping[str, Body]
    told: Told
    shape: NamedShape
    report: Report
    #: see Bodies.placed_at
    placed_at: Callable[[str, Fraction], Tree]

    def regions(self) -> KernelSolid:
        """See Several.regions."""
        return regions(self.result, self.parts, self.told)

    def face_sides(self) -> tuple[tuple[SideKey, ...], ...]:
        """See Several.face_sides."""
        return tuple(keys for _, keys in self.shape.faces)

    def formulas(self, fields: Sequence[str]) -> dict[str, FieldFormula]:
        """See Several.formulas."""
        return field_formulas(self.result, self.parts, lambda: self._pieces, fields)

    def mass(self, density: float | str | Mapping[str, float] | None) -> Mass:
        """See Several.mass; raise InputError, RegionsDisagreeError."""
        given = self._given(density)
        if given is not None:
            return self._by_pieces(given)
        whole = self.report.solid
        (solid,) = self.shape.solids
        values = second_moments(solid, np.array(whole.centroid))
        rho = weighed_by(1.0 if density is None else density)
        error = self._error(float(np.trace(values)))
        return made(rho * whole.volume, whole.centroid, rho * values, error, SOURCE, rho)

    def _given(
        self, density: float | str | Mapping[str, float] | None
    ) -> dict[str, float | str] | None:
        """Return the density of each body that has one, or its field; None: one for all."""
        field = density if isinstance(density, str) else DENSITY
        own: dict[str, float | str] = {
            name: field for name, body in self.parts.items()
            if any(known.name == field for known in body.equation.fields)
        }  # fmt: skip
        if isinstance(density, Mapping):
            return own | _checked(density, self.parts, self.report.name)
        if isinstance(density, str) and not own:
            raise InputError(f"no body of {self.report.name} has a field '{density:.80}'")
        return own if own and (density is None or isinstance(density, str)) else None

    @cached_property
    def _pieces(self) -> list[Piece]:
        return pieces_of(self.result, self.parts, self.told)

    def _error(self, moment: float) -> float:
        """Return what is open of the volume as a share of it, or of a moment at its far end."""
        whole = self.report.solid
        far = np.abs(bounding_box(self.shape.solids[0]) - np.array(whole.centroid)).max(axis=0)
        error = whole.relative_error or 0.0
        return max(error, error * whole.volume * float(far @ far) / moment)

    def _by_pieces(self, given: Mapping[str, float | str]) -> Mass:
        found: dict[str, list[Mass]] = {}
        for piece in self._pieces:
            body, rho = _told_by(given, piece)
            whole = solid_integrals(piece.solid)
            values = second_moments(piece.solid, np.array(whole.centroid))
            error = self._error(float(np.trace(values)))
            if isinstance(rho, str):
                own = self._graded(body, rho).mass(piece, error)
            else:
                own = made(rho * whole.volume, whole.centroid, rho * values, error, SOURCE, rho)
            found.setdefault(piece.name, []).append(own)
        layers = {name: _one(rows) for name, rows in found.items()}
        volume = sum(row.mass / row.density for row in layers.values())
        off = abs(volume / self.report.solid.volume - 1)
        return joined(layers, volume, off)

    def _graded(self, body: str, field: str) -> Graded:
        if (body, field) not in self._known:
            place = dict(places(self.result))[body]
            self._known[body, field] = Graded(self.parts[original(body)], body, field, place)
        return self._known[body, field]

    @cached_property
    def _known(self) -> dict[tuple[str, str], Graded]:
        return {}

    def sensitivity(
        self, name: str, density: float | str | Mapping[str, float] | None
    ) -> BodiesSensitivity:
        """See Several.sensitivity; raise InputError, NotDifferentiableError."""
        moving = Moving(self.result, self.parts, self.placed_at, name)
        mass, whole = self.mass(density), self.report.solid
        centre = np.array(mass.centroid)
        # the solid's own faces: those that are kept by name may be turned the other way
        turned = faces_of(self.shape.solids[0])
        faces = [(f, keys) for f, (_, keys) in zip(turned, self.shape.faces, strict=True)]
        total = self._flux(faces, moving, centre)
        given = self._given(density)
        if given is not None:
            weighed = np.zeros(COLUMNS)
            for piece in self._pieces:
                body, rho = _told_by(given, piece)
                if isinstance(rho, str):
                    shared = [(face, keys) for face, keys in piece.faces if len(keys) > 1]
                    self._flux(shared, moving, centre)  # which part, and have no derivative
                    weighed[:10] += self._graded(body, rho).change(piece, moving, centre)
                else:
                    weighed += rho * self._flux(piece.faces, moving, centre)
        else:
            weighed = mass.density * total
        way = np.subtract(whole.centroid, centre)
        x, y, z = ((total[1:4] - way * total[0]) / whole.volume).tolist()
        a, b, c = inertia_of(symmetric(PAIRS, weighed[4:10])).tolist()
        volume, open_ = float(total[0]), ""
        try:
            area: float | None = float(total[10]) + moving.edges(self.shape)
        except NoAngleError as error:
            area, open_ = None, str(error)
        return BodiesSensitivity(
            name, moving.value, volume, area, (x, y, z), float(weighed[0]),
            (tuple(a), tuple(b), tuple(c)), volume,
            max(whole.relative_error or 0.0, moving.doubt), HOW, open_,
        )  # fmt: skip

    def _flux(
        self,
        faces: Sequence[NamedFace],
        moving: Moving,
        centre: Array,
    ) -> Array:
        """Return the integrals of `Moving.form` over faces."""
        total = np.zeros(COLUMNS)
        for face, keys in faces:
            forms = [moving.form(key, centre) for key in keys]
            rows = [np.zeros(COLUMNS) if f is None else face_integrals(face, centre, f)[5:]
                    for f in forms]  # fmt: skip
            _check_together(rows, keys, moving.name)
            total += rows[0]
        return total


def _told_by(given: Mapping[str, float | str], piece: Piece) -> tuple[str, float | str]:
    """Return the body whose density a piece has, and that; InputError where several differ."""
    own = {
        body: given[name] for body in sorted(piece.bodies)
        if (name := original(body)) in given
    }  # fmt: skip
    if not own:
        raise InputError(
            f"{' and '.join(sorted(piece.bodies))} has no density: give it a number "
            "(--density BODY=NUMBER), or a field of that name"
        )
    values = {*own.values()}
    if len(values) > 1 or (len(own) > 1 and any(isinstance(value, str) for value in values)):
        raise InputError(
            f"{' and '.join(own)} overlap, and their densities differ: cut one of them "
            "from the other in the result, or give them the same"
        )
    return next(iter(own.items()))


def _one(rows: Sequence[Mass]) -> Mass:
    """Return several pieces of one density as one."""
    if len(rows) == 1:
        return rows[0]
    volume = sum(row.mass / row.density for row in rows)
    together = joined({str(k): row for k, row in enumerate(rows)}, volume)
    return replace(together, layers={})


def _checked(
    given: Mapping[str, float], parts: Mapping[str, Body], name: str
) -> dict[str, float | str]:
    if not given or not {*given} <= {*parts}:
        raise InputError(
            f"densities are given for {', '.join(map(str, given)) or 'nothing'}, and {name} has "
            f"the bodies {', '.join(parts)}; give each body its own, or one number for all"
        )
    return {body: weighed_by(value) for body, value in given.items()}


def _check_together(rows: Sequence[Array], keys: Sequence[SideKey], name: str) -> None:
    """Raise NotDifferentiableError where sides that coincide part as the parameter changes."""
    # how they move along themselves may differ, and so may the last column
    for row in rows[1:]:
        if not np.allclose(row[:10], rows[0][:10], rtol=1e-6, atol=1e-9 * np.abs(row).max()):
            raise NotDifferentiableError(
                f"there is no derivative with respect to {name}: "
                f"{' and '.join(key.label for key in keys)} coincide, and part as it changes"
            )
