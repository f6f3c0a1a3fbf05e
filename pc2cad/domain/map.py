"""The map M of a point equation on arrays: points, tangents and the Jacobian determinant.

Parameters are normalised: every function takes local coordinates in [0, 1] of the box and returns
model units. Arrays are open grids in the sense of numpy.ix_, so that a sub-expression of one
parameter is evaluated once per value of that parameter.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise, product
from math import ceil, comb, prod

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array
from pc2cad.arrays.linear import squares
from pc2cad.domain.pieces import Pieces
from pc2cad.equation.point_equation import PointEquation
from pc2cad.expression.breaks import trim_pieces
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.end_roots import is_analytic, take_out_ends
from pc2cad.expression.end_zeros import take_out_zeros
from pc2cad.expression.evaluation import Program
from pc2cad.expression.inner_roots import inner_roots
from pc2cad.expression.kinks import take_kinks_apart
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.ranges import take_chosen_ranges, take_ranges
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.sign_changes import in_pieces
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import ONE, ZERO, Expr, number, ops_of, substitute, symbol

#: distances from a limit at which speeds are compared
_NEAR, _NEARER = 1e-6, 1e-9
#: and those at which a speed that vanishes is looked at
_BLUNT = 1e-4, 1e-5
#: a speed below this share of the largest one nearby is rounding
_NOISE = 1e-9
#: what programs are made of: the points, or these with all derivatives
_POINTS, _FRAME = ("M",), ("M", *PARAMETERS)
#: places along each parameter at which it is asked how fast a map runs
SPEED_PLACES = (0.03, 0.24, 0.52, 0.79, 0.97)
#: parts of the box that are looked at where roots vanish inside
_MOST_PARTS = 64


@dataclass(frozen=True)
class Mapping3:
    """M(u,v,w) over the unit box with its first derivatives.

    The programs are made on first use and kept; the trees themselves are never changed.
    """

    coordinates: tuple[Expr, Expr, Expr]
    #: the equation's own u, v and w as trees of the local ones
    parameters: tuple[Expr, Expr, Expr]
    #: where parts of it meet, per direction, ascending in ]0, 1[
    joints: tuple[tuple[Fraction, ...], ...] = ((), (), ())
    #: M in parameters that run evenly, where those of the coordinates are slowed down at limits: as
    #: the latter rise with the former, det J has the same sign in both
    even: tuple[Expr, Expr, Expr] | tuple[()] = ()
    _programs: dict[tuple[str, ...], Program] = field(
        default_factory=dict, compare=False, repr=False
    )

    def points(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> Array:
        """Return M, shape broadcast(u, v, w) + (3,)."""
        return self._run(_POINTS, u, v, w)[0]

    def tangents(
        self, directions: tuple[int, ...], u: ArrayLike, v: ArrayLike, w: ArrayLike
    ) -> list[Array]:
        """Return the derivatives of M in some directions (0: u, 1: v, 2: w); shapes as `points`."""
        return self._run(tuple(PARAMETERS[d] for d in directions), u, v, w)

    def line(self, direction: int, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """Return M and its derivative in one direction, evaluated together; shapes as `points`."""
        return self._run(("M", PARAMETERS[direction]), u, v, w)

    def frame(self, u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        """Return M, M_u, M_v and M_w, evaluated together; shapes as `points`."""
        return self._run(_FRAME, u, v, w)

    def value(self, direction: int, local: float) -> float:
        """Return the equation's own parameter at a local coordinate of one direction."""
        return evaluate(self.parameters[direction], {PARAMETERS[direction]: local})

    def shown(self, place: Iterable[float]) -> str:
        """Return a place in local coordinates as the equation's own parameters, for a message."""
        rows = zip(PARAMETERS, range(3), place, strict=True)
        return ", ".join(f"{name} = {self.value(d, float(x)):.4g}" for name, d, x in rows)

    def values(self, direction: int, local: ArrayLike) -> Array:
        """Return the equation's own parameter at local coordinates of one direction (an array)."""
        name = PARAMETERS[direction]
        places = np.asarray(local, dtype=float)
        (found,) = Program((self.parameters[direction],))({name: places})
        return np.array(np.broadcast_to(found, places.shape))

    def local(self, direction: int, own: Array) -> Array:
        """Return the local coordinates at which a parameter has values (n,): it ascends."""
        ends = self.values(direction, [0.0, 1.0])
        share = (own - ends[0]) / (ends[1] - ends[0])
        off = np.abs(self.values(direction, share) - own).max(initial=0.0)
        if off <= 4e-16 * np.abs(ends).max():
            return np.asarray(share)
        low, high = np.zeros_like(own), np.ones_like(own)
        for _ in range(60):
            middle = (low + high) / 2
            below = self.values(direction, middle) < own
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray((low + high) / 2)

    @cached_property
    def is_alike_together(self) -> bool:
        """Whether values are the same to the last bit whatever is evaluated with them.

        Series are products of matrices, whose sums are rounded by their shapes.
        """
        return "fourier" not in ops_of(self.coordinates)

    @cached_property
    def pieces(self) -> Pieces:
        """What M is on the pieces of its box."""
        return Pieces(self.coordinates)

    @cached_property
    def derivatives(self) -> tuple[tuple[Expr, ...], ...]:
        """Trees of M_u, M_v and M_w."""
        return tuple(derivatives(self.coordinates, name) for name in PARAMETERS)

    @cached_property
    def speeds(self) -> tuple[float, float, float]:
        """The largest |M_u|, |M_v| and |M_w| at a few places, no less than the coordinates there.

        A derivative is a difference of terms as large as these.
        """
        return speeds_of(*self.frame(*open_grid(*[SPEED_PLACES] * 3)))

    def _run(self, keys: tuple[str, ...], u: ArrayLike, v: ArrayLike, w: ArrayLike) -> list[Array]:
        # points are often all that is asked for; derivatives have most of their trees in common, so
        # a program that has them serves points as well: no value depends on what else there is
        held = keys if keys == _POINTS and _FRAME not in self._programs else _FRAME
        if held not in self._programs:
            roots = tuple(tree for key in held for tree in self._trees_of(key))
            self._programs[held] = Program(roots)
        which = tuple([3 * held.index(key) + axis for key in keys for axis in range(3)])
        values: Mapping[str, Array] = {
            name: np.asarray(value, dtype=float)
            for name, value in zip(PARAMETERS, (u, v, w), strict=True)
        }
        shape = np.broadcast(*values.values()).shape  # sooner than `np.broadcast_shapes`
        columns = self._programs[held](values, which)
        results = []
        for i in range(0, len(columns), 3):
            # one coordinate after the other in memory: products of coordinates are then fast
            result = np.empty((3, *shape))
            for axis in range(3):
                result[axis] = columns[i + axis]
            results.append(result.transpose(*range(1, result.ndim), 0))
        return results

    def _trees_of(self, key: str) -> tuple[Expr, ...]:
        return self.coordinates if key == "M" else self.derivatives[PARAMETERS.index(key)]


