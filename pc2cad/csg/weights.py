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

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.booleans import NamedShape
from pc2cad.brep.forms import PAIRS, Form
from pc2cad.brep.inspect import bounding_box
from pc2cad.brep.integrals import face_integrals, second_moments, solid_integrals
from pc2cad.csg.regions import Told, pieces_of, regions
from pc2cad.domain.velocity import NotDifferentiableError, velocity
from pc2cad.equation.fields import DENSITY
from pc2cad.errors import InputError
from pc2cad.integrals.inertia import Mass, joined, made, weighed_by
from pc2cad.mesh.tetrahedra import KernelSolid
from pc2cad.part import Body
from pc2cad.part.several import BodiesSensitivity
from pc2cad.report import Report
from pc2cad.sampling.on_sides import SidePlaces
from pc2cad.templates.bodies import Operation, Pattern
from pc2cad.topology.cells import SideKey

SOURCE = "B-rep (divergence theorem)"
HOW = "flux of the derivative of the equations"


@dataclass(frozen=True, eq=False)
class Joined:
    """The result of several bodies: see `Several`."""

    result: Operation | Pattern
    parts: Mapping[str, Body]
    told: Told
    shape: NamedShape
    report: Report

    def regions(self) -> KernelSolid:
        """See Several.regions."""
        return regions(self.result, self.parts, self.told)

    def face_sides(self) -> tuple[tuple[SideKey, ...], ...]:
        """See Several.face_sides."""
        return tuple(keys for _, keys in self.shape.faces)

    def mass(self, density: float | str | Mapping[str, float] | None) -> Mass:
        """See Several.mass; raise InputError, RegionsDisagreeError."""
        if isinstance(density, str) or (density is None and self._graded()):
            raise InputError(
                f"a density that is a field belongs to one body ({', '.join(self._graded())}): "
                "give one number for all, or one for each body"
            )
        if isinstance(density, Mapping):
            return self._by_pieces(_checked(density, self.parts, self.report.name))
        whole = self.report.solid
        (solid,) = self.shape.solids
        values = second_moments(solid, np.array(whole.centroid))
        rho = weighed_by(1.0 if density is None else density)
        error = self._error(float(np.trace(values)))
        return made(rho * whole.volume, whole.centroid, rho * values, error, SOURCE, rho)

    def _graded(self) -> list[str]:
        return [
            name for name, body in self.parts.items()
            if any(field.name == DENSITY for field in body.equation.fields)
        ]  # fmt: skip

    def _error(self, moment: float) -> float:
        """Return what is open of the volume as a share of it, or of a moment at its far end."""
        whole = self.report.solid
        far = np.abs(bounding_box(self.shape.solids[0]) - np.array(whole.centroid)).max(axis=0)
        error = whole.relative_error or 0.0
        return max(error, error * whole.volume * float(far @ far) / moment)

    def _by_pieces(self, given: Mapping[str, float]) -> Mass:
        found: dict[str, list[Mass]] = {}
        for name, piece in pieces_of(self.result, self.parts, self.told):
            own = {body: given[body.partition("[")[0]] for body in sorted(piece.bodies)}
            if len({*own.values()}) > 1:
                raise InputError(
                    f"{' and '.join(own)} overlap, and their densities differ: cut one of them "
                    "from the other in the result, or give them the same"
                )
            whole, rho = solid_integrals(piece.solid), next(iter(own.values()))
            values = second_moments(piece.solid, np.array(whole.centroid))
            error = self._error(float(np.trace(values)))
            found.setdefault(name, []).append(
                made(rho * whole.volume, whole.centroid, rho * values, error, SOURCE, rho)
            )
        layers = {name: _one(rows) for name, rows in found.items()}
        volume = sum(row.mass / row.density for row in layers.values())
        off = abs(volume / self.report.solid.volume - 1)
        return joined(layers, volume, off)

    def sensitivity(self, name: str, density: float | Mapping[str, float]) -> BodiesSensitivity:
        """See Several.sensitivity; raise InputError, NotDifferentiableError."""
        if isinstance(density, Mapping):
            raise InputError("of several bodies, figures are derived for one density")
        rho, whole = weighed_by(density), self.report.solid
        centre = np.array(whole.centroid)
        moving = {body: _Moving(part, name, centre) for body, part in self.parts.items()}
        doubt = max(one.doubt for one in moving.values())
        total = np.zeros(10)
        for face, keys in self.shape.faces:
            forms = [moving[_body(key, name)].form(key) for key in keys]
            rows = [np.zeros(10) if f is None else face_integrals(face, centre, f)[5:]
                    for f in forms]  # fmt: skip
            _check_together(rows, keys, name)
            total += rows[0]
        second = np.empty((3, 3))
        for (i, j), value in zip(PAIRS, rho * total[4:], strict=True):
            second[i, j] = second[j, i] = value
        x, y, z = (total[1:4] / whole.volume).tolist()
        a, b, c = (np.trace(second) * np.eye(3) - second).tolist()
        volume = float(total[0])
        return BodiesSensitivity(
            name, next(iter(moving.values())).value, volume, (x, y, z), rho * volume,
            (tuple(a), tuple(b), tuple(c)), volume, max(whole.relative_error or 0.0, doubt), HOW,
        )  # fmt: skip


