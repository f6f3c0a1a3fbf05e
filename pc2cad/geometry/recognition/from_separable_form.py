"""Recognising the surface or curve on which a face or an edge lies, from its separated form.

A face is a surface of revolution when along one axis it holds only one wave, M = A + B cos θ +
C sin θ, and for every value of the other parameter A lies on one line, and B and C are equally
long, perpendicular to each other and to that line, and of fixed directions. These are conditions on
a few constant vectors. The meridian (|B|, A) then tells cylinder, cone, sphere and torus apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array
from pc2cad.arrays.linear import cross
from pc2cad.geometry.carriers import (
    Arc,
    Cone,
    Cylinder,
    Extrusion,
    Frame,
    Plane,
    Revolution,
    Sphere,
    Torus,
    frame_on,
)
from pc2cad.geometry.recognition.placement import (
    SAME_ANGLE,
    TURN,
    Along,
    SurfacePlacement,
    angle_from,
    sum_of,
    turning,
)
from pc2cad.geometry.recognition.separable_form import CONSTANT, Axis, Separation, Term

#: share of its radius by which a circle has to stay off the axis to be a torus
FREE_OF_AXIS = 1e-9
#: relations between vectors hold to this many times their rounding
SAME = 10


def lay(form: Separation) -> SurfacePlacement | None:
    """Return the analytic surface of a face and its place there, or None."""
    for axis in (0, 1):
        turned = _revolved(form, axis)
        placement = turned and _place_meridian(form, axis, turned)
        if placement:
            return placement
    for axis in (0, 1):
        placement = _extruded(form, axis)
        if placement:
            return placement
    return None


def lay_turned(form: Separation) -> SurfacePlacement | None:
    """Return a face as a revolution whatever functions its meridian is made of, or None."""
    for axis in (0, 1):
        turned = _revolved(form, axis)
        placement = turned and _place_meridian(form, axis, turned, any_profile=True)
        if placement:
            return placement
    return None


def plane(form: Separation) -> Plane | None:
    """Return the plane that holds a face, from its vectors; its normal is either of the two."""
    steps = np.array([v for key, v in form.vectors.items() if set(key) != {CONSTANT}])
    if len(steps) < 2:
        return None
    first = steps[np.argmax((steps * steps).sum(axis=1))]
    normals = cross(first, steps)
    normal = normals[np.argmax((normals * normals).sum(axis=1))]
    size, small = np.linalg.norm(normal), SAME * form.rounding
    if size <= small * np.linalg.norm(first) or np.abs(steps @ (normal / size)).max() > small:
        return None
    return Plane(form.centre, normal / size)


# -- revolution ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Revolved:
    """M = origin + height z + radius (cos θ x + sin θ y), θ the multiple of the axis' angle."""

    multiple: int
    origin: Array
    axes: Array
    radius: Mapping[Term, float]
    height: Mapping[Term, float]


def _one_wave(form: Separation, axis: int) -> int | None:
    """Return k where only 1, cos kθ and sin kθ occur along the axis, else None."""
    if form.axes[axis].kind != "wave":
        return None
    waves = {term.order for term in form.terms(axis) if term != CONSTANT}
    return waves.pop() if len(waves) == 1 else None


def _revolved(form: Separation, axis: int) -> _Revolved | None:
    k = _one_wave(form, axis)
    if k is None:
        return None
    groups: dict[str, dict[Term, Array]] = {"power": {}, "cos": {}, "sin": {}}
    for key, vector in form.vectors.items():
        groups[key[axis].kind][key[1 - axis]] = vector
    still, cosines, sines = groups["power"], groups["cos"], groups["sin"]
    if set(cosines) != set(sines):
        return None
    leading = max(cosines, key=lambda term: float(np.linalg.norm(cosines[term])))
    x = cosines[leading] / np.linalg.norm(cosines[leading])
    z = np.cross(cosines[leading], sines[leading])
    if np.linalg.norm(z) <= 1e-3 * np.linalg.norm(cosines[leading]) ** 2:
        return None
    z = z / np.linalg.norm(z)
    y = np.cross(z, x)
    radius = {term: float(vector @ x) for term, vector in cosines.items()}
    moving = {term: vector for term, vector in still.items() if term != CONSTANT}
    height = {term: float(vector @ z) for term, vector in moving.items()}
    small = SAME * form.rounding
    fits = (
        all(np.linalg.norm(cosines[t] - radius[t] * x) <= small for t in cosines)
        and all(np.linalg.norm(sines[t] - radius[t] * y) <= small for t in cosines)
        and all(np.linalg.norm(moving[t] - height[t] * z) <= small for t in moving)
    )
    if not fits:
        return None
    if sum_of(form.axes[1 - axis], radius)(np.array([0.5]))[0] < 0:
        x, y, radius = -x, -y, {term: -value for term, value in radius.items()}
    return _Revolved(k, form.centre, np.array([x, y, z]), radius, height)


def _upside_down(turned: _Revolved) -> _Revolved:
    """Return the same with the axis reversed: angles are then counted the other way."""
    axes = turned.axes * np.array([[1.0], [-1.0], [-1.0]])
    height = {term: -value for term, value in turned.height.items()}
    return _Revolved(turned.multiple, turned.origin, axes, turned.radius, height)


