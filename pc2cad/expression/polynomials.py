"""Maps that are polynomials with rational coefficients, in whole numbers.

det J of such a map is a polynomial as well. All are tables of coefficients by powers of u, v and w.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from math import gcd, lcm, prod
from typing import Final

from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.recent import Recent
from pc2cad.expression.tree import Expr, ops_of, walk

#: powers of u, v and w to integer coefficients
Polynomial = dict[tuple[int, int, int], int]
#: a polynomial and a whole number that it is over
Fractions = tuple[Polynomial, int]
#: vectors with integer components by powers of some parameters
Vectors = dict[tuple[int, ...], tuple[int, int, int]]
#: what a polynomial is made of; normal forms say whether it is one
POLYNOMIAL = {"number", "symbol", "add", "neg", "mul", "div", "pow"}
#: terms of a coordinate, and whole exponents, beyond which it is not multiplied out
LARGEST, LARGEST_POWER = 400, 64
#: terms of a part of one beyond which it is not remembered, and parts of a short one
MOST_REMEMBERED = 32
#: products of coefficients beyond which it is quicker to do without them
MOST_PRODUCTS = 300_000


@dataclass(frozen=True)
class Polynomials:
    """A polynomial map times `scale`, so that coefficients are whole; its tangents and det J."""

    map: tuple[Polynomial, ...]
    tangents: list[list[Polynomial]]
    determinant: Polynomial
    scale: int

    #: what it is on cells of the box that were asked for
    _cells: dict[tuple[int, ...], Vectors] = field(default_factory=dict, repr=False)

    def on(self, cell: tuple[int, ...]) -> Vectors:
        """Return the map on a cell of the box, by powers of the parameters that are free there.

        `cell` has 0 or 2 for a parameter at its lower or upper limit, 1 for a free one.
        """
        if cell not in self._cells:
            fixed = next((d for d in range(3) if cell[d] != 1), None)
            if fixed is None:
                found = self._vectors()
            else:
                wider = self.on((*cell[:fixed], 1, *cell[fixed + 1 :]))
                # before that one all parameters are free
                found = _at_limit(wider, fixed, cell[fixed] == 2)
            self._cells[cell] = found
        return self._cells[cell]

    def _vectors(self) -> Vectors:
        x, y, z = self.map
        return {key: (x.get(key, 0), y.get(key, 0), z.get(key, 0)) for key in (x | y | z)}


def _at_limit(vectors: Vectors, axis: int, upper: bool) -> Vectors:
    """Return vectors by powers of the other parameters where one of them is 0 or 1."""
    found: Vectors = {}
    for powers, vector in vectors.items():
        if upper or not powers[axis]:
            key = powers[:axis] + powers[axis + 1 :]
            if key in found:
                (a, b, c), (i, j, k) = found[key], vector
                vector = a + i, b + j, c + k
            found[key] = vector
    return {key: vector for key, vector in found.items() if any(vector)}


@lru_cache(maxsize=8)
def polynomials(coordinates: tuple[Expr, ...]) -> Polynomials | None:
    """Return a map that is polynomial with rational coefficients as such, or None."""
    if not ops_of(coordinates) <= POLYNOMIAL:
        return None  # functions that would cancel are not worth a long expansion
    tables = [rational_polynomial(tree) for tree in coordinates]
    known = [table for table in tables if table is not None]
    if len(known) < 3 or prod(max(1, len(f)) for f, _ in known) > MOST_PRODUCTS:
        return None
    scale = lcm(*[below for _, below in known])
    scaled = tuple([{p: c * (scale // below) for p, c in f.items()} for f, below in known])
    tangents = [[_derivative(f, d) for f in scaled] for d in range(3)]
    determinant = _sum(
        product(f, g) for f, g in zip(tangents[0], cross(*tangents[1:]), strict=True)
    )
    return Polynomials(scaled, tangents, determinant, scale)


def rational_polynomial(tree: Expr) -> Fractions | None:
    """Return a tree as a polynomial over a whole number, in lowest terms.

    None where it is no polynomial with rational coefficients, and where it has too many.
    """
    try:
        whole: Fractions | None = _multiplied_out(tree)
    except _NotPlainError:
        whole = _from_normal_form(tree)
    except _TooLargeError:
        return None
    if whole is None:
        return None
    terms, below = whole
    common = gcd(below, *terms.values())
    return {powers: c // common for powers, c in terms.items()}, below // common


def constant_sums(roots: tuple[Expr, ...]) -> set[Expr] | None:
    """Return the sums of parameters that are constants; None of trees that are no polynomials."""
    if not ops_of(roots) <= POLYNOMIAL:
        return None
    parts: dict[Expr, Fractions] = {}
    try:
        for node in walk(roots):
            parts[node] = _part(node, parts)
    except (_NotPlainError, _TooLargeError):
        return None
    sums = [node for node in parts if node.op == "add" and node.symbols]
    return {node for node in sums if not any(map(any, parts[node][0]))}


def constant_of(tree: Expr) -> Fraction | None:
    """Return the number that a tree is by algebra; None where it is none, or no short polynomial.

    What is longer is quicker refuted by samples.
    """
    if not tree.ops <= POLYNOMIAL:
        return None
    parts: dict[Expr, Fractions] = {}
    for node in walk((tree,)):
        high = node.op == "pow" and not (node.args[1].op == "number" and node.args[1].payload <= 3)
        if high or len(parts) >= MOST_REMEMBERED:
            return None
        try:
            parts[node] = _part(node, parts)
        except (_NotPlainError, _TooLargeError):
            return None
        if len(parts[node][0]) > MOST_REMEMBERED:
            return None
    terms, below = parts[tree]
    return None if any(map(any, terms)) else Fraction(terms.get((0, 0, 0), 0), below)


class _NotPlainError(Exception):
    """A tree holds what is no polynomial by itself."""


class _TooLargeError(Exception):
    """A polynomial has too many terms."""


#: what is remembered: variants of a template have most of their trees in common
_known: Final[Recent[Fractions]] = Recent()


def _multiplied_out(tree: Expr) -> Fractions:
    """Return a tree as a polynomial; raise _NotPlainError or _TooLargeError."""
    found: dict[Expr, Fractions] = {}

    def unknown(node: Expr) -> tuple[Expr, ...]:
        known = _known.get(node)
        if known is None:
            return node.args
        found[node] = known
        return ()

    for node in walk((tree,), unknown):
        if node not in found:
            found[node] = _part(node, found)
    return found[tree]


def _part(node: Expr, parts: dict[Expr, Fractions]) -> Fractions:
    """Return a node as a polynomial, given its operands; raise _NotPlainError, _TooLargeError."""
    known = _known.get(node)
    if known is None:
        known = _of_node(node, parts)
        if len(known[0]) <= MOST_REMEMBERED:
            _known.keep(node, known)
    return known


def _of_node(node: Expr, known: dict[Expr, Fractions]) -> Fractions:
    """Return a node as a polynomial over a whole number: one fraction for all terms is quicker."""
    if node.op == "number":
        value = node.payload
        return ({(0, 0, 0): value.numerator} if value else {}), value.denominator
    if node.op == "symbol" and node.payload in PARAMETERS:
        u, v, w = (int(name == node.payload) for name in PARAMETERS)
        return {(u, v, w): 1}, 1
    if node.op not in ("neg", "add", "mul", "pow"):
        raise _NotPlainError
    first, below = known[node.args[0]]
    if node.op == "neg":
        return {powers: -c for powers, c in first.items()}, below
    if node.op == "add":
        second, other = known[node.args[1]]
        common = lcm(below, other)
        result = {powers: c * (common // below) for powers, c in first.items()}
        for powers, c in second.items():
            _put(result, powers, c * (common // other))
        return _checked(result), common
    if node.op == "mul":
        second, other = known[node.args[1]]
        return _times(first, second), below * other
    if node.args[1].op != "number":
        raise _NotPlainError
    exponent = node.args[1].payload
    if not 0 < exponent <= LARGEST_POWER or exponent.denominator != 1:
        raise _NotPlainError
    result = first
    for _ in range(int(exponent) - 1):
        result = _times(result, first)
    return result, below ** int(exponent)


def _put(f: Polynomial, powers: tuple[int, int, int], c: int) -> None:
    total = f.get(powers, 0) + c
    if total:
        f[powers] = total
    else:
        f.pop(powers, None)


def _checked(f: Polynomial) -> Polynomial:
    if len(f) > LARGEST:
        raise _TooLargeError
    return f


def _times(f: Polynomial, g: Polynomial) -> Polynomial:
    """Return f·g without terms that cancel; raise _TooLargeError."""
    if len(f) * len(g) > 20 * LARGEST:
        raise _TooLargeError
    if len(g) == 1 or len(f) == 1:  # nothing meets, and most factors are numbers and parameters
        long, ((one, factor),) = (f, g.items()) if len(g) == 1 else (g, f.items())
        x, y, z = one
        return _checked({(a + x, b + y, c + z): p * factor for (a, b, c), p in long.items()})
    result: Polynomial = {}
    for (a, b, c), p in f.items():
        for (i, j, k), q in g.items():
            _put(result, (a + i, b + j, c + k), p * q)
    return _checked(result)


def _from_normal_form(tree: Expr) -> Fractions | None:
    """Return what a tree is if all that is no polynomial cancels."""
    form = normal_form(tree, LARGEST)
    if form is None:
        return None
    below = lcm(*[c.denominator for c in form.values()])
    terms: Polynomial = {}
    for monomial, coefficient in form.items():
        powers = [0, 0, 0]
        for atom, exponent in monomial:
            if atom.op != "symbol" or atom.payload not in PARAMETERS:
                return None
            powers[PARAMETERS.index(atom.payload)] = exponent
        terms[powers[0], powers[1], powers[2]] = int(coefficient * below)
    return terms, below


def _derivative(f: Polynomial, direction: int) -> Polynomial:
    result: Polynomial = {}
    for powers, c in f.items():
        if powers[direction]:
            lower = list(powers)
            lower[direction] -= 1
            result[(lower[0], lower[1], lower[2])] = c * powers[direction]
    return result


def product(f: Polynomial, g: Polynomial) -> Polynomial:
    """Return f·g."""
    result: Polynomial = {}
    for (a, b, c), p in f.items():
        for (i, j, k), q in g.items():
            powers = (a + i, b + j, c + k)
            result[powers] = result.get(powers, 0) + p * q
    return result


def _sum(terms: Iterable[Polynomial], sign: int = 1) -> Polynomial:
    result: Polynomial = {}
    factor = 1
    for term in terms:
        for powers, c in term.items():
            result[powers] = result.get(powers, 0) + factor * c
        factor *= sign
    return result


def cross(a: list[Polynomial], b: list[Polynomial]) -> list[Polynomial]:
    """Return the vector product."""
    return [
        _sum((product(a[i], b[j]), product(a[j], b[i])), sign=-1)
        for i, j in ((1, 2), (2, 0), (0, 1))
    ]
