"""Several bodies to one solid: each compiled from its equation, then joined by the kernel.

    Bodies  ─compile→  a Body per equation
            ─combine→  Booleans step by step, each held against the volumes of its operands
            ─report→   faces by body and side, edges where bodies meet, which volumes add up

Differences that are one equation (M1 + M2 - K) have become that before (`csg.arithmetic`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pc2cad.brep.booleans import (
    Kind,
    NamedEdge,
    NamedShape,
    combine,
    edges_between,
    fuse,
    label,
    moved,
    original,
    unplaced,
)
from pc2cad.brep.inspect import KernelFindings, inspect
from pc2cad.brep.integrals import KnownFaces, SolidIntegrals, solid_integrals
from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.csg.arithmetic import Reduced
from pc2cad.csg.completeness import completeness
from pc2cad.csg.contacts import check_contacts, check_merged
from pc2cad.csg.intersection_edges import (
    Side,
    edge_warnings,
    prove_intersection_edges,
    sides_of,
)
from pc2cad.csg.own_edges import distances_between, farthest_place, with_own_edges
from pc2cad.csg.refusals import check_apart, off_its_faces, placed
from pc2cad.csg.regions import Told
from pc2cad.csg.volumes import EMPTY, Relation, relation, sentence
from pc2cad.csg.weights import Joined
from pc2cad.errors import KernelError, NotASolidError
from pc2cad.export.colours import body_colour
from pc2cad.export.model import ExportOptions, NamedFace
from pc2cad.export.step import encode
from pc2cad.part import Body, Part
from pc2cad.report import EdgeReport, FaceReport, Integrals, Report, StepReport
from pc2cad.templates.bodies import Bodies, Pattern, Tree
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Shape, TopoDS_Solid

#: share of the kernel's tolerance, or of the part's, by which an edge may be off its faces, and of
#: the size, below which none can be had
NEAR, ROUNDING = 0.1, 1e-13
#: share of volumes that they may differ by, and be equal
ADD_UP = 1e-11
#: share of a part's size that a tolerance of the kernel's may be
LOOSEST = 0.01


class EmptyResultError(NotASolidError):
    """Nothing is left of the bodies."""


class SeveralPiecesError(NotASolidError):
    """The result is more than one solid."""


class KernelTooLooseError(KernelError):
    """The kernel takes places for one that are far apart."""


class InvalidResultError(NotASolidError):
    """The kernel's checker finds fault with the result."""


class VolumesDisagreeError(KernelError):
    """The volumes of two bodies, of their Boolean and of their common part do not add up."""


def join_bodies(
    bodies: Bodies, made: Reduced, tell: Callable[[str], None]
) -> tuple[Part, dict[str, float]]:
    """Return the result of bodies that are compiled, and the seconds that it took.

    Raises EmptyResultError, SeveralPiecesError, KernelError and what else a report may.
    """
    times = {}
    tell("combine")
    start = time.perf_counter()
    parts = made.parts
    joining = _Joining(made)
    with placed(lambda: joining.last, InvalidResultError, bodies.units):
        joined = joining.join(made.result)
        times["combine"] = time.perf_counter() - start
        tell("validate")
        start = time.perf_counter()
        edges = tuple(edges_between(joined.shape))
        report = _report(bodies, joining, joined, edges)
        order = list(parts)
        faces = tuple(
            NamedFace(label(names), face, body_colour(order.index(original(names[0].body))),
                      label(tuple(name.whole for name in names)))
            for face, names in joined.shape.faces
        )  # fmt: skip
        told = Told(report.name, report.units, report.solid.volume, joining.one)
        part = Part(
            parts, joined.shape.solids[0], faces, report, edges, bodies.about,
            Joined(made.result, parts, told, joined.shape, report, bodies.placed_at),
        )  # fmt: skip
        encode(part.exportable(), ExportOptions())  # it has to read back as it is
    times["validate"] = time.perf_counter() - start
    return part, times


@dataclass(frozen=True, eq=False)
class _Joined:
    """A shape on the way to the result, how it is written, and its integrals."""

    name: str
    shape: NamedShape
    integrals: SolidIntegrals