#: a part of the box: its number along u, v and w
_Cell = tuple[int, int, int]


def local_map(equation: PointEquation) -> Mapping3:
    """Return M over the unit box, without infinite speeds at its sides or inside.

    Where a derivative is infinite at a limit of its parameter (a root that ends there, an arc sine
    that reaches 1), no spline in that parameter would converge: the direction gets a parameter of
    which the old one is a power near that end. The solid is the same, and all faces along the
    direction change alike. Where something below a root vanishes inside, at a value of one
    parameter, M is taken in parts, whose limits are ends: a crease lies there.
    """
    whole = _Part.of(equation, ((ZERO, ONE),) * 3)
    places = inner_roots(whole.mapping.coordinates)
    if not any(places) or prod(len(row) + 1 for row in places) > _MOST_PARTS:
        slowed = _slowed({(0, 0, 0): whole})[0, 0, 0]
        if slowed.parameters == whole.mapping.parameters:
            return slowed
        # as they are written, zeros in roots included: what is left of them is no formula
        evenly = dict(zip(PARAMETERS, whole.mapping.parameters, strict=True))
        x, y, z = substitute(equation.coordinates, evenly)
        return replace(slowed, even=(x, y, z))
    spans = [list(pairwise((ZERO, *map(number, row), ONE))) for row in places]
    parts = {}
    for cell in product(*(range(len(row)) for row in spans)):
        i, j, k = cell
        parts[i, j, k] = _Part.of(equation, (spans[0][i], spans[1][j], spans[2][k]))
    return _joined(_slowed(parts), places)


