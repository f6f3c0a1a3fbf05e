"""Boxes of values of parameters, and what is proved over them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pc2cad.expression.tree import Expr, Number, as_expr
from pc2cad.solidity.jacobian_proof.factors import Spans
from pc2cad.topology.complex import BoundaryComplex


@dataclass(frozen=True)
class ProvedBox:
    """Values of parameters, limits included, for all of which det J has one sign."""

    spans: Spans
    #: +1 or -1: that of det J over the whole box of u, v and w, but for a set without volume
    sign: int
    #: which sides collapse, coincide and bound, the same for all values; None where that is open
    boundary: BoundaryComplex | None = None

    def holds(self, values: Mapping[str, Fraction]) -> bool:
        """Say whether values, one for each parameter of the box, are in it."""
        return all(low <= values[name] <= high for name, (low, high) in self.spans)


@dataclass(frozen=True)
class RangeProof:
    """For which values of some parameters det J is proved to keep its sign, and where it is open.

    What is open is not refuted: the effort ended, or the proofs do not reach as far.
    """

    #: of the template
    name: str
    #: the parameters that run, and the values of the others
    spans: Spans
    fixed: Mapping[str, Expr]
    proved: tuple[ProvedBox, ...]
    open: tuple[Spans, ...]
    #: boxes that were looked at, and what they took in operations
    looks: int
    spent: float

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that run."""
        return tuple(name for name, _ in self.spans)

    @property
    def share(self) -> float:
        """How much of the ranges is proved, by volume: 1 for all of them."""
        return float(sum(volume(box.spans, self.spans) for box in self.proved))

    @property
    def share_of_sides(self) -> float:
        """How much of the ranges is proved to keep its sign and its boundary, by volume."""
        known = (box.spans for box in self.proved if box.boundary is not None)
        return float(sum(volume(spans, self.spans) for spans in known))

    @property
    def is_whole(self) -> bool:
        """Whether all of the ranges is proved, with one sign."""
        return not self.open and len({box.sign for box in self.proved}) == 1

    @property
    def sentence(self) -> str:
        """What is proved, and over how much of the ranges."""
        where = ", ".join(f"{n} from {float(a):g} to {float(b):g}" for n, (a, b) in self.spans)
        if not self.proved:
            return f"no sign of det J is proved over {where}"
        share, alike = _percent(self.share), _percent(self.share_of_sides)
        return (
            f"det J keeps its sign: proved over {share} of {where}; "
            f"sides collapse, coincide and bound alike: proved over {alike}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; the number of faces is None where it is open."""
        return {
            "name": self.name, "over": within(self.spans), "share": self.share,
            "share_of_sides": self.share_of_sides,
            "proved": [
                {
                    "values": within(box.spans), "sign": box.sign,
                    "faces": None if box.boundary is None else len(box.boundary.faces),
                }
                for box in self.proved
            ],
            "open": [within(spans) for spans in self.open], "looks": self.looks,
            "operations": self.spent,
        }  # fmt: skip

    def at(self, values: Mapping[str, Expr | Number]) -> ProvedBox | None:
        """Return the proved box that values of all the template's parameters lie in, or None.

        Other parameters than those that run must have the very values of the proof, and points
        those that they had in it.
        """
        given = {name: as_expr(value) for name, value in values.items()}
        if given.keys() != {name for name, _ in self.spans} | self.fixed.keys():
            return None
        if any(given[name] is not value for name, value in self.fixed.items()):
            return None
        numbers = {
            name: given[name].payload for name, _ in self.spans if given[name].op == "number"
        }
        if len(numbers) < len(self.spans):
            return None
        return next((box for box in self.proved if box.holds(numbers)), None)


def within(spans: Spans) -> dict[str, list[float]]:
    """Return limits as numbers that, written out and read again as decimals, are within them."""
    return {name: [_near(low, math.inf), _near(high, -math.inf)] for name, (low, high) in spans}


def around(boxes: Iterable[ProvedBox], value: Fraction) -> tuple[float, float] | None:
    """Return the limits between which boxes of one parameter have one sign, round a value.

    None where no box has the value.
    """
    rows = sorted((box.spans[0][1], box.sign) for box in boxes)
    found: tuple[Fraction, Fraction] | None = None
    sign = 0
    for (low, high), other in rows:
        if found is not None and other == sign and low == found[1]:
            found = found[0], high
        elif found is not None and value <= found[1]:
            break
        else:
            found, sign = (low, high), other
    if found is None or not found[0] <= value <= found[1]:
        return None
    return _near(found[0], math.inf), _near(found[1], -math.inf)


def _near(limit: Fraction, inwards: float) -> float:
    near = float(limit)
    if (Fraction(repr(near)) < limit) if inwards > 0 else (Fraction(repr(near)) > limit):
        return math.nextafter(near, inwards)
    return near


def _percent(share: float) -> str:
    """Return a share in words; not all where a little is missing."""
    return "all" if share == 1 else f"{min(100 * share, 99.99):.4g} %"


def volume(spans: Spans, whole: Spans) -> Fraction:
    """Return the share that a box is of a whole one."""
    rows = zip(spans, whole, strict=True)
    return math.prod(((b - a) / (d - c) for (_, (a, b)), (_, (c, d)) in rows), start=Fraction(1))


def halves(spans: Spans, name: str) -> tuple[Spans, Spans]:
    """Return the two halves of a box along one parameter."""
    low, high = dict(spans)[name]
    middle = (low + high) / 2
    first, second = (
        tuple([(n, part if n == name else limits) for n, limits in spans])
        for part in ((low, middle), (middle, high))
    )
    return first, second


def joined(boxes: Iterable[Spans]) -> list[Spans]:
    """Return boxes that fill the same, two that share a whole side as one, as often as it goes."""
    found, before = sorted(boxes), -1
    while found and len(found) != before:
        before = len(found)
        for axis in range(len(found[0])):
            found = _joined_along(found, axis)
    return sorted(found)


def _joined_along(boxes: list[Spans], axis: int) -> list[Spans]:
    rows: dict[Spans, list[Spans]] = {}
    for box in boxes:
        rows.setdefault(box[:axis] + box[axis + 1 :], []).append(box)
    found = []
    for row in rows.values():
        row.sort(key=lambda box: box[axis][1])
        current = row[0]
        for box in row[1:]:
            name, (low, high) = current[axis]
            if box[axis][1][0] == high:
                longer = name, (low, box[axis][1][1])
                current = (*current[:axis], longer, *current[axis + 1 :])
            else:
                found.append(current)
                current = box
        found.append(current)
    return found