class _Joining:
    """Carries out Booleans one by one, and remembers which volumes add up."""

    def __init__(self, made: Reduced) -> None:
        self.parts = parts = made.parts
        self.steps: list[StepReport] = list(made.steps)
        self._reasons = made.reasons
        #: steps that change nothing
        self.idle: list[str] = []
        #: what the last Boolean made
        self.last: NamedShape | None = None
        #: faces that a Boolean leaves as they are, integrated once
        self._known = KnownFaces()
        #: where copies of bodies lie, by their names
        self.placed: dict[str, Placement] = {}
        tolerances = [part.report.tolerance for part in parts.values()]
        self._reach = max(KERNEL_TOLERANCE, *tolerances)
        self._size = max(part.report.size for part in parts.values())
        self._units = next(iter(parts.values())).report.units
        #: how near edges between bodies come to their faces
        self._near = max(NEAR * min(KERNEL_TOLERANCE, *tolerances), ROUNDING * self._size)
        #: what two faces or edges of bodies may be apart, whose equations have them in one place
        self.one = 2 * max(known_within(part) for part in parts.values())

    def join(self, tree: Tree) -> _Joined:
        """Return a body or a Boolean, with all that it is made of."""
        if isinstance(tree, str):
            part = self.parts[tree]
            faces = tuple(
                (face, (replace(key, body=tree),)) for key, face in part.kernel_sides.items()
            )
            return _Joined(tree, NamedShape(part.shape, faces), self._integrals(part.shape))
        if isinstance(tree, Pattern):
            return self._pattern(tree)
        kind: Kind = "cut" if tree.kind == "difference" else tree.kind
        first, *others = (self.join(operand) for operand in tree.operands)
        for other in others:
            first = self._step(kind, first, other, self._reasons.get(str(tree), ""))
        return first

    def _pattern(self, tree: Pattern) -> _Joined:
        """Return copies of a body, joined in one operation where they have nothing in common."""
        one = self.join(tree.operand)
        inner = {name.body for _, names in one.shape.faces for name in names}
        copies = []
        for k, place in enumerate(tree.copies):
            for body in inner:
                known = self.placed.get(body)
                self.placed[f"{body}[{k}]"] = place.after(known) if known else place
            copies.append(moved(one.shape, place.turn, place.offset, f"[{k}]"))
        name, count, each = str(tree), len(copies), one.integrals.volume
        shape, found, gap = self._fused(copies, one.integrals)
        common = count * each - found.volume
        apart = (
            f"{count} copies with nothing in common: {count} x {each:.10g} = {found.volume:.10g}"
        )
        across = f"{count} copies of {each:.10g} that overlap: {found.volume:.10g}"
        slack = self._slack(count * each, count * one.integrals.area)
        deviations = {key: side.deviation for key, side in _sides(self).items()}
        self.steps.append(
            StepReport(
                name, "union", each, (count - 1) * each, common, found.volume, gap,
                apart if abs(common) <= slack else across,
                completeness(copies, shape, deviations, (name, self._size, self._units)),
            )
        )  # fmt: skip
        return _Joined(f"step {len(self.steps)}", shape, found)

    def _fused(
        self, copies: Sequence[NamedShape], each: SolidIntegrals
    ) -> tuple[NamedShape, SolidIntegrals, float]:
        """Return the union of copies, its integrals, and what is missing in the sum of volumes.

        Where copies overlap, the union of every other one and that of the rest are held against
        what these have in common.
        """
        if len(copies) == 1:
            return copies[0], each, 0.0
        self.last = shape = fuse(copies, self.one)
        found = self._integrals(shape.shape)
        total, area = len(copies) * each.volume, len(copies) * each.area
        gap = total - found.volume
        if abs(gap) > self._slack(total, area):
            halves = [self._fused(copies[k::2], each) for k in (0, 1)]
            (common,) = combine(["intersect"], halves[0][0], halves[1][0], self.one)
            held = self._integrals(common.shape).volume
            gap = sum(half[1].volume for half in halves) - held - found.volume
            if abs(gap) > self._slack(total, area):
                raise VolumesDisagreeError(
                    f"{len(copies)} copies: the kernel's union has the volume "
                    f"{found.volume:.12g}, which does not add up with those of its halves"
                )
        return shape, found, gap

    def _integrals(self, shape: TopoDS_Shape) -> SolidIntegrals:
        return solid_integrals(shape, self._known)

    def _slack(self, volume: float, area: float) -> float:
        """Return what volumes may differ by that are equal but for the kernel's tolerance."""
        return 2 * self._reach * area + ADD_UP * volume

    def _step(self, kind: Kind, first: _Joined, second: _Joined, reason: str) -> _Joined:
        """Carry out one Boolean, and a second one that its volume is held against."""
        name = f"{kind}({first.name}, {second.name})"
        held_against: Kind = "cut" if kind == "intersect" else "intersect"
        result, other = combine([kind, held_against], first.shape, second.shape, self.one)
        self.last = result
        found, held = self._integrals(result.shape), self._integrals(other.shape).volume
        a, b = first.integrals.volume, second.integrals.volume
        gap = a - held - found.volume + (b if kind == "union" else 0.0)
        area = first.integrals.area + second.integrals.area
        slack = self._slack(a + b, area)
        if not abs(gap) <= slack:
            raise VolumesDisagreeError(
                f"{name}: the kernel's result has the volume {found.volume:.12g}, which does not "
                f"add up with those of its operands, {a:.12g} and {b:.12g}, and of the other "
                f"Boolean of them, {held:.12g}"
            )
        shapes, about = (first.shape, second.shape), (name, self._size, self._units)
        known = {key: side.deviation for key, side in _sides(self).items()}
        if abs(gap) > ADD_UP * (a + b):
            check_merged(shapes, self.one, known, about)
        shared = result if kind == "intersect" else other
        if not shared.solids:
            check_apart(name, *shapes, 10 * self._reach)
        if not result.solids:
            raise EmptyResultError(f"{name} is empty: {EMPTY[kind]}")
        if kind == "cut" and not other.solids and abs(gap) <= ADD_UP * (a + b):
            result = first.shape  # the kernel may have left a mark where they touch
        else:
            result = with_own_edges(result, self._near)
        topology = completeness(shapes, result, known, about)
        found = self._integrals(result.shape)
        common = found.volume if kind == "intersect" else held
        lie = relation(a, b, common, abs(gap) + ADD_UP * (a + b))
        if kind == "cut" and lie is Relation.APART:
            self.idle.append(name)
        words = sentence(kind, lie, a, b, common, found.volume)
        words += f" (by the kernel, not one equation: {reason})" if reason else ""
        self.steps.append(StepReport(name, kind, a, b, common, found.volume, gap, words, topology))
        return _Joined(f"step {len(self.steps)}", result, found)


