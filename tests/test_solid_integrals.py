"""The solid's own integrals, taken from the kernel's surfaces, where rules of even spans miss."""

from __future__ import annotations

from math import exp, log, pi, sqrt

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeWire,
)
from OCP.Geom import (
    Geom_CylindricalSurface,
    Geom_Ellipse,
    Geom_RectangularTrimmedSurface,
    Geom_ToroidalSurface,
)
from OCP.Geom2d import Geom2d_BSplineCurve
from OCP.GeomConvert import GeomConvert
from OCP.gp import gp_Ax2, gp_Ax3, gp_Dir, gp_Pnt, gp_Pnt2d

import pc2cad as pc
from pc2cad.brep.forms import SECOND
from pc2cad.brep.from_kernel import path_function
from pc2cad.brep.integrals import solid_integrals
from pc2cad.brep.kernel import Array1OfInteger, Array1OfPnt2d, Array1OfReal, compound
from pc2cad.brep.patch_integrals import _Whole, patch_integrals
from pc2cad.brep.settling import settled
from pc2cad.brep.spline_integrals import Patch, clamped, read_patch
from pc2cad.errors import KernelError

U, V, W = pc.parameters()


def turning_bar(speed: float, turn: float):
    """A square bar of 5 that turns `turn` radians while its rise grows exp(speed)-fold."""
    rise = 5 * (pc.exp(speed * U) - 1) / (pc.e**speed - 1)
    c, s = pc.cos(turn * U), pc.sin(turn * U)
    a, b = V - 0.5, W - 0.5
    return a * c - b * s, a * s + b * c, rise


def turning_bar_area(speed: float, turn: float) -> float:
    """Four faces ∬ sqrt(rise'² + turn² a²) da du, in closed form over a, and the two ends."""
    x, weight = np.polynomial.legendre.leggauss(200)
    total = 0.0
    for u, w in zip((x + 1) / 2, weight / 2, strict=True):
        rise = 5 * speed * exp(speed * u) / (exp(speed) - 1)
        r, h = rise / turn, 0.5
        root = sqrt(r * r + h * h)
        total += w * turn * (h * root + r * r * log((h + root) / r))
    return 2 + 4 * total


@pytest.mark.parametrize(("speed", "turn"), [(6, 6), (8, 12), (10, 12)])
def test_faces_that_are_nearly_creased(speed, turn):
    """Along its middle line a face turns over within 2e-4 of its width: a rule of one span sees
    an area that is off by 6e-6 there."""
    report = pc.compile_part(turning_bar(speed, turn)).report
    area = turning_bar_area(speed, turn)
    assert report.equation.area == pytest.approx(area, rel=1e-10)
    assert report.solid.area == pytest.approx(area, rel=1e-7)
    assert report.solid.volume == pytest.approx(5, rel=1e-7)


def over_profile(function) -> float:
    """The integral over [0, 1], by Gauss rules of 20 places on 400 pieces."""
    x, weight = np.polynomial.legendre.leggauss(20)
    places = (np.arange(400)[:, None] + (x + 1) / 2) / 400
    return float((function(places) * weight).sum() / 800)


def steep_cubic(u):
    return 1 + 100 * u * (u - 0.5) ** 2


def chebyshev_8(u):
    t = 2 * u - 1
    return 1 + 0.4 * (128 * t**8 - 256 * t**6 + 160 * t**4 - 32 * t**2 + 1)


def needle_like_power(u):
    return 1 + 40 * u**8


@pytest.mark.parametrize("profile", [steep_cubic, chebyshev_8, needle_like_power])
def test_steep_extrusions(profile):
    """The speed along the profile nearly vanishes, on the scale of its steepest places, at each of
    its tops: a rule over the whole span sees an area that is off by 1e-5 and more."""
    slope = Polynomial(profile(Polynomial([0.0, 1.0])).coef).deriv()
    volume = over_profile(profile)
    area = 1 + profile(0) + profile(1) + 2 * volume
    area += over_profile(lambda u: np.sqrt(1 + slope(u) ** 2))
    part = pc.compile_part((U, V, W * profile(U)))
    assert {face.carrier for face in part.report.faces} == {"plane", "extrusion"}
    assert part.report.solid.area == pytest.approx(float(area), rel=1e-11)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-12)


def test_steep_revolution():
    """The same profile turned: the meridian's span is halved, and not the turn."""
    radius, turn = chebyshev_8(V), 2 * pc.pi * U
    part = pc.compile_part((W * radius * pc.cos(turn), W * radius * pc.sin(turn), V))
    assert {face.carrier for face in part.report.faces} == {"plane", "revolution"}
    assert part.report.solid.area == pytest.approx(part.report.equation.area, rel=1e-11)
    assert part.report.solid.volume == pytest.approx(part.report.equation.volume, rel=1e-12)


def one_over(x):
    return 1 / x


def jump(x):
    return (x > 1 / 3) + 0.0


def reached(function):
    """The integral of a function over [0, 1]."""

    def rule(cells, orders):
        x, weight = np.polynomial.legendre.leggauss(orders[0])
        width = cells[:, 1] - cells[:, 0]
        nodes = cells[:, :1] + width[:, None] * (x + 1) / 2
        return (function(nodes) * weight / 2).sum(axis=1)[:, None] * width[:, None]

    return settled(rule, np.array([[0.0, 1.0]]), 1, 1e-12, lambda sizes: sizes)


