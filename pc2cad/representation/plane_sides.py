"""What sides of plane faces are along themselves, from the forms that the planes were found by.

A face's normal form is that of its side as well, the other parameter put in. So most edges of a
channel are seen to be no polynomials, and waves of which order, without trees of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import gcd, sqrt

from pc2cad.arrays import Array
from pc2cad.domain.pieces import piece_at
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.expression.tree import Expr
from pc2cad.geometry.recognition.separable_form import Separation, Term
from pc2cad.geometry.splines.bernstein import degree_in
from pc2cad.representation.parametrisation import FaceDirection

#: vectors that are so many times as long as what is rounding are there in every form
_CLEAR = 1e3


def tell_sides(faces: Sequence[RestrictedMap], edges: Sequence[RestrictedMap]) -> None:
    """Let edges know what the forms of faces say of them along themselves.

    The faces' forms are made here where they are not yet.
    """
    at = {edge.cell: edge for edge in edges}
    for face in faces:
        for axis, (direction, position) in enumerate(face.pieces):
            for end in (0, 1):
                cell = list(face.cell)
                cell[direction] = position + 2 * end - 1
                edge = at.get((cell[0], cell[1], cell[2]))
                # trees at a limit between two pieces are those of one of them
                if edge is not None and _spans(edge) == _spans(face):
                    _tell(edge, face, axis, end)


def _spans(function: RestrictedMap) -> tuple[tuple[float, float], ...]:
    return piece_at(function.cell, function.analysis.bounds)[0]


def _tell(edge: RestrictedMap, face: RestrictedMap, across: int, end: int) -> None:
    """Let an edge know what it is, a side of a face where one of its parameters is 0 or 1."""
    form, along = face.form, 1 - across
    terms = None if form is None else _at_limit(form, across, end)
    if form is None or terms is None:
        return
    if form.axes[along].kind == "wave":
        wave = FaceDirection(face, along).wave
        # of multiples of one order another angle would be found
        if wave is not None and gcd(*(term.order for term in terms)) == 1:
            edge.waves[0] = replace(wave, order=max(term.order for term in terms))
            edge.degrees[0] = None
    elif any(_is_neither(atom) for term in terms for atom, _ in term.factor):
        edge.waves[0] = edge.degrees[0] = None


def _is_neither(atom: Expr) -> bool:
    """Say whether an atom of one parameter is neither a wave nor polynomial, in pieces or not."""
    return atom.op not in ("sin", "cos") and degree_in((atom,), *atom.symbols) is None


def _at_limit(form: Separation, across: int, end: int) -> list[Term] | None:
    """Return the terms of the other axis that are left where one parameter is 0 or 1.

    None where it is not polynomial in that, or a vector might be there or not.
    """
    if form.axes[across].kind != "power":
        return None
    found: dict[Term, Array] = {}
    for key, vector in form.vectors.items():
        if end or key[across].order == 0:
            term = key[1 - across]
            found[term] = found[term] + vector if term in found else vector
    sizes = {term: sqrt(vector.dot(vector)) for term, vector in found.items()}
    if any(0 < size <= _CLEAR * form.rounding for size in sizes.values()):
        return None
    return [term for term, size in sizes.items() if size]
