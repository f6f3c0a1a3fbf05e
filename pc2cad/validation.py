"""The validate stage: the kernel's solid is held against the equation, or refused.

Input: everything before. Output: Report. The kernel's checker alone passes inside-out, folded and
badly closed solids, so its verdict is one of several: edge uses, counts and Euler number of the
derived complex, tolerances, and volume, area and centroid of what was built against the same
integrals taken from the equation.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from pc2cad.brep.build import BuiltSolid
from pc2cad.brep.checker import is_valid
from pc2cad.brep.inspect import KernelFindings, crossing_wires, inspect
from pc2cad.brep.integrals import KnownFaces, SolidIntegrals, solid_integrals
from pc2cad.brep.plane_solids import plane_solid
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.checked import CheckedMap
from pc2cad.domain.pinch import pinch_of
from pc2cad.equation.point_equation import Expectations
from pc2cad.errors import KernelError, NotASolidError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.geometry.carriers import (
    SplineCurve,
    SplineSurface,
    curve_kind,
    figures,
    surface_kind,
)
from pc2cad.geometry.scale import Scale
from pc2cad.integrals.mass_properties import MassProperties
from pc2cad.report import (
    EdgeReport,
    EquationReport,
    FaceReport,
    Integrals,
    LayerReport,
    LimitReport,
    Report,
    SideReport,
)
from pc2cad.representation.boundary_model import BoundaryModel, ModelFace
from pc2cad.representation.embedding import not_proved
from pc2cad.solidity.embedding.proof import TOUCHING
from pc2cad.solidity.embedding.verdict import Embedding
from pc2cad.topology.cells import IDENTITY, Cell, directions_of
from pc2cad.topology.complex import BoundaryComplex, SideFate


class SolidNotValidError(KernelError):
    """The kernel's solid fails one of the checks."""


class WallsTakenForOneError(SolidNotValidError):
    """The kernel's checker takes walls for one that are proved to meet nowhere."""

    def __init__(self, message: str, cells: tuple[int, ...]) -> None:
        super().__init__(message)
        #: the cells of the boundary that a face between such walls covers
        self.cells = cells


class ThinnerThanKernelError(KernelError):
    """The solid is thinner than the distance within which the kernel takes points for one."""


class IntegralsDisagreeError(NotASolidError):
    """The solid that was built does not have the volume, area or centroid of the equation."""


class ExpectationNotMetError(NotASolidError):
    """A figure that the template states is not the solid's."""


def validate(
    checked: CheckedMap, model: BoundaryModel, built: BuiltSolid, embedding: Embedding
) -> Report:
    """Return the report of a solid that passes every check; raise for one that does not."""
    plain = plane_solid(built.solid)
    findings = inspect(built.solid, plain)
    try:
        _check_kernel(findings, model)
    except SolidNotValidError as error:
        pinch = pinch_of(checked.analysis)
        if pinch is not None:
            raise pinch from error
        if embedding.proved and not findings.valid:
            _check_walls(model, built)
        raise SolidNotValidError(f"{error}{_complaint(model, built)}") from error
    known = KnownFaces() if model.layers else None
    integrals = solid_integrals(built.solid, known, plain)
    _check_integrals(integrals, checked.mass, model)
    layers = _layers(checked.mass, model, built, known)
    report = _report(checked, model, integrals, findings, layers, embedding)
    check_expectations(checked.equation.expectations, report)
    return report


def _complaint(model: BoundaryModel, built: BuiltSolid) -> str:
    """Say which faces the kernel's checker finds invalid by themselves, or nothing."""
    pairs = zip(model.faces, built.faces, strict=True)
    names = [face.name for face, made in pairs if not is_valid(made)]
    if not names:
        return ""
    return (
        f": so are, by themselves, its faces {', '.join(names)}; edges that come within "
        f"{KERNEL_TOLERANCE:g} of one another, as in a cusp, it takes for one: an angle there, or "
        "a larger part, may help"
    )


def _check_walls(model: BoundaryModel, built: BuiltSolid) -> None:
    """Raise WallsTakenForOneError where the checker complains of wires that cross, and of no more.

    That the faces meet nowhere is proved.
    """
    crossing = crossing_wires(built.solid)
    pairs = zip(model.faces, built.faces, strict=True)
    taken = [face for face, made in pairs if any(map(made.IsSame, crossing))]
    if taken:
        names = ", ".join(face.name for face in taken)
        raise WallsTakenForOneError(
            f"the kernel's checker takes walls that bound {names} for one, though they are proved "
            "to meet nowhere", taken[0].cells,
        )  # fmt: skip


def check_thickness(properties: MassProperties) -> None:
    """Raise ThinnerThanKernelError for a solid that the kernel takes for a sheet."""
    if properties.thickness < 10 * KERNEL_TOLERANCE:
        raise ThinnerThanKernelError(
            f"the solid is only {properties.thickness:.3g} units thick on average, and the kernel "
            f"takes points within {KERNEL_TOLERANCE:g} for one; choose a smaller unit (mm instead "
            "of m), so that numbers grow, or a thicker solid"
        )


