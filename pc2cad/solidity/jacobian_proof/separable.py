"""Proof that det J keeps one sign, where the point is a sum of products.

With M = Σ A_k(u) b_k(v, w), det J is Σ det(A_k', A_l, A_m) · b_k (b_l,v b_m,w - b_m,v b_l,w) over
all k and l < m: functions of u times functions of v and w. Each is enclosed in boxes of its own
parameters, by Taylor models, and the sums over all pairs of boxes are products of matrices. Of a
channel, det J is the section's own determinant times |N'| (1 - κ n·q), and these keep their signs
one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np

from pc2cad.arrays import Array, Booleans
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.bounds.known import Known, Models
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import UNIT, Place
from pc2cad.domain.map import Mapping3
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.normal_form import Monomial, normal_form, tree_of
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.rewriting import has_more
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.separable_sums import vector_products
from pc2cad.expression.tree import ONE, ZERO, Expr, ops_of, symbol
from pc2cad.solidity.jacobian_proof.triple_models import Ranges, ranges_of_triples
from pc2cad.solidity.jacobian_proof.triples import MOST_NODES, Products, minor, scaled, triple

#: boxes of two parameters
_Boxes = tuple[Place, Place]

#: more products than this are left to others
MOST_PRODUCTS = 6
#: terms of a function of one parameter of which powers are taken out
MOST_TERMS = 60
#: boxes of the first parameter, if need be, and the least between two breaks; those of the others
#: begin with as many, and are halved both ways where they have no sign
BOXES = ((32, 1), (128, 4), (256, 16), (256, 16), (256, 16))
#: how many times the first boxes of the others may be looked at in all: as often as if all of them
#: were halved three times
MOST_LOOKS = 1 + 4 + 16 + 64
#: boxes of two parameters whose models are held at once
MOST_BOXES = 2048
#: boxes of w, in which walls are thin, are so many times fewer
FEWER = 8
ORDER = 3
_POLYNOMIAL = frozenset(("number", "symbol", "add", "neg", "mul", "pow"))
#: boxes without a sign that are told
MOST_LEFT = 1000
#: what is looked at next to the ends of each cell first, as a share of it
NEXT = 1e-9


def sign_from_products(
    mapping: Mapping3, left: list[Array] | None = None, models: list[Models] | None = None
) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0.

    Middles of boxes that may hold another sign are added to `left`, (3, n). Where there is a sign,
    models of trees on boxes that fill the box are added to `models`.
    """
    for d, name in enumerate(PARAMETERS):
        products = vector_products(mapping.coordinates, name)
        if products is None or not 2 <= len(products) <= MOST_PRODUCTS:
            continue
        breaks = find_breaks(mapping.coordinates, analytic=True)
        cells = [tuple(b.position for b in row if 0 < b.position < 1) for row in breaks]
        axes = [(d + i) % 3 for i in range(3)]
        names = tuple(PARAMETERS[i] for i in axes)
        terms = _Sum(products, names, Known())
        sign = terms.sign([cells[i] for i in axes])
        if sign:
            if models is not None:
                models += terms.models
            return sign
        if left is not None and terms.left is not None:
            left.append(terms.left[np.argsort(axes)])
    return 0


