"""How a point of a face depends on each of its parameters: sums of products of one-parameter terms.

The normal form of a coordinate is a sum of monomials. Where no atom of it depends on two parameters
at once, every monomial is a product of functions of one parameter each, and the point is a sum of
such products times constant vectors. Along each axis these functions are powers of the parameter,
or waves cos kθ and sin kθ of one angle θ, or else whatever the equation holds. The split is exact;
only the vectors are rounded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod, sqrt
from typing import Final, Literal, NamedTuple

import numpy as np

from pc2cad.arrays import Array
from pc2cad.expression.angle_multiples import common_unit, ratio
from pc2cad.expression.evaluation import Program
from pc2cad.expression.magnitudes import bound, extent, rounding
from pc2cad.expression.normal_form import Monomial, NormalForm, Raw, normal_form
from pc2cad.expression.polynomials import Vectors
from pc2cad.expression.recent import Holding
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import ONE, ZERO, Expr, number, power
from pc2cad.geometry.recognition.sines_of_sums import are_plain, parted

#: normal forms of a coordinate that are larger are not looked at
LARGEST_FORM = 400
#: nodes whose normal forms are remembered
_MOST_KNOWN: Final = 512
#: waves of a higher order than this are no rational carrier any more
LARGEST_ORDER = 12


class Term(NamedTuple):
    """A function of one parameter: a power of it, a wave of its angle, or some other product.

    Its size is 1 at most over [0, 1]: other products are divided by a proved bound of theirs.
    """

    kind: Literal["power", "cos", "sin", "other"]
    order: int = 0
    factor: Monomial = ()
    most: float = 1.0


CONSTANT: Final = Term("power")


@dataclass(frozen=True)
class Axis:
    """One parameter of a cell and the kind of functions in which the point depends on it."""

    name: str
    kind: Literal["power", "wave", "other"]
    #: of waves: the angle θ as a tree without constant part, in radians
    angle: Expr = ZERO

    def turn(self, multiple: int, t: Array) -> Array:
        """Return a multiple of the angle θ at parameters t."""
        values = _angles(self.angle)({self.name: t})[0]
        return np.asarray(multiple * np.broadcast_to(values, np.shape(t)))

    def values(self, term: Term, t: Array) -> Array:
        """Return a term's values at parameters t."""
        if term.kind == "other":
            tree = ONE
            for atom, exponent in term.factor:
                tree = tree * power(atom, number(exponent))
            values = Program((tree,))({self.name: t})[0] / term.most
            return np.asarray(np.broadcast_to(values, np.shape(t)))
        if term.kind == "power":
            return np.asarray(np.asarray(t, dtype=float) ** term.order)
        wave = np.cos if term.kind == "cos" else np.sin
        return np.asarray(wave(self.turn(term.order, t)))

    @property
    def extent(self) -> float | None:
        """How far a wave turns over [0, 1] where its angle is a multiple of the parameter."""
        return _extent(self)


@lru_cache(maxsize=64)  # all cells of a channel turn by the same angle
def _extent(axis: Axis) -> float | None:
    form = normal_form(axis.angle, largest=12)
    if form is None:
        return None
    free = [[(a, e) for a, e in monomial if a.symbols] for monomial in form]
    if not all(len(f) == 1 and f[0][1] == 1 and f[0][0].op == "symbol" for f in free):
        return None
    first, last = axis.turn(1, np.array([0.0, 1.0])).tolist()
    return float(abs(last - first))


@dataclass(frozen=True, eq=False)
class Separation:
    """A point as Σ vector · product of one term per axis; terms of no size are left out.

    Terms are at most 1 in size, so that relations between vectors are relations between points.
    """

    axes: tuple[Axis, ...]
    vectors: Mapping[tuple[Term, ...], Array]
    #: vectors that are shorter are rounding
    rounding: float

    @property
    def centre(self) -> Array:
        """The vector that does not vary."""
        return np.asarray(self.vectors.get((CONSTANT,) * len(self.axes), np.zeros(3)))

    def terms(self, axis: int) -> list[Term]:
        """Return the different terms along one axis."""
        return list(dict.fromkeys(key[axis] for key in self.vectors))

    def order(self, axis: int) -> int:
        """Return the highest power or wave along an axis."""
        return max((term.order for term in self.terms(axis)), default=0)


@lru_cache(maxsize=64)
def _angles(angle: Expr) -> Program:
    """Return the program of an angle: cells side by side often turn alike."""
    return Program((angle,))