def known_within(part: Body) -> float:
    """Return how far a body's faces and edges are from its equation's at most."""
    model = part.model
    faces = max(face.deviation for face in model.faces)
    return max([faces, *(edge.deviation for edge in model.edges)])


def _report(
    bodies: Bodies, joining: _Joining, joined: _Joined, edges: tuple[NamedEdge, ...]
) -> Report:
    shape, found = joined.shape, joined.integrals
    reports = {name: part.report for name, part in joining.parts.items()}
    size = max(report.size for report in reports.values())
    sides = _sides(joining)
    known = {key: side.deviation for key, side in sides.items()}
    about = (str(bodies.result), size, bodies.units)
    solids = shape.solids
    if len(solids) != 1:
        check_contacts(shape, edges, known, about)
        raise _falls_apart(bodies, solids)
    tolerance = max(report.tolerance for report in reports.values())
    loosest = max(tolerance, KERNEL_TOLERANCE)
    for edge, off, place in distances_between(shape):  # proofs of what is far off take long
        if off > loosest:
            raise off_its_faces(edge, off, place, bodies.units, tolerance)
    meeting = [e for e in edges if _bodies(e.names[0]).isdisjoint(_bodies(e.names[1]))]
    curves = tuple(prove_intersection_edges(shape, meeting, sides, size))
    for edge, curve in zip(meeting, curves, strict=True):
        if curve.surface_distance > loosest:
            place = farthest_place(shape, edge)
            raise off_its_faces(edge, curve.surface_distance, place, bodies.units, tolerance)
    check_contacts(shape, edges, known, about)
    for edge, curve in zip(meeting, curves, strict=True):
        edge.loosen(curve.surface_distance)  # the kernel has to know how far its edges are off
    findings = inspect(solids[0])
    _check(findings, size, bodies.units)
    faces = _faces(shape, found, joining.parts)
    # faces are off their equations, edges off their faces, and volumes do not quite add up
    off = sum(face.area * face.deviation for face in faces) + _strips(meeting, curves, size)
    error = (off + sum(abs(step.gap) for step in joining.steps)) / found.volume
    return Report(
        bodies.name, bodies.title, bodies.units, dict(bodies.parameters), size, tolerance,
        faces, curves, len(edges),
        len({v for edge in edges for v in edge.ends}), findings.shells, findings.euler,
        Integrals("B-rep (divergence theorem)", found.volume, found.area, found.centroid, error),
        kernel_tolerance=findings.largest_tolerance,
        result=str(bodies.result), bodies=reports, steps=tuple(joining.steps),
        warnings=tuple(_warnings(reports, joining.idle, curves, loosest)),
    )  # fmt: skip


