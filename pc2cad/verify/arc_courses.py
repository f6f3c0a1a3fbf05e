"""Rational splines of a file that run through one arc of a side's angle.

Their parameter is not the equation's own, but follows from it: where a side is a trigonometric
polynomial of an angle, and the file's weights are those of the arc that it turns by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.distinct import distinct
from pc2cad.expression.tree import Expr
from pc2cad.geometry.splines.arcs import wave_in
from pc2cad.geometry.splines.rational import Parametrisation, rational_course
from pc2cad.geometry.splines.spline_space import SplineSpace

#: weights that differ by less are those of the arc; how far they do counts in every bound
_SAME = 1e-9


def arc_course(
    trees: Sequence[Expr], name: str, knots: Array, weights: Array
) -> Parametrisation | None:
    """Return how a spline with weights (n,) along a direction runs, if that is in one arc.

    The trees' named symbol, from 0 to 1, is what runs along the direction.
    """
    if len(distinct(knots)) > 2 or not weights[0]:
        return None
    wave = wave_in(trees, name)
    if wave is None:
        return None
    course = rational_course(wave.single_arc, wave.order)
    if len(course.weights) != len(weights):
        return None
    return course if np.abs(course.weights - weights / weights[0]).max() <= _SAME else None


def own_course(degree: int, knots: Array) -> Parametrisation:
    """Return how a spline runs whose parameter is the equation's own."""
    points = distinct(knots)
    counts = np.searchsorted(knots, points, "right") - np.searchsorted(knots, points, "left")
    return Parametrisation(SplineSpace(degree, points, counts[1:-1].tolist()))
