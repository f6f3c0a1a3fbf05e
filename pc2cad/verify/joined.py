"""A STEP file of several bodies held against their equations, and against how they are joined.

    faces       each lies on the side that it is named after; one that no other body has cut is all
                of it, others are what lies within edges that lie on both sides' images
    places      beside every edge of a face the solid is behind it and not before it, as the
                equations of all bodies say (`membership`): *sampled*
    the whole   of every side as much is in the file as bounds the Boolean, by places on a grid
    integrals   of the sides within the edges of the file, by Green's theorem, are the file's

A shell that is closed, and whose faces bound the Boolean at every place, is all of each piece of
its boundary that it has a part of; the third asks that none is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from pc2cad.domain.analysis import Analysis, analyse
from pc2cad.domain.cuts import halved
from pc2cad.equation.point_equation import PointEquation
from pc2cad.equation.sums import sums
from pc2cad.integrals.mass_properties import MassProperties, integrate
from pc2cad.templates.bodies import Bodies, Operation, Tree
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import Cell
from pc2cad.verify.beside import Beside
from pc2cad.verify.faces import JudgedFace
from pc2cad.verify.membership import Membership
from pc2cad.verify.nearness import Nearness
from pc2cad.verify.proofs import Proofs
from pc2cad.verify.receipt import StepFile
from pc2cad.verify.replay import StepText
from pc2cad.verify.sides import Match, Sides, compare, distances
from pc2cad.verify.trimmed import Grid, compare_part, moments_on
from pc2cad.verify.verdict import Collected, Verification, usual_tolerance

#: places of all grids together, and of one along each parameter at least and at most
_PLACES, _FEWEST, _MOST = 2500, 5, 20
#: how far into a face, of its width: less where it is narrower there, or faces meet at a small
#: angle; a step to both sides of the face is a share of that
_INWARDS, _STEP = (0.02, 0.002, 0.0002), 0.05
#: how far faces and edges are off, times this, is the least step
_CLEAR = 4.0
#: relative differences of areas, of volumes and of the equation's own that quadrature leaves open
_AREA, _VOLUME, _SAME = 1e-6, 1e-8, 1e-9
#: and of areas by places on a grid
_ROUGH = 1e-3


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A body as it stands in the result, or a copy of it."""

    name: str
    sides: Sides
    groups: dict[str, list[Cell]]
    #: the whole side that a patch is a piece of
    whole: dict[Cell, str]
    proofs: Proofs


def joined_verification(
    file: StepFile, bodies: Bodies, tolerance: float | None, *, claims: bool = False
) -> Verification:
    """Hold a file that was read against several bodies and how they are joined."""
    return _Joined(file, bodies, tolerance, claims).judged()