def _layers(
    properties: MassProperties, model: BoundaryModel, built: BuiltSolid, known: KnownFaces | None
) -> tuple[LayerReport, ...]:
    """Return the report of each layer; raise where its solid is not valid or not the equation's."""
    result = []
    areas = [sum(_areas(properties)[cell] for cell in face.cells) for face in model.faces]
    for layer, solid, (volume, centroid) in zip(
        model.layers, built.layers, properties.layers, strict=True
    ):
        name, findings = f"the layer {layer.name}", inspect(solid)
        _check_findings(findings, (len(layer.shells), len(layer.faces), layer.euler), model, name)
        area = sum(areas[i] for i in layer.faces)
        own = replace(properties, volume=volume, area=area, centroid=centroid)
        found = solid_integrals(solid, known)
        _check_integrals(found, own, model)
        result.append(LayerReport(layer.name, volume, found.volume, centroid, area))
    return tuple(result)


def _areas(properties: MassProperties) -> tuple[float, ...]:
    return properties.face_areas + properties.interface_areas


def _check_kernel(findings: KernelFindings, model: BoundaryModel) -> None:
    expected = (len(model.complex.shells), len(model.outer), model.complex.euler)
    _check_findings(findings, expected, model, "the kernel's solid")


def _check_findings(
    findings: KernelFindings, expected: tuple[int, int, int], model: BoundaryModel, name: str
) -> None:
    if not findings.valid:
        raise SolidNotValidError(f"the kernel's checker finds {name} invalid")
    if findings.free_edges:
        raise SolidNotValidError(
            f"{findings.free_edges} edges of {name} do not bound exactly two faces: the boundary "
            "is open"
        )
    found = (findings.shells, findings.faces, findings.euler)
    if found != expected:
        raise SolidNotValidError(
            f"{name} has (shells, faces, Euler number) = {found} where the equation has {expected}"
        )
    allowed = max(KERNEL_TOLERANCE, model.tolerance)
    if findings.largest_tolerance > allowed * (1 + 1e-9):
        raise SolidNotValidError(
            f"the kernel raised a tolerance to {findings.largest_tolerance:.3g}, above "
            f"{allowed:.3g}"
        )


def _check_integrals(solid: SolidIntegrals, true: MassProperties, model: BoundaryModel) -> None:
    # coordinates far from the origin are rounded, and the kernel holds no more than that
    place = Scale(model.size, float(np.abs(model.vertices).max()))
    deviation = max(face.deviation for face in model.faces) + place.kernel_noise
    slack = 1e-11 + 10 * true.relative_error
    volume_gap = abs(solid.volume - true.volume)
    if not volume_gap <= 2 * true.area * deviation + slack * (true.volume + true.area * model.size):
        raise IntegralsDisagreeError(
            f"the solid's volume is {solid.volume:.12g} and the equation's {true.volume:.12g}: "
            "the map folds or overlaps itself, or a face is wrong"
        )
    area_gap = abs(solid.area - true.area)
    # area follows with distance times curvature, and no curvature says more than the thickness
    if not area_gap <= (20 * deviation / true.thickness + 10 * slack) * true.area:
        raise IntegralsDisagreeError(
            f"the solid's area is {solid.area:.12g} and the equation's {true.area:.12g}"
        )
    shift = float(np.linalg.norm(np.subtract(solid.centroid, true.centroid)))
    if (
        not shift * true.volume
        <= (4 * true.area * deviation + 10 * slack * true.volume) * model.size
    ):
        raise IntegralsDisagreeError(
            f"the solid's centroid is {shift:.3g} away from the equation's"
        )


#: what a template calls the carriers whose names are not one plain word
_CARRIER_KEYS = {
    "Bézier surface": "bezier",
    "B-spline surface": "spline",
    "rational Bézier surface": "rational",
    "rational B-spline surface": "rational",
}


def check_expectations(expected: Expectations, report: Report) -> None:
    """Raise ExpectationNotMetError for the first figure of a template that is not met."""
    counts = {
        "faces": len(report.faces), "edges": report.edges, "vertices": report.vertices,
        "shells": report.shells, "euler": report.euler,
    }  # fmt: skip
    for name, found in counts.items():
        stated = getattr(expected, name)
        if stated is not None and stated != found:
            raise ExpectationNotMetError(f"[expect] {name} = {stated}, but there are {found}")
    found_carriers = Counter(_CARRIER_KEYS.get(f.carrier, f.carrier) for f in report.faces)
    if expected.carriers is not None and dict(expected.carriers) != found_carriers:
        stated, there = (
            ", ".join(f"{kind} = {count}" for kind, count in counts.items())
            for counts in (expected.carriers, found_carriers)
        )
        raise ExpectationNotMetError(f"[expect] carriers: {stated}; but there are {there}")
    slack = 1e-9 + 10 * (report.integrals.relative_error or 0.0)
    for name in ("volume", "area"):
        stated, value = getattr(expected, name), getattr(report.integrals, name)
        if stated is not None and not abs(stated - value) <= slack * abs(value):
            raise ExpectationNotMetError(f"[expect] {name} = {stated:.12g}, but it is {value:.12g}")
    if expected.centroid is not None:
        gap = np.linalg.norm(np.subtract(expected.centroid, report.integrals.centroid))
        if not gap <= slack * report.size:
            shown = ", ".join(f"{x:.12g}" for x in report.integrals.centroid)
            raise ExpectationNotMetError(f"[expect] the centroid is {gap:.3g} away from ({shown})")


