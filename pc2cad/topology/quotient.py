"""Deriving the boundary complex: glue what coincides, drop what collapses, keep what bounds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from itertools import combinations

from pc2cad.errors import NotASolidError
from pc2cad.expression.identity import Verdict
from pc2cad.topology.cells import (
    IDENTITY,
    SYMMETRIES,
    Cell,
    Labels,
    boundary_patches,
    cell_name,
    directions_of,
    edge_ends,
    inner_patches,
    outward_sign,
    patch_edges,
)
from pc2cad.topology.complex import (
    BoundaryComplex,
    EdgeClass,
    EdgeMember,
    EdgeUse,
    FaceCell,
    Shell,
    SideFate,
    VertexClass,
)
from pc2cad.topology.questions import Questions


class NoBoundaryFaceError(NotASolidError):
    """Every side of the box collapses or lies inside: nothing bounds the image."""


class SidesFoldedTogetherError(NotASolidError):
    """Two sides coincide, but lie on the same side of the material."""


class EdgeNotUsedTwiceError(NotASolidError):
    """An edge of the boundary does not join exactly two face sides."""


def derive_boundary(questions: Questions, labels: Labels) -> BoundaryComplex:
    """Return the boundary complex of the map that answers the questions.

    ``labels[d]`` names the limits and creases of direction d; one more than it has pieces.
    Raises NotASolidError (a subclass that names the violated invariant) where the image has no
    closed boundary.
    """
    pieces = tuple(len(names) - 1 for names in labels)
    patches = boundary_patches((pieces[0], pieces[1], pieces[2]))
    vertices = _Vertices(questions)
    sides = _fates(patches, questions, labels, vertices)
    kept = [side.patch for side in sides if side.fate == "face"]
    if not kept:
        raise NoBoundaryFaceError(
            "every side of the parameter box collapses or lies inside: the image is flat and "
            "nothing bounds a solid; check that u, v and w all move the point (in a truncated "
            "body: that something is left between its ends)"
        )
    complex_ = _complex(kept, sides, questions, labels, vertices)
    _check_manifold(complex_)
    return replace(complex_, shells=_shells(complex_, range(len(kept))))


def derive_layers(outer: BoundaryComplex, questions: Questions) -> BoundaryComplex:
    """Return a boundary complex with the faces between the pieces of w, each piece a layer."""
    pieces = tuple(len(names) - 1 for names in outer.labels)
    inner = inner_patches((pieces[0], pieces[1], pieces[2]))
    patches = [*(face.patch for face in outer.faces), *inner]
    complex_ = _complex(patches, outer.sides, questions, outer.labels, _Vertices(questions))
    layers = []
    for k in range(pieces[2]):
        members = {i for i, p in enumerate(patches) if abs(p[2] - (2 * k + 1)) <= 1}
        _check_layer(complex_, members, k)
        layers.append(_shells(complex_, members))
    outside = _shells(complex_, range(len(outer.faces)))
    return replace(complex_, shells=outside, layers=tuple(layers))


def _complex(
    patches: list[Cell],
    sides: tuple[SideFate, ...],
    questions: Questions,
    labels: Labels,
    known: _Vertices,
) -> BoundaryComplex:
    """Return faces, edges and vertices of the patches, without shells."""
    edge_cells = sorted({edge.cell for patch in patches for edge in patch_edges(patch)})
    corners = sorted({corner for edge in edge_cells for corner in edge_ends(edge)})
    vertices, vertex_of = known.of(corners)
    edges, edge_of = _edges(edge_cells, vertex_of, questions)
    faces = tuple(FaceCell(patch, _uses(patch, edge_of, vertex_of)) for patch in patches)
    return BoundaryComplex(labels, sides, vertices, edges, faces, ())


def _fates(
    patches: tuple[Cell, ...], questions: Questions, labels: Labels, known: _Vertices
) -> tuple[SideFate, ...]:
    fates = {patch: _collapse(patch, questions) for patch in patches}
    candidates = [patch for patch, fate in fates.items() if fate is None]
    places = _corner_classes(candidates, known)
    for patch in candidates:
        folded = _partner(patch, patch, places, questions, labels)
        if folded:
            fates[patch] = folded
    for first, second in _with_equal(candidates, places):
        glued = _partner(first, second, places, questions, labels)
        if glued is None:
            continue
        if fates[first] or fates[second]:
            raise SidesFoldedTogetherError(
                f"the sides {cell_name(first, labels)} and {cell_name(second, labels)} coincide "
                "and one of them is glued to another side already; shorten the domain"
            )
        fates[first] = glued
        # no other symmetry does: neither side is one with itself
        assert glued.symmetry is not None
        inverse = glued.symmetry.inverse
        fates[second] = replace(glued, patch=second, partner=first, symmetry=inverse)
    return tuple(fates[p] or SideFate(p, "face", Verdict.PROVED) for p in patches)


def _with_equal(
    patches: list[Cell], places: dict[Cell, tuple[int, ...]]
) -> Iterator[tuple[Cell, Cell]]:
    """Yield the pairs with the same corners, in order: sides that coincide are among them."""
    rows: dict[tuple[int, ...], list[Cell]] = defaultdict(list)
    keys = {patch: tuple(sorted(places[patch])) for patch in patches}
    for patch in patches:
        rows[keys[patch]].append(patch)
    for patch in patches:
        row = rows[keys[patch]]
        yield from ((patch, other) for other in row[row.index(patch) + 1 :])


def _corner_classes(patches: list[Cell], known: _Vertices) -> dict[Cell, tuple[int, ...]]:
    """Return, for each patch, the numbers of the places where its corners lie.

    In the order in which `Symmetry.corners` takes them: the two edges along s end in all four.
    """
    corners = {
        patch: [corner for edge in patch_edges(patch)[::2] for corner in edge_ends(edge.cell)]
        for patch in patches
    }
    _, place_of = known.of(sorted({c for row in corners.values() for c in row}))
    return {patch: tuple([place_of[c] for c in row]) for patch, row in corners.items()}


def _collapse(patch: Cell, questions: Questions) -> SideFate | None:
    s, t = directions_of(patch)
    over_s, over_t = questions.ignores(patch, s), questions.ignores(patch, t)
    if over_s and over_t:
        both = over_s if over_s is Verdict.UNDECIDED else over_t
        return SideFate(patch, "point", both)
    if over_s:
        return SideFate(patch, "curve", over_s, along=t)
    if over_t:
        return SideFate(patch, "curve", over_t, along=s)
    return None


def _partner(
    first: Cell,
    second: Cell,
    places: dict[Cell, tuple[int, ...]],
    questions: Questions,
    labels: Labels,
) -> SideFate | None:
    """Return the gluing of `first` to `second`, if they coincide."""
    for symmetry in SYMMETRIES:
        if first == second and symmetry is IDENTITY:
            continue
        # what coincides has its corners at the same places
        if symmetry.corners(places[second]) != places[first]:
            continue
        verdict = questions.coincide(first, second, symmetry)
        if not verdict:
            continue
        if outward_sign(first) * outward_sign(second) * symmetry.determinant != -1:
            raise SidesFoldedTogetherError(
                f"the sides {cell_name(first, labels)} and {cell_name(second, labels)} cover the "
                "same surface from the same side: the map is folded over itself"
            )
        return SideFate(first, "interface", verdict, partner=second, symmetry=symmetry)
    return None


class _Vertices:
    """The vertices at corners; where no side goes, the same corners are asked for twice."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self._found: dict[tuple[Cell, ...], tuple[tuple[VertexClass, ...], dict[Cell, int]]] = {}

    def of(self, corners: list[Cell]) -> tuple[tuple[VertexClass, ...], dict[Cell, int]]:
        """Return the vertices, and which of them each corner is."""
        key = tuple(corners)
        if key not in self._found:
            groups = self._questions.places(corners)
            vertex_of = {corner: i for i, group in enumerate(groups) for corner in group}
            self._found[key] = tuple([VertexClass(tuple(group)) for group in groups]), vertex_of
        return self._found[key]