def _place_meridian(
    form: Separation, axis: int, turned: _Revolved, any_profile: bool = False
) -> SurfacePlacement | None:
    other = form.axes[1 - axis]
    terms = [t for t in {**turned.radius, **turned.height} if t != CONSTANT]
    steps = {t: np.array([turned.radius.get(t, 0.0), turned.height.get(t, 0.0)]) for t in terms}
    small = SAME * form.rounding
    sense = 1.0
    if all(abs(step[1]) <= small for step in steps.values()):
        return None  # a plane
    longest = max(steps.values(), key=lambda step: float(np.hypot(*step)))
    straight = all(abs(longest[0] * s[1] - longest[1] * s[0]) <= small * np.hypot(*longest)
                   for s in steps.values())  # fmt: skip
    conical = straight and abs(longest[0]) > small
    ends = form.axes[axis].turn(turned.multiple, np.array([0.0, 1.0]))
    # count angles upwards along the axis, but a cone has to widen along z
    if (longest[0] * longest[1] < 0) if conical else (ends[1] < ends[0]):
        turned, sense = _upside_down(turned), -1.0
        steps = {t: step * np.array([1.0, -1.0]) for t, step in steps.items()}
    shift, _ = angle_from((sense * ends[0], sense * ends[1]))
    x = np.cos(shift) * turned.axes[0] - np.sin(shift) * turned.axes[1]
    a = Along(axis, turning(form.axes[axis], turned.multiple, sense, shift))
    meridian = _Meridian(other, turned.radius.get(CONSTANT, 0.0), turned.radius, turned.height,
                         steps, small)  # fmt: skip
    frame = frame_on(turned.origin, turned.axes[2], x)
    if straight:
        return _straight(meridian, frame, a, conical)
    return _round(meridian, frame, a) or _profiled(meridian, frame, a, any_profile)


@dataclass(frozen=True, eq=False)
class _Meridian:
    """Radius and height over the other axis: their constants and the vectors of their terms."""

    axis: Axis
    radius: float
    radii: Mapping[Term, float]
    heights: Mapping[Term, float]
    steps: Mapping[Term, Array]
    small: float

    def point(self, t: float) -> Array:
        """Return (radius, height) at a parameter."""
        both = (sum_of(self.axis, self.radii), sum_of(self.axis, self.heights))
        return np.array([values(np.array([t]))[0] for values in both])


def _moved(frame: Frame, height: float) -> Frame:
    return Frame(frame.origin + height * frame.axes[2], frame.axes)


def _straight(meridian: _Meridian, frame: Frame, a: Along, conical: bool) -> SurfacePlacement:
    start, end = meridian.point(0.0), meridian.point(1.0)
    other = 1 - a.axis
    if not conical:
        heights = sum_of(meridian.axis, meridian.heights)
        low = min(start[1], end[1])
        along = Along(other, lambda t: heights(t) - low)
        cylinder = Cylinder(_moved(frame, low), meridian.radius)
        return SurfacePlacement(lambda _: cylinder, a, along)
    # the reference is the wider end, and lengths along the cone are counted from there
    wide = start if start[0] > end[0] else end
    direction = (end - start) / np.hypot(*(end - start))
    direction = direction if direction[1] > 0 else -direction
    slants = sum_of(meridian.axis, {t: float(s @ direction) for t, s in meridian.steps.items()})
    reference = float(slants(np.array([0.0 if wide is start else 1.0]))[0])
    angle = float(np.arctan2(direction[0], direction[1]))
    cone = Cone(_moved(frame, float(wide[1])), float(wide[0]), angle)
    return SurfacePlacement(lambda _: cone, a, Along(other, lambda t: slants(t) - reference))


def _round(meridian: _Meridian, frame: Frame, a: Along) -> SurfacePlacement | None:
    """Return a sphere or a torus where the meridian is an arc.

    None for a circle that touches or crosses the axis: readers of STEP files take all of such a
    circle for the face's, and a rational spline, which is an arc of it only, as what it is.
    """
    waves = set(meridian.steps)
    k = next(iter(waves)).order
    if not waves <= {Term("cos", k), Term("sin", k)}:
        return None
    c, s = (meridian.steps.get(term, np.zeros(2)) for term in (Term("cos", k), Term("sin", k)))
    radius = float(np.hypot(*c))
    across = np.array([-c[1], c[0]])
    sense = 1.0 if across @ s > 0 else -1.0
    if np.abs(s - sense * across).max() > meridian.small:
        return None
    start = float(np.arctan2(c[1], c[0]))
    ends = sense * meridian.axis.turn(k, np.array([0.0, 1.0])) + start
    on_axis = abs(meridian.radius) <= meridian.small
    frame = _moved(frame, meridian.heights.get(CONSTANT, 0.0))
    # latitudes lie about 0; angles round a tube are counted from 0 upwards
    turns = np.round(ends.mean() / TURN) if on_axis else np.floor((ends.min() + SAME_ANGLE) / TURN)
    raw = turning(meridian.axis, k, sense, start - float(TURN * turns))
    along = Along(1 - a.axis, lambda t: _snap(raw(t)))
    if on_axis:
        return SurfacePlacement(lambda _: Sphere(frame, radius), a, along)
    if meridian.radius > radius * (1 + FREE_OF_AXIS):
        return SurfacePlacement(lambda _: Torus(frame, meridian.radius, radius), a, along)
    return None