class _Joined(Collected):
    def __init__(
        self, file: StepFile, bodies: Bodies, tolerance: float | None, claims: bool
    ) -> None:
        self._known: dict[str, tuple[PointEquation, Analysis, MassProperties]] = {}
        for name, equation in bodies.equations.items():
            self._learn(name, equation)
        size = max(analysis.size for _, analysis, _ in self._known.values())
        super().__init__(file, bodies, size)
        own = [usual_tolerance(analysis, mass) for _, analysis, mass in self._known.values()]
        self._tolerance = max(own) if tolerance is None else tolerance
        self._bodies, self._claims = bodies, claims
        analyses = {name: analysis for name, (_, analysis, _) in self._known.items()}
        self._membership = Membership(analyses, bodies.result)
        self._least = max(self._membership.least, _CLEAR * self._tolerance)
        names = {face.face.name for solid in file.solids for face in solid.faces}
        self._parts = {part for name in names for part in name.split(" = ")}
        self._prefixes = {part.rpartition(":")[0] for part in self._parts}
        self._leaves = self._made()
        # a body may be joined with what closes cut in halves: its sides then are in pieces
        unknown = {part for part in self._parts if self._side_of(part) is None}
        if unknown:
            cut = {part.rpartition(":")[0] for part in unknown}
            whole, self._leaves = self._leaves, self._made(halves=True)
            known = {name for name in cut if all(map(self._side_of, self._of(name)))}
            self._leaves = whole | {name: self._leaves[name] for name in known & set(whole)}

    def _of(self, name: str) -> set[str]:
        """Return the names of the faces of a body or a copy."""
        return {part for part in self._parts if part.rpartition(":")[0] == name}

    def _made(self, *, halves: bool = False) -> dict[str, _Leaf]:
        """Return the bodies and copies of the result by their names."""
        text = cache(partial(StepText, self.file.data)) if self._claims else None
        sides_of: dict[str, tuple[Analysis, MassProperties]] = {}
        made = {}
        for name, base, place in self._leaves_of(self._bodies.result):
            if base not in sides_of:
                _, analysis, mass = self._known[base]
                cut = halved(analysis) if halves else analysis
                sides_of[base] = cut, mass if cut is analysis else integrate(cut)
            analysis, mass = sides_of[base]
            sides = Sides(analysis, [*mass.face_areas, *mass.interface_areas], place)
            cells = [face.patch for face in analysis.complex.faces]
            key = analysis.complex.key
            whole = {cell: key(cell).whole.label for cell in cells}
            proofs = Proofs(sides, self._tolerance, text)
            made[name] = _Leaf(name, sides, sides.groups(), whole, proofs)
        return made

    def _side_of(self, part: str) -> tuple[_Leaf, str] | None:
        """Return the body and the side of a name, None where there is none."""
        prefix, _, side = part.rpartition(":")
        leaf = self._leaves.get(prefix)
        return None if leaf is None or side not in leaf.groups else (leaf, side)

    def judged(self) -> Verification:
        """Return what became of the file."""
        self.of_itself()
        matches: list[Match] = []
        mass = MassProperties(0.0, 0.0, (0.0, 0.0, 0.0), (), 0.0, "no face")
        if self.file.solids and self.same_unit():
            named = self._named()
            matches = self._faces(named)
            self._beside_edges()
            self._coverage(named)
            mass = self._integrals(named, matches)
        return self.verdict(self._tolerance, matches, mass, self._membership.places)

    # -- bodies and copies --------------------------------------------------------------------

    def _learn(self, name: str, equation: PointEquation) -> None:
        analysis = analyse(equation)
        self._known[name] = equation, analysis, integrate(analysis)

    def _leaves_of(self, tree: Tree) -> Iterator[tuple[str, str, Placement | None]]:
        """Yield the bodies of a tree: name in the result, name of the equation, and place."""
        if isinstance(tree, str):
            # of a result that is one equation faces are named as those of one body
            yield "" if tree == self._one_of(self._bodies.result) else tree, tree, None
        elif isinstance(tree, Operation):
            one = self._one_of(tree)
            for operand in tree.operands if one is None else (one,):
                yield from self._leaves_of(operand)
        else:
            for k, copy in enumerate(tree.copies):
                for name, base, place in self._leaves_of(
                    self._one_of(tree.operand) or tree.operand
                ):
                    yield f"{name}[{k}]", base, copy if place is None else copy.after(place)

    def _one_of(self, tree: Tree) -> str | None:
        """Return the name of the equation that a difference is, as the names of faces say."""
        if isinstance(tree, str):
            return tree
        if not isinstance(tree, Operation) or tree.kind != "difference":
            return None
        name = self._one_of(tree.operands[0])
        for operand in tree.operands[1:]:
            other = self._one_of(operand)
            if name is None or other is None:
                return None
            name = self._difference(name, other)
        return name

    def _difference(self, first: str, second: str) -> str | None:
        name = f"difference({first}, {second})"
        if name not in self._known and any(not p or name in p for p in self._prefixes):
            (a, _, whole), (b, _, part) = self._known[first], self._known[second]
            for found in sums(a, b):
                if found.unmet:
                    break
                analysis = analyse(found.equation)
                mass = integrate(analysis)
                rest = whole.volume - part.volume
                if abs(mass.volume - rest) <= 1e-6 * whole.volume:
                    self._known[name] = found.equation, analysis, mass
                    break
        return name if name in self._known else None

    # -- faces --------------------------------------------------------------------------------

    def _named(self) -> list[tuple[JudgedFace, list[tuple[_Leaf, str]]]]:
        """Return every face with the bodies and sides that it is named after."""
        found = []
        for solid in self.file.solids:
            for face in solid.faces:
                own = []
                for part in face.face.name.split(" = "):
                    side = self._side_of(part)
                    if side is not None:
                        own.append(side)
                    else:
                        self.add(0.0, f"the face {face.face.label} has the name of no side")
                found.append((face, own))
        return found

    def _faces(self, named: Sequence[tuple[JudgedFace, list[tuple[_Leaf, str]]]]) -> list[Match]:
        together: dict[tuple[str, str], list[JudgedFace]] = {}
        for face, own in named:
            for leaf, side in own:
                together.setdefault((leaf.name, side), []).append(face)
        matches = []
        for face, own in named:
            for leaf, side in own:
                match = self._match(leaf, side, face, together[leaf.name, side])
                self._judge(match)
                matches.append(match)
        return matches

    def _match(
        self, leaf: _Leaf, side: str, face: JudgedFace, others: Sequence[JudgedFace]
    ) -> Match:
        name = f"{leaf.name}:{side}" if leaf.name else side
        patches, allowed = leaf.groups[side], self._tolerance
        own = sum(leaf.sides.areas[patch] for patch in patches)
        border = sum(edge.length for edge in face.face.edges.values())
        slack = _AREA * own + min(face.moments.error, 1e-4) * own + allowed * border
        if abs(face.moments.area - own) <= slack:
            whole = compare(leaf.sides, name, patches, face, allowed)
            if whole.excess == 0.0 and whole.border.distance <= allowed:
                return leaf.proofs.of(whole)
        grids = [self._grid(leaf, patch) for patch in patches]
        places = np.concatenate([grid.points[grid.kept] for grid in grids])
        if len(others) > 1 and len(places):
            off = np.array([distances(other, places) for other in others])
            mine = next(k for k, other in enumerate(others) if other is face)
            places = places[off.argmin(axis=0) == mine]
        match = leaf.proofs.of(compare_part(leaf.sides, name, patches, face, places, allowed))
        bound = face.gap_bound + match.reach
        if match.nearness.rests_on != "sampled" and bound <= self._edges_allowed:
            match = replace(match, edges=Nearness("bounded", bound))
        return match

    @property
    def _edges_allowed(self) -> float:
        """How far edges between bodies may be off their sides: what files keep, and the faces."""
        stated = max(solid.units.uncertainty or 0.0 for solid in self.file.solids)
        return self._tolerance + max(self._tolerance, min(stated, 1e-6 * self.size))

    def _judge(self, match: Match) -> None:
        units = self.equation.units
        for part, allowed in (
            (match.surface, self._tolerance),
            (match.border, self._edges_allowed if match.trimmed else self._tolerance),
        ):
            if not part.distance <= allowed:
                self.add(
                    part.distance,
                    f"{part.what} of the face {match.face.face.label} is {part.distance:.3g} "
                    f"{units} from that of the side {match.name} ({part.place})",
                )

    # -- where the bodies are -----------------------------------------------------------------

    def _beside_edges(self) -> None:
        """Ask for the solid behind every face, and for none before it, beside its edges."""
        faces = [face for solid in self.file.solids for face in solid.faces]
        wrong = [Beside.of(face) for face in faces if face.face.edges]
        many = sum(len(row.places) for row in wrong)
        for inwards in _INWARDS:
            wrong = [row for row in (row.wide(inwards, self._least) for row in wrong) if row]
            if not wrong:
                return
            table = np.concatenate([row.inside(inwards, self._least) for row in wrong])
            step = np.maximum(_STEP * table[:, 6], self._least)
            bad = self._membership.turns(table[:, :3], table[:, 3:6], step) != 1
            ends = np.cumsum([len(row.places) for row in wrong])[:-1]
            pairs = zip(wrong, np.split(bad, ends), strict=True)
            wrong = [row.part(own) for row, own in pairs if own.any()]
        if wrong:
            (x, y, z), first = table[bad][0, :3], wrong[0]
            self.add(
                self.size,
                f"the face {first.face.face.label} does not bound {self._bodies.result} at "
                f"({x:.6g}, {y:.6g}, {z:.6g}), beside its edge {first.edges[0].ref} (nor at "
                f"{int(bad.sum()) - 1} more of {many} such places)",
            )

    def _grid(self, leaf: _Leaf, patch: Cell) -> Grid:
        return self._grids[leaf.name, patch]

    @cached_property
    def _grids(self) -> dict[tuple[str, Cell], Grid]:
        every = [(leaf, patch) for leaf in self._leaves.values() for patch in leaf.whole]
        count = int(np.clip((_PLACES / max(1, len(every))) ** 0.5, _FEWEST, _MOST))
        patches = [(leaf.sides, patch) for leaf, patch in every]
        grids = Grid.of_all(patches, self._membership, count, self._least)
        return {(leaf.name, patch): g for (leaf, patch), g in zip(every, grids, strict=True)}

    def _coverage(self, named: Sequence[tuple[JudgedFace, list[tuple[_Leaf, str]]]]) -> None:
        """Hold the area of the faces of every side against what of it bounds the Boolean."""
        areas: dict[tuple[str, str], float] = {}
        for face, own in named:
            for leaf, side in own:
                key = leaf.name, leaf.whole[leaf.groups[side][0]]
                areas[key] = areas.get(key, 0.0) + face.moments.area
        for leaf in self._leaves.values():
            for side in dict.fromkeys(leaf.whole.values()):
                name = f"{leaf.name}:{side}" if leaf.name else side
                grids = [self._grid(leaf, cell) for cell, own in leaf.whole.items() if own == side]
                if (leaf.name, side) in areas:
                    self._same_area(name, grids, areas[leaf.name, side])
                    continue
                found = [grid.confirmed(self._membership, self._least) for grid in grids]
                missed = np.concatenate(found)
                if len(missed):
                    x, y, z = missed[0]
                    self.add(
                        self.size,
                        f"of the side {name} there is no face, and it bounds {self._bodies.result} "
                        f"at ({x:.6g}, {y:.6g}, {z:.6g}) (and at {len(missed) - 1} more places)",
                    )

    def _same_area(self, name: str, grids: Sequence[Grid], area: float) -> None:
        kept, every, open_, rim = np.sum(
            [
                (grid.areas[grid.kept].sum(), grid.areas.sum(), grid.areas[grid.open].sum(),
                 grid.rim)
                for grid in grids
            ],
            axis=0,
        ).tolist()  # fmt: skip
        if abs(area - every) > _ROUGH * every or kept < every - open_:
            open_ += rim
        if abs(area - kept) > open_ + _ROUGH * every:
            units = self.equation.units
            self.add(
                self.size,
                f"of the side {name} {kept:.4g} {units}^2 bound {self._bodies.result} "
                f"(± {open_:.1g}, on a grid), its faces have {area:.4g}",
            )

    # -- integrals ----------------------------------------------------------------------------

    def _integrals(
        self, named: Sequence[tuple[JudgedFace, list[tuple[_Leaf, str]]]], matches: Sequence[Match]
    ) -> MassProperties:
        """Return integrals over the sides within the edges of the file, held against the file's."""
        first: dict[int, Match] = {}
        for match in matches:
            first.setdefault(id(match.face), match)
        leaves = {id(face): own[0][0] for face, own in named if own}
        totals, slack, error = np.zeros(5), 0.0, 0.0
        for solid in self.file.solids:
            signs = {id(f): s.sign for s in solid.shells for f in s.faces}
            for face in solid.faces:
                own, held = face.moments, first.get(id(face))
                if held is not None and held.distance < np.inf:
                    other = moments_on(held, leaves[id(face)].sides, solid.origin)
                    own = own if other is None else other
                sign = signs[id(face.face)]
                totals += [own.area, sign * own.volume, *(sign * own.moment)]
                slack += own.area * self._tolerance
                error = max(error, own.error)
        area, volume, *moment = totals.tolist()
        origin = self.file.solids[0].origin
        centre = origin + np.array(moment) / volume if volume else origin
        source = "sides of the bodies within the edges of the file (Green's theorem)"
        x, y, z = centre.tolist()
        mass = MassProperties(volume, area, (x, y, z), (), error, source)
        if not self._found:
            slack += (_VOLUME + min(error, 1e-6)) * abs(volume)
            self.integrals(mass, 1, slack, _SAME)
        return mass