@dataclass(frozen=True)
class _Part:
    """M over a part of the box, in parameters that run from 0 to 1 there."""

    #: trees of M, and what their parameters are of the part's own
    source: tuple[Expr, ...]
    shown: tuple[Expr, ...]
    mapping: Mapping3

    @classmethod
    def of(cls, equation: PointEquation, spans: Sequence[tuple[Expr, Expr]]) -> _Part:
        """Return M between some shares (0 to 1) of the way along u, v and w, zeros taken out."""
        u, v, w = (
            low + (high - low) * (start + (end - start) * symbol(name))
            for name, (low, high), (start, end) in zip(
                PARAMETERS, equation.domain, spans, strict=True
            )
        )
        mapping = _mapping(equation.coordinates, (u, v, w), (u, v, w))
        without = take_out_zeros(mapping.coordinates)
        if without == mapping.coordinates and all(span == (ZERO, ONE) for span in spans):
            return cls(equation.coordinates, (u, v, w), mapping)
        # from here on all is a function of the local parameters, in which signs are known
        x, y, z = without
        own = (symbol("u"), symbol("v"), symbol("w"))
        return cls(without, own, Mapping3((x, y, z), (u, v, w)))

    def changed(self, changes: dict[str, Expr]) -> _Part:
        """Return the part with functions of other parameters put for some."""
        u, v, w = substitute(self.mapping.parameters, changes)
        shown = substitute(self.shown, changes)
        return _Part(self.source, shown, _mapping(self.source, shown, (u, v, w)))


def _slowed(parts: dict[_Cell, _Part]) -> dict[_Cell, Mapping3]:
    """Return M over the parts without infinite speeds at their sides, where that can be had.

    Parts that follow one another across a direction change their parameters along it alike.
    """
    first = {cell: part.mapping for cell, part in parts.items()}
    for _ in range(3):
        found = _changes(parts)
        if not found:
            return {cell: part.mapping for cell, part in parts.items()}
        parts = {
            cell: part.changed(
                {PARAMETERS[d]: found[d, k] for d, k in enumerate(cell) if (d, k) in found}
            )
            for cell, part in parts.items()
        }
    return first if _changes(parts) else {cell: part.mapping for cell, part in parts.items()}


def _changes(parts: dict[_Cell, _Part]) -> dict[tuple[int, int], Expr]:
    """Return by direction, and number along it, what to put for a parameter."""
    found = {}
    for d, k in sorted({(d, k) for cell in parts for d, k in enumerate(cell)}):
        row = [part.mapping for cell, part in parts.items() if cell[d] == k]
        start, end = (max(roots) for roots in zip(*(_roots(m, d) for m in row), strict=True))
        if max(start, end) > 1:
            found[d, k] = _slower(symbol(PARAMETERS[d]), start, end)
    return found


def _joined(parts: dict[_Cell, Mapping3], places: Sequence[tuple[Fraction, ...]]) -> Mapping3:
    """Return one map of parts that end at some places of u, v and w."""
    trees: dict[_Cell, tuple[Expr, ...]] = {
        cell: (*m.coordinates, *m.parameters) for cell, m in parts.items()
    }
    # the places of breaks are kept as floats, and read as these everywhere
    joints = tuple(tuple(number(float(x)).payload for x in row) for row in places)
    for d in range(3):
        spans = list(pairwise((Fraction(0), *joints[d], Fraction(1))))
        own = [(symbol(PARAMETERS[d]) - low) / (high - low) for low, high in spans]
        rows: dict[_Cell, list[tuple[Expr, ...]]] = {}
        for cell in sorted(trees):
            i, j, k = (0 if axis == d else n for axis, n in enumerate(cell))
            rows.setdefault((i, j, k), []).append(
                substitute(trees[cell], {PARAMETERS[d]: own[cell[d]]})
            )
        trees = {
            cell: tuple(
                in_pieces(PARAMETERS[d], joints[d], column, 0) for column in zip(*row, strict=True)
            )
            for cell, row in rows.items()
        }
    x, y, z, u, v, w = trees[0, 0, 0]
    return Mapping3((x, y, z), (u, v, w), joints)


