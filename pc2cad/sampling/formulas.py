"""Fields as formulas of the place, for programs that know neither M nor how it is inverted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from pc2cad.arrays import Array
from pc2cad.checked import CheckedMap
from pc2cad.domain.analysis import Analysis
from pc2cad.domain.fields import LocalField, local_field
from pc2cad.domain.formulas import Formula, NoFormulaError, Writer
from pc2cad.equation.fields import COORDINATES, SYMBOLS
from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.simplification import simplified
from pc2cad.sampling.newton import Inversion

#: what a field may be off, as a share of its values' span
TOLERANCE = 1e-9
#: how often a formula is held against the field, with more seeds where it missed
TRIES = 4


@dataclass(frozen=True, eq=False)
class FieldFormula:
    """A scalar field as a formula of x, y and z."""

    formula: Formula
    #: the largest difference from the field that was seen, in so many places; 0 places: there is
    #: none but rounding
    deviation: float
    places: int


def field_formulas(
    checked: CheckedMap, names: Sequence[str]
) -> tuple[dict[str, FieldFormula], dict[str, str]]:
    """Return those of some scalar fields that are formulas of the place, to 1e-9 of their span.

    And why the others are not, in words. Raises InputError for names of no scalar field, and
    FieldNotFiniteError.
    """
    known, found, others = Inversions(checked.analysis), {}, {}
    for name in names:
        try:
            found[name] = known.field(name)
        except NoFormulaError as error:
            others[name] = str(error)
    return found, others


class Inversions:
    """Fields of one map as formulas: M is inverted once, if any of them asks for it."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis

    @cached_property
    def inverse(self) -> Inversion:
        """M inverted; raises NoFormulaError."""
        return Inversion(self._analysis)

    def off(self, name: str, formula: Formula, points: Array, places: Array) -> tuple[float, float]:
        """Return how far a formula is from a field; see `off`."""
        return off(self._analysis, local_field(self._analysis, name), formula, points, places)

    def field(self, name: str) -> FieldFormula:
        """Return a field as a formula of the place; raise InputError, NoFormulaError."""
        field = local_field(self._analysis, name)
        if field.field.kind != "scalar":
            raise InputError(f"files hold numbers, and the field {name} is a {field.field.kind}")
        if {*PARAMETERS} & field.field.components[0].symbols:
            return self._by_steps(field)
        writer = Writer(name, COORDINATES)
        names = dict(zip(COORDINATES, range(3), strict=True))
        (value,) = writer.trees(simplified(field.field.components), names)
        return FieldFormula(writer.made(value=value), 0.0, 0)

    def _by_steps(self, field: LocalField) -> FieldFormula:
        for _ in range(TRIES):
            places = np.concatenate([self.inverse.places() for _ in range(2)])
            formula = self._written(field)
            points = self._analysis.map.points(*places.T)
            worst, span = off(self._analysis, field, formula, points, places)
            if worst <= TOLERANCE * span:
                return FieldFormula(formula, worst, len(places))
            self.inverse.learn(places)
        raise NoFormulaError(f"the formula is {worst:.2g} off, and may be {TOLERANCE * span:.2g}")

    def _written(self, field: LocalField) -> Formula:
        mapping = self._analysis.map
        writer = Writer(field.field.name, COORDINATES)
        local = writer.call(self.inverse.formula, 0, 1, 2)[:3]
        own = writer.trees(mapping.parameters, dict(zip(PARAMETERS, local, strict=True)))
        names = dict(zip(SYMBOLS, (*own, 0, 1, 2), strict=True))
        (value,) = writer.trees(simplified(field.field.components), names)
        return writer.made(value=value)


def off(
    analysis: Analysis, field: LocalField, formula: Formula, points: Array, places: Array
) -> tuple[float, float]:
    """Return how far a formula is from a field at places (n, 3) of the box, and the field's span.

    What the field changes by when its point moves by its rounding is not counted.
    """
    exact = field.checked_at(places)[:, 0]
    tangents = np.stack(analysis.map.frame(*places.T)[1:], axis=-1)
    noise, room = analysis.scale.evaluation_noise, np.zeros(len(places))
    moved = noise * np.abs(np.linalg.pinv(tangents)).sum(axis=2)
    for d, sign in product(range(3), (-1, 1)):
        beside = places.copy()
        beside[:, d] = np.clip(beside[:, d] + sign * moved[:, d], 0, 1)
        room += np.abs(field.checked_at(beside)[:, 0] - exact)
    worst = float((np.abs(formula(*points.T)[0] - exact) - room).max())
    span = float(np.ptp(exact)) or float(np.abs(exact).max())
    return worst if not worst <= 0 else 0.0, span