class _Sum:
    """det J as a sum of products: a tree in the first parameter times one in the others each."""

    def __init__(self, products: Products, names: tuple[str, ...], known: Known) -> None:
        self._names, self._known = names, known
        self._rows = rows = scaled(products, names[0])
        factors = tuple([row.factor for row in rows])
        minors = {
            (i, j): found
            for i, j in combinations(range(len(rows)), 2)
            if (found := minor(factors[i], factors[j], names[1:])) is not ZERO
        }
        #: what all terms share, and what is known to be positive inside taken out of it
        common = next(iter(minors.values())) if len(minors) == 1 else ONE
        self._common = _without_powers(common, names[1:])
        #: det(A_k', A_i, A_j) by k, i and j, and their factors in the other parameters
        self._triples = {
            (k, i, j): factor if of_pair is common else factor * of_pair
            for (i, j), of_pair in minors.items()
            for k, factor in enumerate(factors)
        }
        #: models of what was asked for, on boxes that fill the box
        self.models: list[Models] = []
        #: middles of the boxes where the last refinement found no sign, (3, n)
        self.left: Array | None = None

    @cached_property
    def _terms(self) -> list[tuple[Expr, Expr]]:
        terms: dict[Expr, Expr] = {}
        for (k, i, j), second in self._triples.items():
            first = triple(self._rows, k, i, j, self._names[0])
            if first is not ZERO:
                terms[first] = terms.get(first, ZERO) + second
        firsts = _without_common_power(list(terms), self._names[0])
        return [
            (first, second)
            for first, second in zip(firsts, terms.values(), strict=True)
            if second is not ZERO
        ]

    def sign(self, breaks: list[tuple[float, ...]]) -> int:
        """Return the sign of the sum where it is proved to be one, else 0."""
        levels = _levels(self._names, breaks)
        sign = self._sign_of_vectors(levels)
        if sign or not self._terms:
            return sign
        common, _ = _refined(self._common_in, levels, breaks)
        if not common:
            return 0
        sign, last = _refined(self._terms_in, levels, breaks)
        if not sign:
            self._leave(*last)
        first, second, third = (row[0] for row in levels)
        self.models = [
            self._known.at(self._names[:1], (first,), ORDER),
            self._known.at(self._names[1:], _grid(second, third), ORDER),
        ]
        return common * sign

    def _sign_of_vectors(self, levels: list[list[Place]]) -> int:
        """Return the sign where models of long vectors show it on the first boxes, else 0.

        The same as from the terms, without their trees: these can become shorter than the vectors.
        """
        rows = self._rows
        if not self._triples or not all(
            any(has_more(x, MOST_NODES) for x in (*rows[i].vector, *rows[j].vector))
            for _, i, j in self._triples
        ):
            return 0
        (first, *_), *of_others = levels
        others = _grid(of_others[0][0], of_others[1][0])
        trees = [self._common, *self._triples.values()]
        b, db = _enclosed(trees, self._names[1:], others, self._known)
        common, bad, _ = _signs(b[:1], db[:1], 0)
        if bad.any():
            return 0
        triples = list(self._triples)
        a, da, models = ranges_of_triples(rows, triples, self._names[0], first, self._known)
        self.models = [models, self._known.at(self._names[1:], others, ORDER)]
        sign, bad, _ = _signs(*_summed(a, da, b[1:], db[1:]), 0)
        return 0 if bad.any() else common * sign

    def _common_in(self, first: Place, others: _Boxes) -> Ranges:
        """Return the common factor in boxes of the others: middles and half widths, (1, boxes)."""
        return _enclosed([self._common], self._names[1:], others, self._known)

    def _terms_in(self, first: Place, others: _Boxes) -> Ranges:
        """Return the same of the sum of the terms, (boxes of the first, those of the others)."""
        a, da = _enclosed([x for x, _ in self._terms], self._names[:1], (first,), self._known)
        b, db = _enclosed([x for _, x in self._terms], self._names[1:], others, self._known)
        return _summed(a, da, b, db)

    def _leave(self, first: Place, others: _Boxes, ranges: Ranges) -> None:
        """Keep the worst boxes: those whose values may have the other sign."""
        middle, off = ranges
        known = np.where(np.isfinite(middle) & np.isfinite(off), middle, 0.0)
        sign = 1.0 if known.sum() > 0 else -1.0
        worst = np.argsort((sign * known).ravel(), kind="stable")[:MOST_LEFT]
        row, column = np.unravel_index(worst, middle.shape)
        pairs = np.broadcast_arrays(*(place.centre for place in others))
        self.left = np.stack([first.centre[row], *(x.ravel()[column] for x in pairs)])