def _report(
    checked: CheckedMap,
    model: BoundaryModel,
    integrals: SolidIntegrals,
    findings: KernelFindings,
    layers: tuple[LayerReport, ...],
    embedding: Embedding,
) -> Report:
    equation, properties = checked.equation, checked.mass
    # what samples could not tell apart is told by the proof
    overlap = "" if embedding.proved else checked.solidity.warning
    areas = _areas(properties)
    return Report(
        name=equation.name,
        title=equation.title,
        units=equation.units,
        parameters=dict(equation.parameters),
        size=model.size,
        tolerance=model.tolerance,
        faces=tuple(
            _face(model, face, sum([areas[cell] for cell in face.cells])) for face in model.faces
        ),
        curves=tuple(_edge(model, index) for index in sorted(model.creases)),
        edges=len(model.creases),
        vertices=len(model.crease_vertices()),
        shells=len(model.shells),
        euler=model.complex.euler,
        solid=Integrals("B-rep (divergence theorem)", integrals.volume, integrals.area,
                        integrals.centroid),
        kernel_tolerance=findings.largest_tolerance,
        own=_own(checked, model, layers, embedding),
        warnings=tuple(warning for warning in (checked.orientation.warning, overlap) if warning),
    )  # fmt: skip


def _own(
    checked: CheckedMap,
    model: BoundaryModel,
    layers: tuple[LayerReport, ...],
    embedding: Embedding,
) -> EquationReport:
    """Return what is known from the equation itself."""
    boundary, properties = model.complex, checked.mass
    open_ = "; ".join(not_proved(checked, model, embedding))
    seen = checked.solidity if open_ or not checked.question.can_wait else None
    return EquationReport(
        sides=tuple(_side(side, boundary) for side in boundary.sides),
        genus=tuple(
            shell.genus
            for members in model.shells
            for shell in boundary.shells
            if model.faces[members[0]].cells[0] in shell.faces
        ),
        frame=checked.equation.frame,
        determinant=checked.orientation.verdict.value,
        images=0 if seen is None else seen.images,
        contact_clearance=(
            TOUCHING * model.size if embedding.proved else checked.solidity.apart
        ),
        injectivity="sampled" if open_ else "proved",
        overlap_depth=(
            checked.solidity.apart
            if open_
            else max(embedding.depth, *(face.deviation for face in model.faces))
        ),
        overlap_cells=embedding.cells,
        overlap_open=open_,
        integrals=Integrals(
            properties.source, properties.volume, properties.area,
            properties.centroid, properties.relative_error,
        ),
        layers=layers,
        limits=lambda: tuple(
            LimitReport(limit.name, limit.value, limit.breaks_at, limit.sentence)
            for limit in checked.limits
        ),
    )  # fmt: skip


def _side(side: SideFate, boundary: BoundaryComplex) -> SideReport:
    detail = ""
    if side.along is not None:
        detail = f"along {PARAMETERS[side.along]}"
    if side.partner is not None:
        detail = f"glued to {boundary.name(side.partner)}"
        if side.symmetry is not None and side.symmetry != IDENTITY:
            detail += f", (s, t) to {side.symmetry}"
    return SideReport(boundary.name(side.patch), side.fate, side.verdict.value, detail)


def _face(model: BoundaryModel, face: ModelFace, area: float) -> FaceReport:
    spline = face.carrier if isinstance(face.carrier, SplineSurface) else None
    return FaceReport(
        face.name, surface_kind(face.carrier), face.evidence, face.deviation, face.sampled,
        face.samples, _ranges(face.open, model.complex.faces[face.cells[0]].patch),
        spline.degrees if spline else (), spline.poles.shape[:2] if spline else (), area,
        figures(face.carrier),
    )  # fmt: skip


def _edge(model: BoundaryModel, index: int) -> EdgeReport:
    edge, cell = model.edges[index], model.complex.edges[index].cell
    spline = edge.carrier if isinstance(edge.carrier, SplineCurve) else None
    return EdgeReport(
        edge.name, curve_kind(edge.carrier), edge.evidence, edge.deviation,
        edge.sampled, _ranges(edge.open, cell), spline.degree if spline else 0,
        len(spline.poles) if spline else 0,
    )  # fmt: skip


def _ranges(ranges: tuple[tuple[float, float], ...], cell: Cell) -> str:
    """Return ranges of a cell's own parameters in words."""
    names = [PARAMETERS[d] for d in directions_of(cell)]
    shown = [f"{n} {a:.4g} to {b:.4g}" for n, (a, b) in zip(names, ranges, strict=False)]
    return ", ".join(shown)