def _snap(angle: Array) -> Array:
    """Return angles with those at a multiple of a right angle made so to the last bit."""
    whole = np.round(angle / (np.pi / 2)) * (np.pi / 2)
    return np.where(np.abs(angle - whole) < SAME_ANGLE, whole, angle)


def _profiled(
    meridian: _Meridian, frame: Frame, a: Along, any_profile: bool
) -> SurfacePlacement | None:
    if meridian.axis.kind == "other" and not any_profile:
        return None
    ends = a.ends
    other = 1 - a.axis
    level = 0.0 if ends[0] < ends[1] else 1.0
    return SurfacePlacement(lambda spline: Revolution(spline(other, level), frame), a, Along(other))


# -- extrusion -------------------------------------------------------------------------------------


def _extruded(form: Separation, axis: int) -> SurfacePlacement | None:
    """Return the extrusion along one axis: M = A(s) + h(t) d."""
    if any(CONSTANT not in key for key in form.vectors):
        return None
    steps = {key[axis]: v for key, v in form.vectors.items() if key[axis] != CONSTANT}
    if not steps:
        return None
    longest = max(steps.values(), key=lambda v: float(np.linalg.norm(v)))
    direction = longest / np.linalg.norm(longest)
    small = SAME * form.rounding
    if any(np.linalg.norm(v - (v @ direction) * direction) > small for v in steps.values()):
        return None
    lengths = sum_of(form.axes[axis], {term: float(v @ direction) for term, v in steps.items()})
    start = float(lengths(np.array([0.0]))[0])
    if lengths(np.array([1.0]))[0] < start:
        direction = -direction
        forwards = lengths
        lengths, start = (lambda t: -forwards(t)), -start
    b = Along(axis, lambda t: lengths(t) - start)
    other = form.axes[1 - axis]
    along: dict[tuple[Term, ...], Array] = {
        (key[1 - axis],): v for key, v in form.vectors.items() if key[axis] == CONSTANT
    }
    along[(CONSTANT,)] = form.centre + start * direction
    base = Separation((other,), along, form.rounding)
    found = arc(base)
    if found:
        ellipse = Extrusion(found[0], direction)
        return SurfacePlacement(lambda _: ellipse, Along(1 - axis, found[1]), b)
    if other.kind == "other" or base.order(0) < 2:
        return None
    level = 0.0 if b.ends[0] < b.ends[1] else 1.0
    return SurfacePlacement(
        lambda spline: Extrusion(spline(1 - axis, level), direction), Along(1 - axis), b
    )


# -- curves ----------------------------------------------------------------------------------------


def is_straight(form: Separation) -> bool:
    """Say whether the points of an edge lie on one line."""
    steps = np.array([v for key, v in form.vectors.items() if key[0] != CONSTANT]).reshape(-1, 3)
    if len(steps) == 0:
        return False
    longest = steps[np.argmax((steps * steps).sum(axis=1))]
    off = np.linalg.norm(np.cross(steps, longest / np.linalg.norm(longest)), axis=1)
    return bool(off.max() <= SAME * form.rounding)


def arc(form: Separation) -> tuple[Arc, Callable[[Array], Array]] | None:
    """Return the arc of a circle or an ellipse that an edge is, and its angle over the edge.

    The arc runs upwards; the angle is a function of the edge's own parameter.
    """
    k = _one_wave(form, 0)
    if k is None:
        return None
    c, s = (form.vectors.get((term,), np.zeros(3)) for term in (Term("cos", k), Term("sin", k)))
    small = SAME * form.rounding
    long, wide = float(np.linalg.norm(c)), float(np.linalg.norm(s))
    if abs(c @ s) <= small * max(long, wide) and abs(long - wide) <= small:
        tilt, radii = 0.0, (long, long)
    else:
        # conjugate half diameters to half axes
        tilt = 0.5 * float(np.arctan2(2 * c @ s, c @ c - s @ s))
        c, s = np.cos(tilt) * c + np.sin(tilt) * s, np.cos(tilt) * s - np.sin(tilt) * c
        radii = (float(np.linalg.norm(c)), float(np.linalg.norm(s)))
    if radii[1] <= 1e-6 * radii[0]:
        return None
    first, last = form.axes[0].turn(k, np.array([0.0, 1.0])).tolist()
    sense = 1.0 if last > first else -1.0
    x, y = c / radii[0], sense * s / radii[1]
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    frame = frame_on(form.centre, np.cross(x, y), x)
    low = sense * (first - tilt)
    offset = -sense * tilt - TURN * np.floor((low + SAME_ANGLE) / TURN)
    values = turning(form.axes[0], k, sense, offset)
    start, end = values(np.array([0.0, 1.0])).tolist()
    return Arc(frame, radii, start, end), values