def _edges(
    cells: list[Cell], vertex_of: dict[Cell, int], questions: Questions
) -> tuple[tuple[EdgeClass, ...], dict[Cell, tuple[int | None, bool]]]:
    """Return the edge classes and, per edge cell, its class (None: collapsed) and direction."""
    classes: list[list[EdgeMember]] = []
    found: dict[Cell, tuple[int | None, bool]] = {}
    # one edge, the same ends: others need not be asked about
    by_ends: dict[tuple[int, int], list[int]] = {}
    for cell in cells:
        if questions.is_point(cell):
            found[cell] = (None, False)
            continue
        start, end = (vertex_of[corner] for corner in edge_ends(cell))
        asked = [(i, False) for i in by_ends.get((start, end), ())]
        asked += [(i, True) for i in by_ends.get((end, start), ())]
        for index, reverse in sorted(asked):
            if questions.same_edge(classes[index][0].cell, cell, reverse):
                classes[index].append(EdgeMember(cell, reverse))
                found[cell] = (index, reverse)
                break
        else:
            found[cell] = (len(classes), False)
            by_ends.setdefault((start, end), []).append(len(classes))
            classes.append([EdgeMember(cell, False)])
    edges = []
    for members in classes:
        start, end = (vertex_of[corner] for corner in edge_ends(members[0].cell))
        edges.append(EdgeClass(tuple(members), start, end))
    return tuple(edges), found


