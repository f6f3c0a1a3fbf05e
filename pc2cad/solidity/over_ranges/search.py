"""Proofs over ranges of parameters: boxes are halved until each is proved, or the effort ends.

A box is asked by algebra first: the normal form of det J, in which the parameters are variables
that run from limit to limit. Then by enclosures. The largest box is halved next, along the
parameter with which det J changes most; one in which folds are seen everywhere is left open.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from fractions import Fraction
from itertools import count
from typing import Final

import numpy as np

from pc2cad.equation.family import Family
from pc2cad.errors import InputError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.enclosures import IntervalProgram
from pc2cad.expression.exact import exact
from pc2cad.expression.intervals import enclosed_range
from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.simplification import simplified
from pc2cad.expression.tree import Number
from pc2cad.solidity.jacobian_proof.determinant import determinant
from pc2cad.solidity.jacobian_proof.factors import Spans, sign_of_form
from pc2cad.solidity.over_ranges.boxes import ProvedBox, RangeProof, halves, joined, volume
from pc2cad.solidity.over_ranges.enclosed import Enclosed
from pc2cad.solidity.over_ranges.margins import Margins

#: operations at which what is left stays open, about a second: those on intervals, and what a look
#: by algebra and samples comes to; operations on intervals for one box
MOST_OPERATIONS: Final = 4e7
A_LOOK: Final = 1e5
PER_LOOK: Final = 4e6
#: share of the ranges below which a box is not halved any more
SMALLEST: Final = Fraction(1, 2**12)
#: terms of det J, and its Bernstein coefficients
MOST_TERMS: Final = 400
MOST_COEFFICIENTS: Final = 5000


def prove_over(
    family: Family, ranges: Mapping[str, tuple[Number, Number]], effort: float = 1.0
) -> RangeProof:
    """Return for which values of a family's free parameters det J is proved to keep its sign.

    `ranges` has lower and upper limit of each, both included; `effort` multiplies what may be
    spent. Raises InputError for ranges that are not those of the free parameters.
    """
    whole = read_spans(family, ranges)
    question = Question(family, whole)
    order, heap = count(), list[tuple[Fraction, int, Spans]]()
    heapq.heappush(heap, (Fraction(-1), next(order), whole))
    proved: dict[int, list[Spans]] = {1: [], -1: []}
    left: list[Spans] = []
    looks, spent = 0, 0.0
    while heap and spent < MOST_OPERATIONS * effort:
        share, _, spans = heapq.heappop(heap)
        sign, worst, used = question.look(spans)
        looks, spent = looks + 1, spent + used + A_LOOK
        if sign:
            proved[sign].append(spans)
        elif not worst or -share < SMALLEST:
            left.append(spans)
        else:
            for half in halves(spans, worst):
                heapq.heappush(heap, (-volume(half, whole), next(order), half))
    left += [spans for _, _, spans in heap]
    boxes = [ProvedBox(spans, sign) for sign in (1, -1) for spans in joined(proved[sign])]
    return RangeProof(
        family.name, whole, family.fixed, tuple(boxes), tuple(joined(left)), looks, spent
    )


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

    def __init__(self, family: Family, whole: Spans) -> None:
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
        self._enclosed = Enclosed(coordinates, columns, whole)
        self._margins = Margins(columns, family.names)
        widths = [high - low for low, high in family.domain]
        self._widths = IntervalProgram(tuple(x for x in widths if x.symbols))

    def look(self, spans: Spans) -> tuple[int, str, float]:
        """Return the sign that is proved (0: none), what to halve, and what it took.

        There is nothing to halve where no part of the box is likely to be proved.
        """
        if self._form is not None and not self._form:
            return 0, "", 0.0  # M is flat, whatever the parameters are
        ascends = self._ascends(spans)
        if ascends and self._form is not None:
            sign = sign_of_form(self._form, spans, MOST_COEFFICIENTS)
            if sign:
                return sign, "", 0.0
        folded, worst = self._margins.look(spans, self._whole)
        if folded:
            return 0, "", 0.0
        if self._is_plain or not ascends:
            # halved boxes are sharper for algebra, too
            return 0, worst, 0.0
        sign, spent = self._enclosed.sign(spans, PER_LOOK)
        return sign, worst, spent

    def _ascends(self, spans: Spans) -> bool:
        """Say whether u, v and w have domains, whatever the values are."""
        boxes = {name: enclosed_range(*limits) for name, limits in spans}
        return all(bool(np.all(x.lower > 0)) for x in self._widths(boxes))