def separate(
    roots: Sequence[Expr], names: Sequence[str], seen: float | None = None
) -> Separation | None:
    """Return the trees as a sum of products of functions of one parameter each, or None.

    `seen` is how far apart points are that were seen, where somebody has looked at some.
    """
    forms = _forms(tuple(roots))
    if forms is None:
        return None
    axes = tuple([_axis(tuple(roots), name) for name in names])
    vectors: dict[tuple[Term, ...], Array] = {}
    for column, form in enumerate(forms):
        for monomial, coefficient in form.items():
            for terms, value in _products(monomial, float(coefficient), axes):
                vectors.setdefault(terms, np.zeros(len(forms)))[column] += value
    return _separation(axes, vectors, lambda: extent(roots, names) if seen is None else seen)


def of_polynomial(
    vectors: Vectors, scale: int, names: Sequence[str], seen: float
) -> Separation | None:
    """Return what `separate` does of a polynomial map, whose vectors are given times `scale`."""
    return _separation(
        tuple([Axis(name, "power") for name in names]),
        {
            tuple([_power(n) for n in powers]): np.array([x / scale for x in vector])
            for powers, vector in vectors.items()
        },
        lambda: seen,
    )


@lru_cache(maxsize=64)
def _power(order: int) -> Term:
    return Term("power", order)


def _separation(
    axes: tuple[Axis, ...], vectors: dict[tuple[Term, ...], Array], spread: Callable[[], float]
) -> Separation | None:
    """Return a point as a sum of vectors times terms without those of no size, None for no bound.

    `spread` says how far apart points are that were seen.
    """
    sizes = {key: sqrt(v.dot(v)) for key, v in vectors.items() if _moves(key)}
    if not np.isfinite(list(sizes.values())).all():
        return None  # of what has no bound nothing is rounding
    slack = rounding(spread(), max(sizes.values(), default=0.0))
    left = 0.0
    for key, size in sorted(sizes.items(), key=lambda item: item[1]):
        left += size
        if left > slack:
            break
        del vectors[key]
    return Separation(axes, vectors, slack)


def is_wave(roots: Sequence[Expr], name: str) -> bool:
    """Say whether `separate` finds waves along a parameter: it takes more to know of which size."""
    trees = tuple(roots)
    return _forms(trees) is not None and _axis(trees, name).kind == "wave"


@lru_cache(maxsize=64)
def _forms(roots: tuple[Expr, ...]) -> list[NormalForm] | None:
    """Return the normal forms of trees where these are sums of products of one-parameter atoms."""
    if _sums.of(tuple(filter(_is_mixed, roots))):
        forms = _forms_of(roots)
        # forms are sums of products of atoms: there is no sine of a sum but in one of these
        if forms is not None and are_plain({atom for f in forms for m in f for atom, _ in m}):
            return forms
    trees = tuple([parted(root) for root in roots])
    return _forms_of(trees) if _sums.of(tuple(filter(_is_mixed, trees))) else None


def _forms_of(trees: tuple[Expr, ...]) -> list[NormalForm] | None:
    forms = []
    for root in trees:
        form = _form(root)
        if form is None or any(len(atom.symbols) > 1 for m in form for atom, _ in m):
            return None
        forms.append(form)
    return forms


@lru_cache(maxsize=1024)
def _form(root: Expr) -> NormalForm | None:
    """Return the normal form of a coordinate: cells side by side often have one in common.

    Coordinates of a cell, and of both its limits, have most of their nodes in common.
    """
    known = _known()
    form = normal_form(root, LARGEST_FORM, _is_constant, known)
    if len(known) > _MOST_KNOWN:
        _known.cache_clear()
    return form


@lru_cache(maxsize=1)
def _known() -> dict[Expr, Raw]:
    """Return the normal forms of nodes that are remembered."""
    return {}


def _moves(key: tuple[Term, ...]) -> bool:
    return any(term != CONSTANT for term in key)


