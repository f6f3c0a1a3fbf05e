"""What a face or an edge lies on, whatever its parameters are: planes, analytic surfaces, conics.

First comes the normal form of the equation, which gives exact figures where the parameters are the
carrier's own. Else the carrier is found from points, and proved from the equation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.looks import look_across, look_across_each, look_at_all
from pc2cad.domain.restrictions import ENDS, RestrictedMap
from pc2cad.domain.sections import SECTIONS
from pc2cad.expression.centred import CentredProgram
from pc2cad.expression.evaluation import Program
from pc2cad.expression.intervals import Interval
from pc2cad.expression.tree import number
from pc2cad.geometry.carriers import CurveCarrier, Evidence, Line, Plane, fit_plane
from pc2cad.geometry.recognition.from_points import Fitted, fit, fit_curve, irrational
from pc2cad.geometry.recognition.from_polynomials import normal_at
from pc2cad.geometry.recognition.from_separable_form import arc, is_straight, lay, lay_turned, plane
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.recognition.placement import SurfacePlacement
from pc2cad.geometry.recognition.separable_form import is_planar
from pc2cad.representation.tips import places_near

#: boxes per parameter that the search for points off a plane begins with, the most that it goes on
#: with, and how often these are halved
FIRST_BOXES, MOST_BOXES, MOST_HALVINGS = 16, 64, 24
#: where a face's normal is looked at
MIDDLE = np.array([0.55])
_QUARTERS = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])


def look_at(
    faces: Sequence[RestrictedMap], edges: Sequence[RestrictedMap], corners: Sequence[RestrictedMap]
) -> None:
    """Evaluate faces, edges and corners together where the questions below ask for them."""
    inside = SECTIONS[::2]
    near = places_near(0), places_near(1)
    along = [(f, (ENDS,) if f.is_exactly_straight else (inside, ENDS, *near)) for f in edges]
    look_at_all(
        [f for f in faces if f.exact_plane is None],
        (irrational(9), inside),
        [*along, *((corner, ()) for corner in corners)],
    )


def planes_of(
    functions: Sequence[RestrictedMap], signs: Sequence[int], slack: float
) -> list[tuple[Plane, Evidence] | None]:
    """Return the planes that carry faces within a distance, and how that is known; None for none.

    Their normals are `signs` times M_s × M_t.
    """
    nodes = irrational(9)
    seen = [f.exact_plane or fit_plane(f(nodes, nodes).reshape(-1, 3), slack) for f in functions]
    pairs = list(zip(functions, seen, strict=True))
    look_across_each(
        ([f for f, p in pairs if p is not None and f.exact_plane is None], MIDDLE),
        # those that `placements_of` will ask for
        ([f for f, p in pairs if p is None and not f.may_be_swept], nodes),
    )
    return [
        None if plane is None else _plane_of(function, plane, sign, slack)
        for (function, plane), sign in zip(pairs, signs, strict=True)
    ]


def _turned(found: Plane, outward: Array) -> Plane:
    """Return a plane with its normal on the side of a vector."""
    normal = found.normal if found.normal @ outward > 0 else -found.normal
    return Plane(found.origin, normal + 0.0)


def _plane_of(
    function: RestrictedMap, seen: Plane, sign: int, slack: float
) -> tuple[Plane, Evidence] | None:
    """Return the plane of a face that has some of its points in one."""
    if function.exact_plane is not None and function.polynomial is not None:
        (middle,) = MIDDLE.tolist()
        outward = sign * np.array(normal_at(function.polynomial[0], middle, middle))
        return _turned(function.exact_plane, outward), "exact"
    found = None if function.form is None else plane(function.form)
    evidence: Evidence = "exact"
    if found is None:
        found = seen
        if not is_planar(*function.trees):
            # waves between the first nodes would show here
            dense = function(irrational(64), irrational(61)).reshape(-1, 3)
            found = fit_plane(dense, slack)
            if found is None:
                return None
            if not holds(found, function.trees[0]):
                if _leaves(function, found, slack):
                    return None
                evidence = "sampled"
    return _turned(found, sign * function.normals(MIDDLE, MIDDLE)[0, 0]), evidence


def placements_of(
    functions: Sequence[RestrictedMap], slack: float
) -> list[SurfacePlacement | Fitted | None]:
    """Return faces on the analytic surfaces that carry them within a distance; None for none."""
    placed: list[SurfacePlacement | Fitted | None] = [
        (f.may_be_swept and f.form and lay(f.form)) or None for f in functions
    ]
    nodes = irrational(9)
    unplaced = [f for f, p in zip(functions, placed, strict=True) if p is None]
    look_across([f for f in unplaced if not f.knows_normals(nodes, nodes)], nodes, nodes)
    return [p or _fitted(f, slack) for f, p in zip(functions, placed, strict=True)]


def _fitted(function: RestrictedMap, slack: float) -> SurfacePlacement | Fitted | None:
    """Return a face on the surface that its points are on, or that a spline of its is turned to."""
    fitted = fit(function, function.normals, slack)
    if fitted and holds(fitted.carrier, function.trees[0]):
        return fitted
    # a contour or a spline turned: its meridian is none of the curves that CAD has names for
    return (function.may_be_swept and function.form and lay_turned(function.form)) or None


def simple_curve(function: RestrictedMap, slack: float) -> CurveCarrier | None:
    """Return the line or conic that carries an edge within a distance, or None.

    A parabola that is a polynomial of its parameter is none: its form is exact already.
    """
    if on_line(function):
        start, end = function(ENDS)
        return Line(start, end)
    form = function.form if function.may_be_exact(0) else None
    found = form and arc(form)
    if found:
        return found[0]
    fitted = fit_curve(function, slack)
    if fitted is None or (form is not None and form.axes[0].kind == "power"):
        return None
    return fitted if holds(fitted, function.trees[0]) else None


def on_line(function: RestrictedMap) -> bool:
    """Say whether an edge is straight, from its trees."""
    if function.is_exactly_straight:
        return True
    if not function.may_be_swept or function.is_affine:
        return function.may_be_swept
    return function.form is not None and is_straight(function.form)


def _leaves(function: RestrictedMap, plane: Plane, slack: float) -> bool:
    """Say whether a point of a face is found that is farther from a plane than a distance.

    Enclosures of the distance lead to it: the boxes that may be farthest are divided.
    """
    (x, y, z), (s, t) = function.trees
    a, b, c = (number(float(n)) for n in plane.normal)
    away = a * x + b * y + c * z - number(float(plane.normal @ plane.origin))
    enclosed, at = CentredProgram((away,)), Program((away,))
    side = np.linspace(0.0, 1.0, FIRST_BOXES + 1)[:-1]
    low = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    width = 1 / FIRST_BOXES
    for _ in range(MOST_HALVINGS):
        middle = low + width / 2
        values = np.abs(at({s: middle[:, 0], t: middle[:, 1]})[0])
        if (values > slack).any():
            return True
        high = low + width
        boxes = {name: Interval(low[:, k], high[:, k]) for k, name in enumerate((s, t))}
        reach = enclosed(boxes)[0].value.magnitude().upper
        far = np.argsort(-reach)[:MOST_BOXES]
        low, width = low[far[reach[far] > slack]], width / 2
        low = (low[:, None] + width * _QUARTERS).reshape(-1, 2)
    return False
