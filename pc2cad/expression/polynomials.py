"""Maps that are polynomials with rational coefficients, in whole numbers.

det J of such a map is a polynomial as well. All are tables of coefficients by powers of u, v and w.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import lcm, prod

from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, ops_of

#: powers of u, v and w to integer coefficients
Polynomial = dict[tuple[int, int, int], int]
#: vectors with integer components by powers of some parameters
Vectors = dict[tuple[int, ...], tuple[int, int, int]]
#: what a polynomial is made of; normal forms say whether it is one
POLYNOMIAL = {"number", "symbol", "add", "neg", "mul", "div", "pow"}
#: products of coefficients beyond which it is quicker to do without them
MOST_PRODUCTS = 300_000


@dataclass(frozen=True)
class Polynomials:
    """A polynomial map times `scale`, so that coefficients are whole; its tangents and det J."""

    map: tuple[Polynomial, ...]
    tangents: list[list[Polynomial]]
    determinant: Polynomial
    scale: int

    def on(self, cell: tuple[int, int, int]) -> Vectors:
        """Return the map on a cell of the box, by powers of the parameters that are free there.

        `cell` has 0 or 2 for a parameter at its lower or upper limit, 1 for a free one.
        """
        free = [d for d in range(3) if cell[d] == 1]
        low = [d for d in range(3) if cell[d] == 0]
        rows: dict[tuple[int, ...], list[int]] = {}
        for axis, f in enumerate(self.map):
            for powers, c in f.items():
                if not any([powers[d] for d in low]):
                    key = tuple([powers[d] for d in free])
                    rows.setdefault(key, [0, 0, 0])[axis] += c
        return {key: (x, y, z) for key, (x, y, z) in rows.items() if x or y or z}


@lru_cache(maxsize=8)
def polynomials(coordinates: tuple[Expr, ...]) -> Polynomials | None:
    """Return a map that is polynomial with rational coefficients as such, or None."""
    if not ops_of(coordinates) <= POLYNOMIAL:
        return None  # functions that would cancel are not worth a long expansion
    tables = [rational_table(tree) for tree in coordinates]
    known = [table for table in tables if table is not None]
    if len(known) < 3 or prod(max(1, len(table)) for table in known) > MOST_PRODUCTS:
        return None
    scale = lcm(*(c.denominator for table in known for c in table.values()))
    scaled = tuple({p: int(c * scale) for p, c in table.items()} for table in known)
    tangents = [[_derivative(f, d) for f in scaled] for d in range(3)]
    determinant = _sum(
        product(f, g) for f, g in zip(tangents[0], cross(*tangents[1:]), strict=True)
    )
    return Polynomials(scaled, tangents, determinant, scale)


def rational_table(tree: Expr) -> dict[tuple[int, int, int], Fraction] | None:
    """Return a tree's coefficients by powers, or None where it is no rational polynomial."""
    form = normal_form(tree, largest=400)
    if form is None:
        return None
    table = {}
    for monomial, coefficient in form.items():
        powers = [0, 0, 0]
        for atom, exponent in monomial:
            if atom.op != "symbol":
                return None
            powers[PARAMETERS.index(atom.payload)] = exponent
        table[(powers[0], powers[1], powers[2])] = coefficient
    return table


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
