"""Proof that det J keeps one sign, where the point is a sum of products.

With M = Σ A_k(u) b_k(v, w), det J is Σ det(A_k', A_l, A_m) · b_k (b_l,v b_m,w - b_m,v b_l,w) over
all k and l < m: functions of u times functions of v and w. Each is enclosed in boxes of its own
parameters, by Taylor models, and the sums over all pairs of boxes are products of matrices. Of a
channel, det J is the section's own determinant times |N'| (1 - κ n·q), and these keep their signs
one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.arrays.linear import product
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import UNIT, Place
from pc2cad.domain.map import Mapping3
from pc2cad.expression.breaks import find_breaks
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.normal_form import Monomial, normal_form, tree_of
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.separable_sums import vector_products
from pc2cad.expression.tree import ONE, ZERO, Expr, ops_of, symbol
from pc2cad.solidity.jacobian_proof.determinant import determinant

#: more products than this are left to others
MOST_PRODUCTS = 6
#: terms of a function of one parameter of which powers are taken out
MOST_TERMS = 60
#: boxes per direction, if need be, and the least between two breaks
BOXES = ((32, 1), (128, 4), (256, 16))
#: boxes of w, in which walls are thin, are so many times fewer
FEWER = 8
ORDER = 3
_POLYNOMIAL = frozenset(("number", "symbol", "add", "neg", "mul", "pow"))
#: boxes without a sign that are told
MOST_LEFT = 1000
#: what is looked at next to the ends of each cell first, as a share of it
NEXT = 1e-9


def sign_from_products(mapping: Mapping3, left: list[Array] | None = None) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0.

    Middles of boxes that may hold another sign are added to `left`, (3, n).
    """
    for d, name in enumerate(PARAMETERS):
        products = vector_products(mapping.coordinates, name)
        if products is None or not 2 <= len(products) <= MOST_PRODUCTS:
            continue
        breaks = find_breaks(mapping.coordinates, analytic=True)
        cells = [tuple(b.position for b in row if 0 < b.position < 1) for row in breaks]
        axes = [(d + i) % 3 for i in range(3)]
        names = tuple(PARAMETERS[i] for i in axes)
        terms = _Sum(products, names)
        sign = terms.sign([cells[i] for i in axes])
        if sign:
            return sign
        if left is not None and terms.left is not None:
            left.append(terms.left[np.argsort(axes)])
    return 0