def is_planar(roots: Sequence[Expr], names: Sequence[str]) -> bool:
    """Say whether a point is proved to stay in a plane, to rounding, whatever its functions are.

    Its normal form is a sum of vectors times functions, which may depend on several parameters at
    once. The vectors, times bounds of their functions, are of rank 2 at most.
    """
    rows: dict[Monomial, Array] = {}
    for column, root in enumerate(roots):
        form = normal_form(root, LARGEST_FORM)
        if form is None:
            return False
        for monomial, coefficient in form.items():
            value = float(coefficient) * _constants(monomial)
            moving = tuple((atom, e) for atom, e in monomial if atom.symbols)
            if moving:
                rows.setdefault(moving, np.zeros(len(roots)))[column] += value
    if not rows:
        return True
    most = np.array([bound(monomial) for monomial in rows])
    if not np.isfinite(most).all():
        return False
    vectors = np.array(list(rows.values())) * most[:, None]
    if not np.isfinite(vectors).all():
        return False
    sizes = np.linalg.norm(vectors, axis=1)
    across = np.linalg.svd(vectors, compute_uv=False)[2:]
    return bool(across.max(initial=0.0) <= rounding(extent(roots, names), float(sizes.max())))


@lru_cache(maxsize=4096)
def _constants(monomial: Monomial) -> float:
    """Return the value of a monomial's atoms without symbols."""
    return prod([evaluate(a, {}) ** e for a, e in monomial if not a.symbols], start=1.0)


def _is_constant(node: Expr) -> bool:
    """Say whether a tree is a constant to be worked out: only its value counts."""
    return not node.symbols and node.op != "number"


def _is_mixed(node: Expr) -> bool:
    return len(node.symbols) > 1


def _is_sum_of_products(node: Expr) -> bool:
    if node.op == "div":
        return len(node.args[1].symbols) <= 1
    whole = node.op == "pow" and node.args[1].op == "number" and node.args[1].payload > 0
    return node.op in ("add", "neg", "mul") or (whole and node.args[1].payload.denominator == 1)


#: nodes whose parts in several parameters are sums of products
_sums: Final = Holding(_is_sum_of_products, lambda node: tuple(filter(_is_mixed, node.args)))


# -- the kind of an axis ---------------------------------------------------------------------------


@lru_cache(maxsize=256)
def _axis(roots: tuple[Expr, ...], name: str) -> Axis:
    """Return the kind of an axis of trees that have forms."""
    forms = _forms(roots) or ()
    # a dictionary, not a set: which argument is the first must not depend on addresses
    atoms = {atom: None for form in forms for m in form for atom, _ in m if name in atom.symbols}
    if all(atom.op == "symbol" for atom in atoms):
        return Axis(name, "power")
    if all(atom.op in ("sin", "cos") for atom in atoms):
        angle = common_unit([atom.args[0] for atom in atoms], LARGEST_ORDER)
        if angle is not None:
            return Axis(name, "wave", angle)
    return Axis(name, "other")


# -- monomials as products of terms ----------------------------------------------------------------


def _products(
    monomial: Monomial, value: float, axes: tuple[Axis, ...]
) -> list[tuple[tuple[Term, ...], float]]:
    result: list[tuple[tuple[Term, ...], float]] = [((), value * _constants(monomial))]
    for axis in axes:
        factor = tuple([(a, e) for a, e in monomial if axis.name in a.symbols])
        along = _terms(factor, axis)
        result = [((*terms, t), v * w) for terms, v in result for t, w in along]
    return result


@lru_cache(maxsize=256)
def _terms(factor: Monomial, axis: Axis) -> list[tuple[Term, float]]:
    """Return a function of one parameter as a sum of terms: cells side by side share many."""
    if not factor:
        return [(CONSTANT, 1.0)]
    if axis.kind == "power":
        return [(Term("power", sum(e for _, e in factor)), 1.0)]
    if axis.kind == "other":
        most = bound(factor)
        return [(Term("other", 0, factor, most), most)]
    return _waves(factor, axis)


def _waves(factor: Monomial, axis: Axis) -> list[tuple[Term, float]]:
    """Return a product of sines and cosines as a sum of waves, by complex exponentials."""
    spectrum: dict[int, complex] = {0: 1.0}
    for atom, exponent in factor:
        multiple = ratio(atom.args[0], axis.angle)
        k = int(multiple) if multiple is not None else 0
        pair = {k: 0.5, -k: 0.5} if atom.op == "cos" else {k: -0.5j, -k: 0.5j}
        for _ in range(exponent):
            product: dict[int, complex] = {}
            for i, a in spectrum.items():
                for j, b in pair.items():
                    product[i + j] = product.get(i + j, 0.0) + a * b
            spectrum = product
    result: list[tuple[Term, float]] = [(CONSTANT, spectrum.get(0, 0.0).real)]
    for k in sorted(k for k in spectrum if k > 0):
        result += [(Term("cos", k), 2 * spectrum[k].real), (Term("sin", k), -2 * spectrum[k].imag)]
    return [(term, v) for term, v in result if v]
