"""What a face or an edge lies on, whatever its parameters are: planes, analytic surfaces, conics.

First comes the normal form of the equation, which gives exact figures where the parameters are the
carrier's own. Else the carrier is found from points, and proved from the equation.
"""

from __future__ import annotations

import numpy as np

from pc2cad.arrays import Array
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.geometry.carriers import CurveCarrier, Evidence, Line, Plane, fit_plane
from pc2cad.geometry.recognition.from_points import Fitted, fit, fit_curve, irrational
from pc2cad.geometry.recognition.from_separable_form import arc, is_straight, lay, plane
from pc2cad.geometry.recognition.implicit import holds
from pc2cad.geometry.recognition.placement import SurfacePlacement
from pc2cad.geometry.splines.bernstein import linear_span


def plane_of(function: RestrictedMap, sign: int, slack: float) -> tuple[Plane, Evidence] | None:
    """Return the plane that carries a face within a distance, if one does, and how that is known.

    Its normal is `sign` times M_s × M_t.
    """
    nodes = irrational(9)
    seen = fit_plane(function(nodes, nodes).reshape(-1, 3), slack)
    if seen is None:
        return None
    found = None if function.form is None else plane(function.form)
    evidence: Evidence = "exact"
    if found is None:
        found = seen
        span = linear_span(function.trees[0])
        if span is None or _rank(span) > 2:
            # waves between the first nodes would show here
            dense = function(irrational(64), irrational(61)).reshape(-1, 3)
            found = fit_plane(dense, slack)
            if found is None:
                return None
            evidence = "exact" if holds(found, function.trees[0]) else "sampled"
    outward = sign * function.normals(np.array([0.55]), np.array([0.55]))[0, 0]
    normal = found.normal if found.normal @ outward > 0 else -found.normal
    return Plane(found.origin, normal + 0.0), evidence


def placement_of(function: RestrictedMap, slack: float) -> SurfacePlacement | Fitted | None:
    """Return a face laid on the analytic surface that carries it within a distance, or None."""
    placement = function.may_be_swept and function.form and lay(function.form)
    if placement:
        return placement
    fitted = fit(function, function.normals, slack)
    return fitted if fitted and holds(fitted.carrier, function.trees[0]) else None


def simple_curve(function: RestrictedMap, slack: float) -> CurveCarrier | None:
    """Return the line or conic that carries an edge within a distance, or None.

    A parabola that is a polynomial of its parameter is none: its form is exact already.
    """
    if on_line(function):
        start, end = function(np.array([0.0, 1.0]))
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
    """Say whether an edge is straight, from its form."""
    form = function.form if function.may_be_swept else None
    return form is not None and is_straight(form)


def _rank(vectors: Array) -> int:
    if len(vectors) == 0:
        return 0
    values = np.linalg.svd(vectors, compute_uv=False)
    return int((values > 1e-13 * values[0]).sum())
