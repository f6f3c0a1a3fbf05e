"""What the proof on the built faces says of the equation.

M covers every place as often as the boundary winds about it, because det J keeps its sign. No face
that was built is farther than its deviation from the equation's: about a place that is farther from
the boundary than that, both wind equally often. Faces that meet nowhere wind once or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.errors import ToleranceNotReachedError
from pc2cad.geometry.sheets import Sheet
from pc2cad.solidity.embedding.crossing import crossing_depth
from pc2cad.solidity.embedding.proof import TOUCHING, Doubt, Meeting, Outcome, prove
from pc2cad.solidity.injectivity import OverlappingMapError
from pc2cad.solidity.nearest_places import descended
from pc2cad.solidity.overlap_depth import overlap_depth, told_depth

#: places along each parameter where the search for a point of a face begins
_START = 33
#: how far a search for nearest places may run from where it began
_REACH = 0.02
#: its steps: of two faces that touch without an angle each leaves a share of the way
_STEPS = 600
#: places of the box nearer than this are one: two faces meet there along their edge
_SAME_PLACE = 1e-3
#: two faces are one where the equation has points nearer than this share of the size
_MEET = 1e-9


class BuiltFacesMeetError(ToleranceNotReachedError):
    """Faces within the tolerance of the equation's cross one another, and the equation's do not."""


@dataclass(frozen=True)
class Embedding:
    """What is known of whether the boundary meets itself."""

    #: that what was built nowhere meets itself
    proved: bool
    #: parts of faces that were looked at
    cells: int
    #: an overlap of built faces would be no deeper than this (model units)
    depth: float
    #: why it is not proved, with the place
    open: str = ""
    #: sides of the box of which it is only sampled that they collapse or coincide
    sides: tuple[str, ...] = ()


def check_embedded(
    analysis: Analysis,
    sheets: Sequence[Sheet],
    lines: Array,
    deviations: Sequence[float],
    left: Sequence[str],
    doubt: Callable[[], object] = lambda: None,
) -> Embedding:
    """Return what is known of the built faces, as sheets; raise where they meet.

    `lines` are start and step of the straight edges, `deviations` those of all faces, `left` names
    of faces that are no sheets. `doubt` is called, and may raise, where faces meet, are not soon
    told apart, or are so near one another that the equation's may touch. Raises
    OverlappingMapError where the equation meets itself, and BuiltFacesMeetError where only what was
    built does.
    """
    if not sheets:
        return Embedding(False, 0, np.inf, _not_taken(left))
    # of a solid one side of which is missing nothing follows
    noise, every = analysis.scale.evaluation_noise, bool(left)
    near = asked_about(analysis, deviations)
    outcome = prove(sheets, lines, analysis.size, noise, every, Doubt(doubt, near))
    if outcome.meeting is not None and outcome.meets:
        found = _found(analysis, sheets, outcome.meeting)
        if found.joined(_MEET * analysis.size):
            return Embedding(False, outcome.cells, np.inf, _undecided(analysis, sheets, outcome))
        _refuse(analysis, sheets, outcome.meeting, found, deviations)
    # what is left of a sharp apex far from the origin may be as small as what counts as one point
    if outcome.depth > TOUCHING * analysis.size:
        return Embedding(False, outcome.cells, outcome.depth, _undecided(analysis, sheets, outcome))
    if left:
        return Embedding(False, outcome.cells, np.inf, _not_taken(left))
    return Embedding(True, outcome.cells, outcome.depth)


def asked_about(analysis: Analysis, deviations: Sequence[float]) -> float:
    """Return how near (model units) built faces are whose equation's may touch."""
    return 2 * max(deviations) + TOUCHING * analysis.size + analysis.scale.sampling_noise


def _not_taken(left: Sequence[str]) -> str:
    names = ", ".join(left)
    return f"{names}: bounded by curves on its surface, which are not compared with other faces"


@dataclass(frozen=True)
class _Found:
    """A meeting of two built faces, sought on the equation's own."""

    functions: tuple[RestrictedMap, RestrictedMap]
    #: parameters of both faces where the equation's are nearest, and how far they are apart there
    places: tuple[tuple[float, float], tuple[float, float]]
    gap: float

    def joined(self, near: float) -> bool:
        """Return whether both places are at one point of a common edge, nearer than samples tell.

        In a cusp faces leave their common edge side by side, however near one looks.
        """
        one, other = (
            [f.at(np.array(x), np.array(y)) for x, y in _on_border(place)]
            for f, place in zip(self.functions, self.places, strict=True)
        )
        return any(float(np.linalg.norm(p - q)) <= near for p in one for q in other)