class _Sum:
    """det J as a sum of products: a tree in the first parameter times one in the others each."""

    def __init__(
        self, products: list[tuple[tuple[Expr, ...], Expr]], names: tuple[str, ...]
    ) -> None:
        self._names = names
        vectors = [vector for vector, _ in products]
        factors = tuple(factor for _, factor in products)
        slopes = [derivatives(vector, names[0]) for vector in vectors]
        along, across = (derivatives(factors, name) for name in names[1:])
        minors = {
            (i, j): minor
            for i, j in combinations(range(len(products)), 2)
            if (minor := along[i] * across[j] - along[j] * across[i]) is not ZERO
        }
        #: what all terms share, and what is known to be positive inside taken out of it
        self._common = next(iter(minors.values())) if len(minors) == 1 else ONE
        found: dict[Expr, Expr] = {}
        for (i, j), minor in minors.items():
            for slope, factor in zip(slopes, factors, strict=True):
                first = determinant((slope, vectors[i], vectors[j]))
                second = factor if minor is self._common else factor * minor
                if first is not ZERO:
                    found[first] = found.get(first, ZERO) + second
        firsts = _without_common_power(list(found), names[0])
        self._terms = [
            (first, second)
            for first, second in zip(firsts, found.values(), strict=True)
            if second is not ZERO
        ]
        self._common = _without_powers(self._common, names[1:])
        #: middles of the boxes where the last refinement found no sign, (3, n)
        self.left: Array | None = None

    def sign(self, breaks: list[tuple[float, ...]]) -> int:
        """Return the sign of the sum where it is proved to be one, else 0."""
        if not self._terms:
            return 0
        common = _refined(self._sign_of_common, self._names, breaks)
        return common and common * _refined(self._sign_of_terms, self._names, breaks)

    def _sign_of_common(self, places: list[Place]) -> int:
        middle, off = _enclosed([self._common], self._names[1:], places[1:])
        return _one_sign(middle[0], off[0])

    def _sign_of_terms(self, places: list[Place]) -> int:
        first, *others = places
        a, da = _enclosed([x for x, _ in self._terms], self._names[:1], [first])
        b, db = _enclosed([x for _, x in self._terms], self._names[1:], others)
        with np.errstate(all="ignore"):  # what is not bounded is nan, and of no sign
            size = product(np.abs(a).T, np.abs(b))
            off = (
                product(np.abs(a).T, db)
                + product(da.T, np.abs(b) + db)
                + (len(a) + 4) * UNIT * size
            )
            middle = product(a.T, b)
            sign = _one_sign(middle, off)
        if not sign:
            self._leave(middle, off, places)
        return sign

    def _leave(self, middle: Array, off: Array, places: list[Place]) -> None:
        """Keep the worst boxes: a matrix of values that may have the other sign."""
        known = np.where(np.isfinite(middle) & np.isfinite(off), middle, 0.0)
        sign = 1.0 if known.sum() > 0 else -1.0
        worst = np.argsort((sign * known).ravel(), kind="stable")[:MOST_LEFT]
        index = np.unravel_index(worst, [len(place.centre) for place in places])
        self.left = np.stack([p.centre[i] for p, i in zip(places, index, strict=True)])


def _refined(
    sign_in: Callable[[list[Place]], int], names: tuple[str, ...], breaks: list[tuple[float, ...]]
) -> int:
    """Return the sign that is proved on boxes, more and more of them; 0 where none is."""
    for count, least in BOXES:
        counts = [max(1, count // FEWER) if name == PARAMETERS[2] else count for name in names]
        found = sign_in([_boxes(n, least, b) for n, b in zip(counts, breaks, strict=True)])
        # where it vanishes on a side, no number of boxes is enough
        if found or (least == 1 and not sign_in([_ends(b) for b in breaks])):
            return found
    return 0


def _without_powers(tree: Expr, names: tuple[str, ...]) -> Expr:
    """Return a tree without the powers of parameters that it is a multiple of."""
    for name in names:
        products = vector_products((tree,), name) or []
        if len(products) == 1:
            ((power,), factor) = products[0]
            base = power.args[0] if power.op == "pow" else power
            tree = factor if base.op == "symbol" else tree
    return tree


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


def _boxes(count: int, least: int, breaks: tuple[float, ...]) -> Place:
    """Return equal boxes of [0, 1], cut at the breaks: at least so many between any two."""
    ends = np.array([0.0, *breaks, 1.0])
    inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(least) / least
    points = distinct(np.concatenate((np.linspace(0.0, 1.0, count + 1), inner.ravel())))
    half = np.diff(points) / 2 * (1 + 1e-12) + 2 * UNIT
    return Place((points[1:] + points[:-1]) / 2, half, half)


def _enclosed(
    trees: list[Expr], names: tuple[str, ...], places: list[Place]
) -> tuple[Array, Array]:
    """Return middles and half widths of the trees' ranges, (trees, all boxes)."""
    models = enclose(trees, names, places, ORDER)
    shape = tuple(len(place.centre) for place in places) + (1,) * (2 - len(places))
    middle, reach = (
        np.stack([np.broadcast_to(x, shape).ravel() for x in values])
        for values in ([m.centre for m in models], [m.reach for m in models])
    )
    return middle, reach


def _one_sign(middle: Array, off: Array) -> int:
    """Return the sign that all ranges middle ± off have; 0 where they have none."""
    sign = 1 if middle.flat[0] > 0 else -1
    return sign if bool((sign * middle > off * (1 + 1e-12)).all()) else 0
