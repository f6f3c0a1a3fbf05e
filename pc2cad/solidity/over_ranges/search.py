"""Proofs over ranges of parameters: boxes are halved until each is proved, or the effort ends.

A box is asked by algebra first: the normal form of det J, in which the parameters are variables
that run from limit to limit. Then by enclosures. The largest box is halved next, along the
parameter with which det J changes most; one in which folds are seen everywhere is left open.
Boxes that have a sign are asked for their boundary, and halved along what leaves a question open.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from itertools import count
from typing import Final, Generic, TypeVar

import numpy as np

from pc2cad.domain.family_sides import FamilySides, OpenQuestionError
from pc2cad.equation.family import Family
from pc2cad.errors import InputError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.exact import exact
from pc2cad.expression.intervals import Interval, enclosed_range
from pc2cad.expression.normal_form import NormalForm, normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import Expr, Number, walk
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.factors import Spans, sign_of_form
from pc2cad.solidity.over_ranges.boxes import ProvedBox, RangeProof, halves, joined, volume
from pc2cad.solidity.over_ranges.enclosed import Enclosed
from pc2cad.solidity.over_ranges.margins import Margins
from pc2cad.topology.complex import BoundaryComplex

#: operations at which what is left stays open, about a second: those on intervals, and what a look
#: by algebra and samples comes to, at least and for each node that is sampled and each coefficient,
#: and one at the sides; operations on intervals for one box
MOST_OPERATIONS: Final = 1e8
A_LOOK: Final = 1e5
A_NODE: Final = 500
A_COEFFICIENT: Final = 50
SIDES: Final = 5e5
PER_LOOK: Final = 1e7
#: share of the ranges below which a box is not halved any more
SMALLEST: Final = Fraction(1, 2**12)
#: terms of det J, and its Bernstein coefficients
MOST_TERMS: Final = 400
MOST_COEFFICIENTS: Final = 5000

_Answer = TypeVar("_Answer")
#: an answer, or none and the parameter to halve; and what it took
_Look = tuple[_Answer | None, str, float]


def prove_over(
    family: Family, ranges: Mapping[str, tuple[Number, Number]], effort: float = 1.0
) -> RangeProof:
    """Return for which values of a family's free parameters det J is proved to keep its sign.

    `ranges` has lower and upper limit of each, both included; `effort` multiplies what may be
    spent. Raises InputError for ranges that are not those of the free parameters.
    """
    whole = read_spans(family, ranges)
    question = Question(family, whole, effort)
    signs = _Halving([whole], whole, question.sign, effort)
    boxes: list[ProvedBox] = []
    looks, spent = signs.looks, signs.spent
    for sign, found in signs.answers.items():
        sides = _Halving(joined(found), whole, question.boundary, effort / 4)
        looks, spent = looks + sides.looks, spent + sides.spent
        for boundary, alike in [*sides.answers.items(), (None, sides.left)]:
            boxes += [ProvedBox(spans, sign, boundary) for spans in joined(alike)]
    left = tuple(joined(signs.left))
    return RangeProof(family.name, whole, family.fixed, tuple(boxes), left, looks, spent)


class _Halving(Generic[_Answer]):
    """Boxes by what is answered about them, the largest asked first; and what is left of them."""

    def __init__(
        self,
        boxes: list[Spans],
        whole: Spans,
        ask: Callable[[Spans], _Look[_Answer]],
        effort: float,
    ) -> None:
        self.answers: dict[_Answer, list[Spans]] = {}
        self.left: list[Spans] = []
        self.looks, self.spent = 0, 0.0
        heap = [(-volume(spans, whole), k, spans) for k, spans in enumerate(boxes)]
        heapq.heapify(heap)
        order = count(len(heap))
        while heap and self.spent < MOST_OPERATIONS * effort:
            share, _, spans = heapq.heappop(heap)
            answer, worst, spent = ask(spans)
            self.looks, self.spent = self.looks + 1, self.spent + spent
            if answer is not None:
                self.answers.setdefault(answer, []).append(spans)
            elif not worst or -share < SMALLEST:
                self.left.append(spans)
            else:
                for half in halves(spans, worst):
                    heapq.heappush(heap, (-volume(half, whole), next(order), half))
        self.left += [spans for _, _, spans in heap]


def read_spans(family: Family, ranges: Mapping[str, tuple[Number, Number]]) -> Spans:
    """Return ranges as exact limits, in the family's order; raise InputError."""
    if not family.names or ranges.keys() != set(family.names):
        raise InputError(
            f"the ranges are those of {', '.join(ranges) or 'nothing'}; the free parameters of "
            f"{family.name} are {', '.join(family.names) or 'none'}"
        )
    found = []
    for name in family.names:
        low, high = (exact(x) for x in ranges[name])
        if not low < high:
            raise InputError(
                f"the range of {name}, from {float(low):g} to {float(high):g}, is empty"
            )
        found.append((name, (low, high)))
    return tuple(found)