def _uses(
    patch: Cell, edge_of: dict[Cell, tuple[int | None, bool]], vertex_of: dict[Cell, int]
) -> tuple[EdgeUse, EdgeUse, EdgeUse, EdgeUse]:
    uses = []
    for side in patch_edges(patch):
        edge, reverse = edge_of[side.cell]
        start, end = edge_ends(side.cell)
        vertex = vertex_of[start if side.forward else end]
        uses.append(EdgeUse(side.cell, edge, side.forward != reverse, vertex))
    return uses[0], uses[1], uses[2], uses[3]


def _walk_sign(complex_: BoundaryComplex, face: int, use: EdgeUse) -> int:
    """Return the direction of a use as seen from outside the solid."""
    return outward_sign(complex_.faces[face].patch) * (1 if use.forward else -1)


def _check_manifold(complex_: BoundaryComplex) -> None:
    for edge, uses in complex_.edge_uses().items():
        if len(uses) == 2 and not sum([_walk_sign(complex_, *use) for use in uses]):
            continue
        name = complex_.name(complex_.edges[edge].cell)
        faces = ", ".join(complex_.name(complex_.faces[face].patch) for face, _ in uses)
        if len(uses) != 2:
            raise EdgeNotUsedTwiceError(
                f"the edge {name} is used {len(uses)} times (by {faces}) where a closed boundary "
                "uses each edge twice: the sides do not meet there in one common curve"
            )
        raise EdgeNotUsedTwiceError(
            f"the faces {faces} meet along {name} with opposite orientations: the map turns "
            "inside out there"
        )


def _check_layer(complex_: BoundaryComplex, members: Collection[int], layer: int) -> None:
    """Raise EdgeNotUsedTwiceError where a layer comes to nothing along an edge inside."""
    for edge, uses in complex_.edge_uses().items():
        faces = [f for f, _ in uses if f in members]
        if len(faces) > 2:
            names = ", ".join(complex_.name(complex_.faces[f].patch) for f in faces)
            raise EdgeNotUsedTwiceError(
                f"the edge {complex_.name(complex_.edges[edge].cell)} is used {len(faces)} times "
                f"in layer {layer + 1} (by {names}) where a closed boundary uses each "
                "edge twice: the layer comes to nothing there; give it a thickness, or end the "
                "domain"
            )


def _shells(complex_: BoundaryComplex, members: Iterable[int]) -> tuple[Shell, ...]:
    """Return the closed surfaces that some of the faces make up."""
    chosen = set(members)
    links: dict[int, set[int]] = defaultdict(set)
    for uses in complex_.edge_uses().values():
        here = [face for face, _ in uses if face in chosen]
        for first, second in combinations(here, 2):
            links[first].add(second)
            links[second].add(first)
    shells, seen = [], set[int]()
    for start in sorted(chosen):
        if start in seen:
            continue
        component, stack = {start}, [start]
        while stack:
            for other in links[stack.pop()] - component:
                component.add(other)
                stack.append(other)
        seen |= component
        faces = tuple(sorted(component))
        walks = [use for f in faces for use in complex_.faces[f].uses]
        edges = {use.edge for use in walks if use.edge is not None}
        vertices = {use.vertex for use in walks}
        shells.append(Shell(faces, len(vertices) - len(edges) + len(faces)))
    return tuple(shells)
