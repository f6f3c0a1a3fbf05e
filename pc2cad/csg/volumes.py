"""What the volumes of two shapes and of what they have in common say of how these lie."""

from __future__ import annotations

from enum import Enum

from pc2cad.templates.bodies import Kind

#: why nothing is left
EMPTY = {
    "union": "both are",
    "cut": "the first lies wholly inside what is cut from it",
    "intersect": "they have no common part",
}


class Relation(Enum):
    """How two shapes lie to one another."""

    APART = "nothing in common"
    SECOND_INSIDE = "the second lies inside the first"
    FIRST_INSIDE = "the first lies inside the second"
    ACROSS = "each has a part outside the other"


def relation(a: float, b: float, common: float, slack: float) -> Relation:
    """Return how shapes of volumes a and b lie that have a volume in common."""
    if common <= slack:
        return Relation.APART
    if abs(common - b) <= slack:
        return Relation.SECOND_INSIDE
    return Relation.FIRST_INSIDE if abs(common - a) <= slack else Relation.ACROSS


def sentence(kind: Kind, lie: Relation, a: float, b: float, common: float, result: float) -> str:
    """Return what a report says of a Boolean of volumes a and b."""
    if kind == "union":
        if lie is Relation.APART:
            return f"nothing in common, the volumes add up: {a:.10g} + {b:.10g} = {result:.10g}"
        if lie is not Relation.ACROSS:
            return f"one lies inside the other: {result:.10g}"
        return f"{common:.10g} in common: {a:.10g} + {b:.10g} - {common:.10g} = {result:.10g}"
    if kind == "cut":
        if lie is Relation.APART:
            return f"nothing in common, nothing is cut: {result:.10g}"
        if lie is Relation.SECOND_INSIDE:
            return f"wholly inside, the volumes subtract: {a:.10g} - {b:.10g} = {result:.10g}"
        return f"{common:.10g} of {b:.10g} inside: {a:.10g} - {common:.10g} = {result:.10g}"
    return f"{result:.10g} in common of {a:.10g} and {b:.10g}"