def _strips(edges: Sequence[NamedEdge], curves: Sequence[EdgeReport], size: float) -> float:
    """Return what edges off their faces cost: strips, half the size away from the middle."""
    pairs = zip(edges, curves, strict=True)
    return sum(edge.length * curve.surface_distance for edge, curve in pairs) * size / 6


def _falls_apart(bodies: Bodies, solids: Sequence[TopoDS_Solid]) -> SeveralPiecesError:
    volumes = ", ".join(f"{solid_integrals(solid).volume:.6g}" for solid in solids)
    return SeveralPiecesError(
        f"{bodies.result} falls into {len(solids)} pieces of the volumes {volumes}; a template "
        "makes one solid: join them, or write a template for each"
    )


def _sides(joining: _Joining) -> dict[SideKey, Side]:
    """Return the sides of all bodies and of their copies by the keys of their faces."""
    sides: dict[SideKey, Side] = {}
    for name, part in joining.parts.items():
        sides |= sides_of(name, part.model)
    own = tuple(sides.items())
    for name, place in joining.placed.items():
        sides |= {
            replace(key, body=name): replace(side, placed=(place.turn, place.offset))
            for key, side in own
            if key.body == original(name)
        }
    return sides


def _warnings(
    reports: Mapping[str, Report],
    idle: Sequence[str],
    curves: Sequence[EdgeReport],
    loosest: float,
) -> Iterator[str]:
    for name, report in reports.items():
        yield from (f"body {name}: {text}" for text in report.warnings)
    for name in idle:
        yield f"{name} changes nothing: the bodies have nothing in common"
    yield from edge_warnings(curves, loosest)


def _check(findings: KernelFindings, size: float, units: str) -> None:
    if findings.largest_tolerance > LOOSEST * size:
        raise KernelTooLooseError(
            f"the CAD kernel joined the bodies within {findings.largest_tolerance:.2g} {units} "
            f"only, of a part of {size:.2g}: it has lost where they meet"
        )
    if not findings.valid or findings.free_edges:
        what = (
            f"{findings.free_edges} of its edges do not bound exactly two faces: the bodies touch "
            "along an edge"
            if findings.free_edges else "the kernel's checker finds it invalid"
        )  # fmt: skip
        raise InvalidResultError(f"the result is no valid solid: {what}")


def _bodies(names: tuple[SideKey, ...]) -> set[str]:
    return {name.body for name in names}


def _faces(
    shape: NamedShape, found: SolidIntegrals, parts: Mapping[str, Body]
) -> tuple[FaceReport, ...]:
    """Return each face of the result as its body's face is known, with its own area."""
    known = {
        replace(face.key, body=name): known
        for name, body in parts.items()
        for face, known in zip(body.model.faces, body.report.faces, strict=True)
    }
    return tuple(
        replace(known[unplaced(names[0])], name=label(names), area=area)
        for (_, names), area in zip(shape.faces, found.face_areas, strict=True)
    )