def _summed(a: Array, da: Array, b: Array, db: Array) -> Ranges:
    """Return the ranges of the sums of products of a ± da, (terms, n), and b ± db, (terms, m)."""
    with np.errstate(all="ignore"):  # what is not bounded is nan, and of no sign
        size = product(np.abs(a).T, np.abs(b))
        off = product(np.abs(a).T, db) + product(da.T, np.abs(b) + db) + (len(a) + 4) * UNIT * size
        return product(a.T, b), off


def _levels(names: tuple[str, ...], breaks: list[tuple[float, ...]]) -> list[list[Place]]:
    """Return the boxes of each parameter, from coarse to fine."""
    rows = [
        [
            _boxes(max(1, count // (FEWER if name == PARAMETERS[2] else 1)), least, b)
            for count, least in BOXES
        ]
        for name, b in zip(names, breaks, strict=True)
    ]
    if any(breaks):
        # where breaks cut them anyway, half as many may do
        for name, b, row in zip(names, breaks, rows, strict=True):
            count = BOXES[0][0] // (FEWER if name == PARAMETERS[2] else 1)
            row.insert(0, _boxes(max(1, count // 2), 1, b) if b else row[0])
    return rows


def _refined(
    ranges_in: Callable[[Place, _Boxes], Ranges],
    rows: list[list[Place]],
    breaks: list[tuple[float, ...]],
) -> tuple[int, tuple[Place, _Boxes, Ranges]]:
    """Return the sign that is proved on boxes, smaller ones where it is not at once; 0 for none.

    With it come the boxes that were looked at last, and their ranges.
    """
    # the first boxes without breaks
    k = len(rows[0]) - len(BOXES)
    room, sign = MOST_LOOKS * rows[1][k].centre.size * rows[2][k].centre.size, 0
    others = _grid(rows[1][0], rows[2][0])
    for depth, first in enumerate(rows[0]):
        middle, off = ranges_in(first, others)
        sign, bad, both = _signs(middle, off, sign)
        last = first, others, (middle, off)
        if not bad.any():
            return sign, last
        if depth == 0:
            # where it vanishes on a side, no number of boxes is enough
            ends = _ends(breaks[0]), _grid(*map(_ends, breaks[1:]))
            ranges = ranges_in(*ends)
            if _signs(*ranges, 0)[1].any():
                return 0, (*ends, ranges)
        room -= len(bad)
        if both or 4 * np.count_nonzero(bad) > room:
            break
        others = _halves(others, bad)
    return 0, last


def _signs(middle: Array, off: Array, sign: int) -> tuple[int, Booleans, bool]:
    """Return a sign, in which columns not all ranges middle ± off have it, and if any has another.

    It is the given one; where that is 0, that of more ranges.
    """
    above, below = (x > off * (1 + 1e-12) for x in (middle, -middle))
    sign = sign or (1 if np.count_nonzero(above) >= np.count_nonzero(below) else -1)
    own, other = (above, below) if sign > 0 else (below, above)
    return sign, np.asarray(~own.all(axis=0)), bool(other.any())


def _without_powers(tree: Expr, names: tuple[str, ...]) -> Expr:
    """Return a tree without the powers of parameters that it is a multiple of."""
    for name in names:
        if not _may_vanish(tree, name):
            continue
        products = vector_products((tree,), name) or []
        if len(products) == 1:
            ((power,), factor) = products[0]
            base = power.args[0] if power.op == "pow" else power
            tree = factor if base.op == "symbol" else tree
    return tree


def _may_vanish(tree: Expr, name: str) -> bool:
    """Say whether a place leaves it open that a tree vanishes where a parameter does."""
    rest = dict.fromkeys(tree.symbols, 0.371)
    at, away = evaluate(tree, {**rest, name: 0.0}), evaluate(tree, rest)
    return name in tree.symbols and not abs(at) > 1e-6 * abs(away)


def _without_common_power(trees: list[Expr], name: str) -> list[Expr]:
    """Return polynomials without the power of a parameter that all are multiples of."""
    if not ops_of(trees) <= _POLYNOMIAL:
        return trees
    forms = [normal_form(tree, MOST_TERMS) for tree in trees]
    known = [form for form in forms if form is not None]
    parameter = symbol(name)
    shared = min((dict(m).get(parameter, 0) for form in known for m in form), default=0)
    if not shared or len(known) < len(forms):
        return trees
    return [tree_of({_over(m, parameter, shared): c for m, c in form.items()}) for form in known]


def _over(monomial: Monomial, atom: Expr, exponent: int) -> Monomial:
    powers = dict(monomial)
    powers[atom] -= exponent
    return tuple((a, n) for a, n in powers.items() if n)


def _ends(breaks: tuple[float, ...]) -> Place:
    """Return tiny boxes at both ends of each cell between the breaks, inside it."""
    points = np.array([0.0, *breaks, 1.0])
    half = np.repeat(np.diff(points) * NEXT, 2)
    centre = np.repeat(points, 2)[1:-1] + half * np.tile([1.0, -1.0], len(points) - 1)
    return Place(centre, half, half)


@lru_cache(maxsize=64)  # without breaks, those of all parts are alike
def _boxes(count: int, least: int, breaks: tuple[float, ...]) -> Place:
    """Return equal boxes of [0, 1], cut at the breaks: at least so many between any two."""
    ends = np.array([0.0, *breaks, 1.0])
    inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(least) / least
    points = distinct(np.concatenate((np.linspace(0.0, 1.0, count + 1), inner.ravel())))
    half = np.diff(points) / 2 * (1 + 1e-12) + 2 * UNIT
    return Place((points[1:] + points[:-1]) / 2, half, half)


def _grid(second: Place, third: Place) -> _Boxes:
    """Return all pairs of boxes of two parameters."""
    return second.spread(0), third.spread(1)


def _halves(others: _Boxes, chosen: Booleans) -> _Boxes:
    """Return some of the pairs of boxes, halved in both parameters, (pairs, 1)."""
    shape = np.broadcast_shapes(*(place.centre.shape for place in others))
    found = []
    for place, sides in zip(others, ((-1, -1, 1, 1), (-1, 1, -1, 1)), strict=True):
        centre, half = (
            np.broadcast_to(x, shape).ravel()[chosen] for x in (place.centre, place.half)
        )
        centre = np.add.outer(centre, np.zeros(4)) + np.multiply.outer(half / 2, sides)
        half = np.repeat(half / 2 * (1 + 1e-12) + 2 * UNIT, 4)[:, None]
        found.append(Place(centre.reshape(-1, 1), half, half))
    return found[0], found[1]


def _enclosed(
    trees: list[Expr],
    names: tuple[str, ...],
    places: tuple[Place, ...],
    known: Known | None = None,
) -> Ranges:
    """Return middles and half widths of the trees' ranges, (trees, all boxes)."""
    count = len(places[0].centre)
    if len(places) > 1 and places[1].centre.shape == (count, 1) and count > MOST_BOXES:
        starts = range(0, count, MOST_BOXES)
        slices = (slice(start, start + MOST_BOXES) for start in starts)
        parts = [_enclosed(trees, names, tuple(p.part(x) for p in places)) for x in slices]
        middle, reach = (np.concatenate(rows, axis=1) for rows in zip(*parts, strict=True))
        return middle, reach
    models = enclose(trees, names, places, ORDER, known)
    shape = np.broadcast_shapes(*(p.spread(axis).centre.shape for axis, p in enumerate(places)))
    found = np.empty((2, len(models), *shape))
    for i, model in enumerate(models):
        found[0, i], found[1, i] = model.centre, model.reach
    middle, reach = found.reshape(2, len(models), -1)
    return middle, reach