def _one(rows: Sequence[Mass]) -> Mass:
    """Return several pieces of one density as one."""
    if len(rows) == 1:
        return rows[0]
    volume = sum(row.mass / row.density for row in rows)
    together = joined({str(k): row for k, row in enumerate(rows)}, volume)
    return replace(together, layers={})


def _checked(given: Mapping[str, float], parts: Mapping[str, Body], name: str) -> dict[str, float]:
    if {*given} != {*parts}:
        raise InputError(
            f"densities are given for {', '.join(map(str, given)) or 'nothing'}, and {name} has "
            f"the bodies {', '.join(parts)}; give each body its own, or one number for all"
        )
    return {body: weighed_by(value) for body, value in given.items()}


def _body(key: SideKey, name: str) -> str:
    if "[" in key.body:
        raise NotDifferentiableError(
            f"there is no derivative with respect to {name}: how copies move with a parameter is "
            "not derived; ask one body (--body)"
        )
    return key.body


def _check_together(rows: Sequence[Array], keys: Sequence[SideKey], name: str) -> None:
    """Raise NotDifferentiableError where sides that coincide part as the parameter changes."""
    for row in rows[1:]:
        if not np.allclose(row, rows[0], rtol=1e-6, atol=1e-9 * np.abs(row).max()):
            raise NotDifferentiableError(
                f"there is no derivative with respect to {name}: "
                f"{' and '.join(key.label for key in keys)} coincide, and part as it changes"
            )


class _Moving:
    """One body as a parameter changes, its moments taken about one place."""

    def __init__(self, body: Body, name: str, centre: Array) -> None:
        self._body, self._centre = body, centre
        variation = body.equation.variation(name)
        self.value = variation.value
        self._velocity = velocity(body.checked.analysis, variation)
        look = np.array([0.03, 0.21, 0.38, 0.55, 0.79, 0.96])
        speed = self._velocity.frame(*np.ix_(look, look, look))[0]
        #: of its fastest point
        self._rate = float(np.nanmax(np.abs(speed), initial=0.0))
        self.doubt = self._velocity.doubt() if self._rate else 0.0
        self._forms: dict[SideKey, Form] = {}

    def form(self, key: SideKey) -> Form | None:
        """Return V·n and its first and second moments on a side; None: the body stays."""
        if not self._rate:
            return None
        if key not in self._forms:
            self._forms[key] = Form(
                self._through(key),
                lambda reach: self._rate * np.repeat([1.0, reach, reach * reach], [1, 3, 6]),
            )
        return self._forms[key]

    def _through(self, key: SideKey) -> Callable[[Array, Array], Array]:
        places = SidePlaces(self._body.checked.analysis, self._body.patches(key))

        def columns(points: Array, normals: Array) -> Array:
            local = places(points + self._centre)
            speed = self._velocity.frame(*local.T)[0]
            second = [points[:, i] * points[:, j] for i, j in PAIRS]
            moments = np.column_stack((np.ones(len(points)), points, *second))
            return np.asarray((speed * normals).sum(axis=1)[:, None] * moments)

        return columns