class Question:
    """What is asked of det J over one box of parameters after the other."""

    def __init__(self, family: Family, whole: Spans, effort: float = 1.0) -> None:
        self._most = MOST_OPERATIONS * effort
        self._whole = whole
        coordinates = simplified(family.coordinates)
        columns = tuple(derivatives(coordinates, name) for name in PARAMETERS)
        self._form = normal_form(determinant(columns), MOST_TERMS)
        #: in which other atoms than parameters do not depend on these
        self._is_plain = self._form is not None and all(
            atom.op == "symbol" or atom.symbols.isdisjoint(family.names)
            for monomial in self._form
            for atom, _ in monomial
        )
        #: what a look takes before enclosures are tried
        nodes = sum(1 for _ in walk(sum(columns, ())))
        self._look = max(A_LOOK, A_NODE * nodes) + A_COEFFICIENT * _coefficients(self._form or {})
        self._enclosed = Enclosed(coordinates, columns, whole)
        self._sides = FamilySides(coordinates)
        self._margins = Margins(columns, family.names)
        widths = [high - low for low, high in family.domain]
        self._widths = IntervalProgram(tuple(x for x in widths if x.symbols))

    def sign(self, spans: Spans) -> _Look[int]:
        """Return the sign that is proved for a box, or None and what to halve.

        There is nothing to halve where no part of the box is likely to be proved.
        """
        if self._form is not None and not self._form:
            return None, "", A_LOOK  # M is flat, whatever the parameters are
        ascends = self._ascends(spans)
        if ascends and self._form is not None:
            sign = sign_of_form(self._form, spans, MOST_COEFFICIENTS)
            if sign:
                return sign, "", self._look
        folded, worst = self._margins.look(spans, self._whole)
        if folded:
            return None, "", self._look
        if self._is_plain or not ascends:
            # halved boxes are sharper for algebra, too
            return None, worst, self._look
        sign, spent = self._enclosed.sign(spans, min(PER_LOOK, self._most), self._most)
        return sign or None, worst, spent + self._look

    def boundary(self, spans: Spans) -> _Look[BoundaryComplex]:
        """Return the boundary that is proved for a box, or None and what to halve."""
        try:
            return self._sides.boundary(_intervals(spans)), "", SIDES
        except OpenQuestionError as error:
            return None, error.name, SIDES

    def _ascends(self, spans: Spans) -> bool:
        """Say whether u, v and w have domains, whatever the values are."""
        return all(bool(np.all(x.lower > 0)) for x in self._widths(_intervals(spans)))


def _coefficients(form: NormalForm) -> int:
    """Return how many Bernstein coefficients of a form are worked out at most."""
    degrees: dict[Expr, int] = {}
    for monomial in form:
        for atom, power in monomial:
            degrees[atom] = max(degrees.get(atom, 0), power)
    count = math.prod(n + 1 for n in degrees.values())
    return min(count, MOST_COEFFICIENTS)


def _intervals(spans: Spans) -> dict[str, Interval]:
    return {name: enclosed_range(*limits) for name, limits in spans}