def _on_border(place: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the places of a face's border that are as good as the same place."""
    x, y = place
    found = [(end, y) for end in (0.0, 1.0) if abs(x - end) < _SAME_PLACE]
    return found + [(x, end) for end in (0.0, 1.0) if abs(y - end) < _SAME_PLACE]


def _found(analysis: Analysis, sheets: Sequence[Sheet], meeting: Meeting) -> _Found:
    first, second = (sheets[i] for i in meeting.sheets)
    functions = (_function(analysis, first), _function(analysis, second))
    point = np.array(meeting.point)
    starts: list[Array] = []
    for sheet, place, function in zip((first, second), meeting.places, functions, strict=True):
        away = starts[0] if starts and first is second else None
        known = _own_place(sheet, place) if sheet.own else None
        starts.append(_nearest(function, point, away) if known is None else known)
    return _Found(functions, *_approached(functions, starts))


def _refuse(
    analysis: Analysis,
    sheets: Sequence[Sheet],
    meeting: Meeting,
    found: _Found,
    deviations: Sequence[float],
) -> None:
    first, second = (sheets[i] for i in meeting.sheets)
    both = list(zip(found.functions, found.places, strict=True))
    shown = [f.shown(*place) for f, place in both]
    where = ", ".join(f"{x:.6g}" for x in meeting.point)
    reach = sum(deviations[sheet.face] for sheet in (first, second))
    ends = [np.array(f.place(*place)) for f, place in both]
    distinct = float(np.abs(ends[0] - ends[1]).max()) > _SAME_PLACE
    # where the built faces meet, the equation's are as near as these deviate, found or not
    touching = _MEET * analysis.size
    gap = min(found.gap, reach + touching) if distinct else found.gap
    if reach == 0 or (distinct and gap <= touching):
        depth = overlap_depth(analysis, found.functions, found.places)
        raise OverlappingMapError(
            f"{told_depth(depth, analysis)}: {shown[0]} and {shown[1]} both lie at ({where}); "
            "a larger pitch or distance between strands, a thinner wall or smaller section, or a "
            "shorter domain would part them"
        )
    units = analysis.equation.units
    told, deep = "are joined at an edge", ""
    if distinct:
        told = f"are {gap:.2g} {units} apart"
        one, other = (f.at(*map(np.array, place)) for f, place in both)
        depth = crossing_depth(sheets, meeting, one - other, reach)
        deep = f", {depth:.2g} {units} deep or more," if depth > 0 else ""
    enough = gap / 4 if distinct else max(deviations) / 10
    raise BuiltFacesMeetError(
        f"the faces {first.name} and {second.name}, which deviate from the equation by up to "
        f"{reach:.2g} {units} together, meet{deep} at ({where}), where the equation's {told} "
        f"({shown[0]} and {shown[1]}): a tolerance of {enough:.1g} {units} would keep them apart"
    )


def _undecided(analysis: Analysis, sheets: Sequence[Sheet], outcome: Outcome) -> str:
    meeting = outcome.meeting
    assert meeting is not None
    shown = []
    for index in meeting.sheets:
        function = _function(analysis, sheets[index])
        shown.append(function.shown(*_nearest(function, np.array(meeting.point))))
    point = ", ".join(f"{x:.6g}" for x in meeting.point)
    names = " and ".join(dict.fromkeys(sheets[i].name for i in meeting.sheets))
    return f"parts of {names} at ({point}), {' and '.join(dict.fromkeys(shown))}"


def _function(analysis: Analysis, sheet: Sheet) -> RestrictedMap:
    return RestrictedMap(analysis, analysis.complex.faces[sheet.cell].patch)


def _own_place(sheet: Sheet, place: tuple[float, float]) -> Array:
    """Return a place of a sheet as its face's own parameters, roughly."""
    result = []
    for x, side in zip(place, (sheet.sides[0], sheet.sides[3]), strict=True):
        run = np.abs(side.along - side.along[0])
        result.append(np.interp(x, np.arange(len(run)), run / run[-1]))
    return np.array(result)


def _nearest(function: RestrictedMap, point: Array, other: Array | None = None) -> Array:
    """Return the parameters of a face's point near a point of space, not those of an `other`."""
    nodes = np.linspace(0.0, 1.0, _START)
    gap = function(nodes, nodes) - point
    square = np.einsum("ijk,ijk->ij", gap, gap)
    if other is not None:
        near = [np.abs(nodes - x) < 2 * _REACH for x in other]
        square[np.ix_(*near)] = np.inf
    index = np.unravel_index(int(square.argmin()), square.shape)
    reach = 1.0 if other is None else 2 / _START
    return descended(lambda x: function.at(x[..., 0], x[..., 1]) - point, nodes[list(index)], reach)


def _approached(
    functions: Sequence[RestrictedMap], starts: Sequence[Array]
) -> tuple[tuple[tuple[float, float], tuple[float, float]], float]:
    """Return places of two faces near some where they are nearest, and their distance."""
    one, other = functions

    def gap(x: Array) -> Array:
        return np.asarray(one.at(x[..., 0], x[..., 1]) - other.at(x[..., 2], x[..., 3]))

    found = descended(gap, np.concatenate(starts), _REACH, _STEPS)
    places = (float(found[0]), float(found[1])), (float(found[2]), float(found[3]))
    return places, float(np.linalg.norm(gap(found)))