def _mapping(
    source: tuple[Expr, ...], change: tuple[Expr, ...], parameters: tuple[Expr, Expr, Expr]
) -> Mapping3:
    """Return trees of some parameters with a change of these, and the equation's own ones."""
    trees = substitute(source, dict(zip(PARAMETERS, change, strict=True)))
    trees = trim_pieces(take_ranges(trees, parameters))
    trees = take_chosen_ranges(take_kinks_apart(trees, parameters), parameters)
    x, y, z = take_out_ends(simplified(trees))
    return Mapping3((x, y, z), parameters)


def _slower(t: Expr, start: int, end: int) -> Expr:
    """Return a parameter that starts like t^start and ends like (1-t)^end."""
    if start == 1:
        # nothing cancels near the end, where roots would make much of its rounding
        return 1 - (1 - t) ** end
    # the integral of s^(start-1) (1-s)^(end-1), made to end at 1
    total = sum(((-1) ** k * _term(start, end, k) for k in range(end)), start=Fraction(0))
    change: Expr = number(0)
    for k in range(end):
        change = change + (-1) ** k * _term(start, end, k) / total * t ** (start + k)
    return change


def _term(start: int, end: int, k: int) -> Fraction:
    return Fraction(comb(end - 1, k), start + k)


def _roots(mapping: Mapping3, direction: int) -> list[int]:
    """Return n where M moves as the n-th root (to a whole power) near both limits; else 1.

    The speed goes with h^(a-1) at the distance h from the limit; a is a fraction over n. Edges and
    corners are looked at as well: the speed may be infinite on those only. One that vanishes (the
    blunt tip of r = z^(3/4)) counts where it does all over the side.
    """
    if is_analytic(mapping.coordinates):
        return [1, 1]
    roots = []
    for limit, found in enumerate(_powers(mapping, direction, _NEAR, _NEARER)):
        root = 1
        if 0.03 < found < 0.92:
            exponent = Fraction(found).limit_denominator(8)
            near = abs(float(exponent) - found) < 0.01
            root = exponent.denominator if near else ceil(1 / found) + 1
        elif found > 1.08:
            # nearer to the limit, all would be rounding
            blunt = _powers(mapping, direction, *_BLUNT)[limit]
            exponent = Fraction(blunt).limit_denominator(4)
            root = exponent.denominator if abs(float(exponent) - blunt) < 3e-3 else 1
        roots.append(root)
    return roots


def _powers(mapping: Mapping3, direction: int, far: float, close: float) -> list[float]:
    """Return the least power with which M moves between two distances from each limit, so far."""
    grid = [np.array([0.0, 0.13, 0.38, 0.61, 0.86, 1.0])] * 3
    grid[direction] = np.array([far, close, 1 - far, 1 - close])
    powers = []
    with np.errstate(all="ignore"):
        tangent = np.moveaxis(mapping.tangents((direction,), *open_grid(*grid))[0], direction, 0)
        speeds = np.sqrt((tangent**2).sum(axis=-1))
        for near, nearer in (speeds[:2], speeds[2:]):
            slopes = np.log(near / nearer) / np.log(far / close)
            # where all but rounding stands still, its noise has slopes as well
            finite = np.where(np.isfinite(nearer), nearer, 0.0)
            moving = np.isfinite(slopes) & (finite > _NOISE * finite.max())
            powers.append(1 + (float(slopes[moving].min()) if moving.any() else 0.0))
    return powers


def speeds_of(points: Array, *tangents: Array) -> tuple[float, float, float]:
    """Return `Mapping3.speeds` from M, M_u, M_v and M_w (…, 3) on the grid of its places."""
    coordinates = np.fmax.reduce(np.abs(points), axis=None)
    largest = (np.sqrt(np.fmax.reduce(squares(m), axis=None)) for m in tangents)
    u, v, w = (float(max(length, coordinates)) for length in largest)
    return u, v, w


def open_grid(u: ArrayLike, v: ArrayLike, w: ArrayLike) -> tuple[Array, Array, Array]:
    """Return u, v, w shaped (n,1,1), (1,m,1), (1,1,k) for evaluation on their product grid."""
    a, b, c = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (u, v, w))
    return a[:, None, None], b[None, :, None], c[None, None, :]
