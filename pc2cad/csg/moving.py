"""How the bodies of a part, and their copies, move with one parameter.

By Reynolds' theorem the moment of f changes by ∫ f V·n dA, with V = ∂M/∂p of the body whose side a
face is a part of. A copy has that of its body, turned, and that of its place. The area of a face
changes by ∫ div V dA over it, and where its edge moves otherwise than its body does: an edge where
two bodies meet stays on both, so that along the outward conormal ν of a face, which the other one
has the normal m and the velocity W to, it runs ahead by (W - V)·m / ν·m.

*Source:* J. Sokolowski, J.-P. Zolésio, Introduction to Shape Optimization (1992), chapter 2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.booleans import (
    NamedEdge,
    NamedShape,
    edge_functions,
    edges_between,
    original,
    unplaced,
)
from pc2cad.brep.edge_integrals import edge_integral, turns_forward
from pc2cad.brep.forms import PAIRS, Form
from pc2cad.domain.velocity import (
    LOOK,
    SETTLED,
    STEPS,
    NotDifferentiableError,
    difference,
    velocity,
)
from pc2cad.errors import InputError
from pc2cad.geometry.jets import EdgeFunction
from pc2cad.part import Body
from pc2cad.sampling.on_sides import SidePlaces
from pc2cad.templates.bodies import Pattern, Tree
from pc2cad.templates.patterns import Placement
from pc2cad.topology.cells import SideKey, directions_of

#: columns of a form: volume, first and second moments, and area
COLUMNS: Final = 11
#: sine of the angle between two faces below which they touch without one, and share of the fastest
#: point's speed that is none
TOUCHES, RESTS = 1e-6, 1e-9
#: tree of the result -> places of the copies of a pattern
_Copies = Callable[[Pattern], Sequence[Placement]]


class NoAngleError(NotDifferentiableError):
    """Bodies touch along an edge without an angle, and part there as a parameter changes."""


class Moving:
    """All bodies and copies of a part as one parameter changes."""

    def __init__(
        self,
        result: Tree,
        parts: Mapping[str, Body],
        placed_at: Callable[[str, Fraction], Tree],
        name: str,
    ) -> None:
        self.name = name
        for body in parts:
            if "(" in body:  # its sides lie where two bodies meet, and where these cross they jump
                raise InputError(
                    f"how {body} changes with {name} is not known: within other Booleans its faces "
                    "are not followed; write cut(a, b) in the place of difference(a, b)"
                )
        bases = {body: _Base(part, name) for body, part in parts.items()}
        first = next(iter(bases.values()))
        self.value = first.value
        lying = dict(places(result))
        drifts, doubt = _drifts(result, placed_at, name, first.value, lying)
        self._bodies = {
            copy: MovingCopy(bases[original(copy)], place, drifts[copy])
            for copy, place in lying.items()
        }
        #: of the fastest point
        self.rate = max(one.rate for one in self._bodies.values())
        #: estimate of the velocities' error, relative to that
        self.doubt = max(doubt, *(base.doubt for base in bases.values()))

    def copy(self, name: str) -> MovingCopy:
        """Return one body or copy by its name."""
        return self._bodies[name]

    def form(self, key: SideKey, centre: Array) -> Form | None:
        """Return V·n with its moments about a centre, and div V, on a side; None: it stays."""
        copy = self._bodies[key.body]
        if not copy.rate:
            return None
        at = copy.side(key)

        def columns(points: Array, normals: Array) -> Array:
            speed, spread = at(points + centre)
            second = [points[:, i] * points[:, j] for i, j in PAIRS]
            moments = np.column_stack((np.ones(len(points)), points, *second))
            area = spread * np.sqrt((normals * normals).sum(axis=1))
            return np.column_stack(((speed * normals).sum(axis=1)[:, None] * moments, area))

        rate, size = copy.rate, copy.size

        def most(reach: float) -> Array:
            return rate * np.repeat([1.0, reach, reach * reach, 1 / size], [1, 3, 6, 1])

        return Form(columns, most)

    def edges(self, shape: NamedShape) -> float:
        """Return how the area grows as edges between bodies move otherwise than these do.

        Raises NoAngleError where faces that touch without an angle part.
        """
        named = [
            edge for edge in edges_between(shape) if edge.names[0][0].body != edge.names[1][0].body
        ]
        pairs = zip(named, edge_functions(shape, named, np.zeros(3)), strict=True)
        return sum(self._along(shape, edge, function) for edge, function in pairs)

    def _along(self, shape: NamedShape, edge: NamedEdge, function: EdgeFunction) -> float:
        bodies = [self._bodies[names[0].body] for names in edge.names]
        if not any(body.rate for body in bodies):
            return 0.0
        sides = [body.side(names[0]) for body, names in zip(bodies, edge.names, strict=True)]
        ways = [turns_forward(edge.edge, shape.faces[index][0]) for index in edge.faces]
        least = max(body.rate for body in bodies) * RESTS

        def ahead(t: Array) -> Array:
            points, slope = function.curve.jet(t)
            speeds = [side(points)[0] for side in sides]
            length = np.sqrt((slope * slope).sum(axis=1))
            normals = []
            for trace in function.traces:
                a, b = trace.path.jet(t)[0].T
                normal = np.cross(*trace.surface.jet(a, b)[1:])
                normals.append(normal / np.sqrt((normal * normal).sum(axis=1))[:, None])
            total = np.zeros(len(t))
            for k, forward in enumerate(ways):
                # the face lies to the left of its edges, seen against its surface's normal
                outward = np.cross(slope, normals[k]) / length[:, None] * (1 if forward else -1)
                gap = ((speeds[1 - k] - speeds[k]) * normals[1 - k]).sum(axis=1)
                sine = (outward * normals[1 - k]).sum(axis=1)
                apart = np.sqrt(((speeds[1 - k] - speeds[k]) ** 2).sum(axis=1)) > least
                if (apart & (np.abs(sine) < TOUCHES)).any():
                    raise NoAngleError(self._touching(edge))
                total += np.divide(gap, sine, out=np.zeros(len(t)), where=apart)
            return np.asarray(total * length)

        worth = edge.length * max(body.rate for body in bodies)
        return edge_integral(ahead, function, worth)

    def _touching(self, edge: NamedEdge) -> str:
        labels = " and ".join(names[0].label for names in edge.names)
        return (
            f"the area has no derivative with respect to {self.name}: {labels} touch along an edge "
            "without an angle, and move apart"
        )


class _Base:
    """One body as it stands, as the parameter changes."""

    def __init__(self, body: Body, name: str) -> None:
        self.body = body
        self.variation = body.equation.variation(name)
        self.value = self.variation.value
        self.velocity = velocity(body.checked.analysis, self.variation)
        grid = np.ix_(LOOK, LOOK, LOOK)
        speed = self.velocity.frame(*grid)[0]
        #: of its fastest point
        self.rate = float(np.nanmax(np.abs(speed), initial=0.0))
        self.doubt = self.velocity.doubt() if self.rate else 0.0
        #: how far its points are from the origin
        self.far = float(np.abs(body.checked.analysis.map.points(*grid)).max())
        self._places: dict[SideKey, SidePlaces] = {}

    def at(self, key: SideKey, points: Array) -> tuple[Array, Array]:
        """Return V (n, 3) and its divergence along a side (n,) at points of the side (n, 3)."""
        if key not in self._places:
            self._places[key] = SidePlaces(self.body.checked.analysis, self.body.patches(key))
        local = self._places[key](points)
        s, t = directions_of(self.body.patches(key)[0])
        _, *tangents = self.body.checked.analysis.map.frame(*local.T)
        speed, *speeds = self.velocity.frame(*local.T)
        normal = np.cross(tangents[s], tangents[t])
        change = np.cross(speeds[s], tangents[t]) + np.cross(tangents[s], speeds[t])
        square = (normal * normal).sum(axis=1)
        # at a pole there is no area that would change
        spread = np.divide(
            (normal * change).sum(axis=1), square, out=np.zeros(len(square)), where=square > 0
        )
        return np.asarray(speed), spread


@dataclass(frozen=True, eq=False)
class _Drift:
    """How fast a placement changes: its turn (3, 3) and its offset (3,)."""

    turn: Array
    offset: Array


class MovingCopy:
    """A body where it lies, as the parameter changes."""

    def __init__(self, base: _Base, place: Placement, drift: _Drift) -> None:
        self._base, self._place, self._drift = base, place, drift
        moved = np.abs(drift.turn).sum(axis=1).max() * base.far + np.abs(drift.offset).max()
        self.rate = base.rate + float(moved)
        self.size = base.body.checked.analysis.scale.size
        #: its equation, and V of it where it does not lie elsewhere
        self.variation, self.velocity = base.variation, base.velocity

    def side(self, key: SideKey) -> Callable[[Array], tuple[Array, Array]]:
        """Return the function that gives V and its divergence at points (n, 3) of a side."""
        place, own = self._place, unplaced(key)

        def at(points: Array) -> tuple[Array, Array]:
            before = (points - place.offset) @ place.turn
            speed, spread = self._base.at(own, before)
            return self.placed(before, speed), spread

        return at

    def placed(self, before: Array, speed: Array) -> Array:
        """Return V (…, 3) where the body lies, for places of the body itself and V there."""
        moved = before @ self._drift.turn.T + self._drift.offset
        return np.asarray(speed @ self._place.turn.T + moved)


def places(
    tree: Tree,
    copies: _Copies = lambda pattern: pattern.copies,
    place: Placement | None = None,
    mark: str = "",
) -> Iterator[tuple[str, Placement]]:
    """Yield where each body and copy lies, by the names that copies have."""
    place = place or Placement(np.eye(3), np.zeros(3))
    if isinstance(tree, str):
        yield f"{tree}{mark}", place
    elif isinstance(tree, Pattern):
        for k, copy in enumerate(copies(tree)):
            yield from places(tree.operand, copies, place.after(copy), f"[{k}]{mark}")
    else:
        for operand in tree.operands:
            yield from places(operand, copies, place, mark)


def _drifts(
    result: Tree,
    placed_at: Callable[[str, Fraction], Tree],
    name: str,
    value: float,
    lying: Mapping[str, Placement],
) -> tuple[dict[str, _Drift], float]:
    """Return how the places of all copies change, and the doubt of it: by differences of them."""
    now = {copy: np.column_stack((p.turn, p.offset)) for copy, p in lying.items()}
    still = {copy: _Drift(np.zeros((3, 3)), np.zeros(3)) for copy in now}
    if not any(isinstance(part, Pattern) for part in _parts(result)):
        return still, 0.0
    step = Fraction(abs(value) / 128 or 2.0**-7).limit_denominator(10**9)
    best: tuple[Array, float] | None = None
    for shorter in (step, step / 4, step / 16):
        rows = []
        for k in STEPS:
            try:
                tree = placed_at(name, Fraction(value) + k * shorter)
            except InputError as error:
                raise NotDifferentiableError(
                    f"there is no derivative with respect to {name} = {value:.6g}: {error}"
                ) from error
            known = {(p.kind, p.texts): p.copies for p in _parts(tree) if isinstance(p, Pattern)}
            there = dict(places(result, lambda p, known=known: known[p.kind, p.texts]))  # type: ignore[misc]
            rows.append(np.array([np.column_stack((there[c].turn, there[c].offset)) for c in now]))
        fine, coarse = difference(rows, float(shorter))
        largest = float(np.abs(fine).max())
        doubt = float(np.abs(fine - coarse).max()) / largest if largest else 0.0
        if best is None or doubt < best[1]:
            best = fine, doubt
        if doubt <= SETTLED:
            break
    assert best is not None
    found = {c: _Drift(row[:, :3], row[:, 3]) for c, row in zip(now, best[0], strict=True)}
    return found, best[1]


def _parts(tree: Tree) -> Iterator[Tree]:
    """Yield a tree and all that it is made of."""
    yield tree
    if not isinstance(tree, str):
        for operand in (tree.operand,) if isinstance(tree, Pattern) else tree.operands:
            yield from _parts(operand)