def test_a_jump_is_found_by_halving():
    assert reached(jump)[0] == pytest.approx(2 / 3, abs=1e-11)


def test_what_does_not_settle_is_never_returned():
    with pytest.raises(KernelError, match="do not settle"):
        reached(one_over)


def test_what_is_no_number_does_not_settle():
    def rule(cells, orders):
        return np.where(cells[:, :1] < 0.5, np.nan, 1.0) * np.ones((len(cells), 5))

    cells = np.array([[0.0, 0.5], [0.5, 1.0]])
    with pytest.raises(KernelError, match="do not settle"):
        settled(rule, cells, 1, 1e-12, lambda sizes: np.ones(5))


def test_periodic_curves_of_parameters_are_read():
    poles = Array1OfPnt2d(1, 3)
    for k, place in enumerate([(0, 0), (2, 0), (1, 1)], start=1):
        poles.SetValue(k, gp_Pnt2d(*place))
    knots, often = Array1OfReal(1, 4), Array1OfInteger(1, 4)
    for k in range(1, 5):
        knots.SetValue(k, float(k))
        often.SetValue(k, 1)
    curve = Geom2d_BSplineCurve(poles, knots, often, 2, True)
    t = np.array([1.0, 1.3, 2.5, 3.9, 4.0])
    wanted = [(curve.Value(x).X(), curve.Value(x).Y()) for x in t.tolist()]
    assert path_function(curve).jet(t)[0] == pytest.approx(np.array(wanted), abs=1e-14)


def test_a_periodic_surface_is_integrated_over_one_period():
    place = gp_Ax3(gp_Pnt(1, 2, 3), gp_Dir(0, 0, 1))
    side = Geom_RectangularTrimmedSurface(Geom_CylindricalSurface(place, 2.0), 0, 2 * pi, 0, 3)
    surface = GeomConvert.SurfaceToBSplineSurface_s(side)
    surface.SetUPeriodic()
    assert surface.IsUPeriodic()
    flux, area, *_ = patch_integrals([read_patch(surface, np.array([1.0, 2.0, 3.0]))])[0]
    assert area == pytest.approx(2 * pi * 2 * 3, rel=1e-13)
    assert flux == pytest.approx(2 * area, rel=1e-13)
    assert clamped(surface).Bounds() == surface.Bounds()
    assert clamped(surface).UMultiplicity(1) == surface.UDegree() + 1


def test_splines_of_the_same_knots_are_integrated_together_as_one_by_one():
    knots = np.array([0.0] * 4 + [0.2, 0.45, 0.7] + [1.0] * 4)
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(7.0), np.arange(7.0), [0.0], indexing="ij"), -1)[:, :, 0]
    for width in (3, 4):
        patches = []
        for _ in range(3):
            poles = np.concatenate((grid, np.ones((7, 7, 1))), axis=-1)[..., :width]
            poles[..., 2:] += 0.2 * rng.random((7, 7, width - 2))
            patches.append(Patch(poles, (knots, knots), (3, 3)))
        together = patch_integrals(patches, SECOND)
        alone = [patch_integrals([patch], SECOND)[0] for patch in patches]
        np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-12)


def plate(axis, radius):
    """A plane face within an ellipse, which is a rational spline."""
    place = gp_Ax2(gp_Pnt(1, 2, 3), gp_Dir(*axis))
    curve = GeomConvert.CurveToBSplineCurve_s(Geom_Ellipse(place, radius, 1.0))
    wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(curve).Edge()).Wire()
    return BRepBuilderAPI_MakeFace(wire, True).Face()


def test_plane_faces_within_rational_splines_are_integrated_together():
    plates = [((0, 0, 1), 3.0), ((1, 2, 2), 2.0), ((3, 0, -4), 1.0)]
    found = solid_integrals(compound([plate(*one) for one in plates]))
    areas = [pi * radius for _, radius in plates]
    assert found.face_areas == pytest.approx(areas, rel=1e-12)
    alone = [solid_integrals(plate(*one)).face_areas[0] for one in plates]
    assert alone == pytest.approx(areas, rel=1e-12)


def test_eight_nodes_are_taken_where_six_would_do(monkeypatch):
    def halved(*_):
        raise AssertionError("spans are halved")

    surface = GeomConvert.SurfaceToBSplineSurface_s(Geom_ToroidalSurface(gp_Ax3(), 3.0, 1.0))
    for angle in np.linspace(0, 2 * pi, 10)[1:-1].tolist():
        surface.InsertUKnot(angle, 1, 1e-6)
        surface.InsertVKnot(angle, 1, 1e-6)
    monkeypatch.setattr(_Whole, "_rule_of_halves", halved)
    flux, area, *_ = patch_integrals([read_patch(surface, np.zeros(3))])[0]
    assert area == pytest.approx(4 * pi**2 * 3, rel=1e-13)
    assert flux / 3 == pytest.approx(2 * pi**2 * 3, rel=1e-13)
