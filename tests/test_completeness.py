"""No edge is missing where boundaries meet: proved where it is so, and never where it is not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from scipy.interpolate import BSpline

import pc2cad as pc
from pc2cad.arrays import Array
from pc2cad.bounds.crossings import Crossings, prove_crossings
from pc2cad.bounds.one_curve import KnownCurve, KnownCurves
from pc2cad.bounds.surface_cells import Border, Region, halved, whole
from pc2cad.brep.booleans import NamedEdge, NamedShape, edges_between
from pc2cad.csg import completeness
from pc2cad.csg.contacts import MissedCrossingError, TouchingBodiesError
from pc2cad.errors import KernelError
from pc2cad.geometry.jets import Jet, Sizes, SurfaceFunction
from pc2cad.geometry.splines.bends import spline_bends
from pc2cad.part import Part
from pc2cad.templates.file import parse_template

AXES = np.eye(3)
EVERYWHERE = np.full(2, -np.inf), np.full(2, np.inf)


# -- bounds of surfaces ----------------------------------------------------------------------------


def second_derivatives(
    poles: Array, knots: tuple[Array, Array], degrees: tuple[int, int], s: Array, t: Array
) -> Array:
    """Return lengths of S_ss, S_st and S_tt of a rational or polynomial spline, (n, 3)."""

    def derived(a: int, b: int) -> Array:
        along = BSpline(knots[0], poles, degrees[0])(s, nu=a)
        return np.array([
            BSpline(knots[1], row, degrees[1])(y, nu=b) for row, y in zip(along, t, strict=True)
        ])  # fmt: skip

    n = {(a, b): derived(a, b) for a in range(3) for b in range(3 - a)}
    if poles.shape[2] == 3:
        found = [n[2, 0], n[1, 1], n[0, 2]]
    else:
        place = {k: v[:, :3] for k, v in n.items()}
        w = {k: v[:, 3:] for k, v in n.items()}
        point = place[0, 0] / w[0, 0]
        first = {k: (place[k] - point * w[k]) / w[0, 0] for k in ((1, 0), (0, 1))}
        found = []
        for k, (i, j) in {
            (2, 0): ((1, 0), (1, 0)), (1, 1): ((1, 0), (0, 1)), (0, 2): ((0, 1), (0, 1))
        }.items():  # fmt: skip
            found.append((place[k] - first[i] * w[j] - first[j] * w[i] - point * w[k]) / w[0, 0])
    return np.stack([np.linalg.norm(x, axis=1) for x in found], axis=1)


@pytest.mark.parametrize("rational", [False, True])
def test_second_derivatives_of_splines_are_bounded_on_boxes(rational: bool) -> None:
    random = np.random.default_rng(20)
    knots = (
        np.array([0, 0, 0, 0, 0.2, 0.5, 0.5, 0.9, 2, 2, 2, 2]),
        np.array([1, 1, 1, 1.5, 3, 3, 3.0]),
    )
    poles = random.normal(size=(8, 4, 3)) + 20
    if rational:
        weights = random.uniform(0.5, 2, (8, 4, 1))
        poles = np.concatenate((poles * weights, weights), axis=2)
    bends = spline_bends(poles, knots, (3, 2))
    low = np.column_stack((random.uniform(0, 1.9, 60), random.uniform(1, 2.9, 60)))
    high = low + random.uniform(0, 1, (60, 2)) * (np.array([2, 3]) - low)
    bound = bends.over(low, high)
    ratios = []
    for k in range(60):
        s, t = (random.uniform(low[k, d], high[k, d], 200) for d in (0, 1))
        seen = second_derivatives(poles, knots, (3, 2), s, t)
        assert (seen <= bound[k]).all()
        ratios.append((seen.max(axis=0) / bound[k]).min())
    assert np.median(ratios) > (0.1 if rational else 0.2)  # and no wider than they have to be


def sphere(radius: float) -> Region:
    def jet(a: Array, b: Array) -> Jet:
        a, b = a[:, None], b[:, None]
        out, across = np.cos(a) * AXES[0] + np.sin(a) * AXES[1], np.cos(a) * AXES[1]
        across = across - np.sin(a) * AXES[0]
        return (
            radius * (np.cos(b) * out + np.sin(b) * AXES[2]),
            radius * np.cos(b) * across,
            radius * (np.cos(b) * AXES[2] - np.sin(b) * out),
        )

    sizes = Sizes((np.inf, radius), (radius,) * 3, np.zeros(3))
    surface = SurfaceFunction(jet, (None, None), (1, 1), lambda: sizes, turns=True)
    return Region(surface, rectangle((0, -pi / 2), (2 * pi, pi / 2)), 0.0, EVERYWHERE)


def rectangle(low: Sequence[float], high: Sequence[float]) -> Border:
    (a, b), (c, d) = low, high
    corners = np.array([[a, b], [c, b], [c, d], [a, d]], dtype=float)
    return Border(corners, np.roll(corners, -1, axis=0), np.zeros(4))


def disc(radius: float, turned: int = 1, count: int = 64) -> Border:
    """A circle about 0 with what is in it on the left of its pieces (or on the right)."""
    t = np.linspace(0, turned * 2 * pi, count + 1)
    places = radius * np.column_stack((np.cos(t), np.sin(t)))
    bows = np.full(count, radius * (2 * pi / count) ** 2 / 8)
    return Border(places[:-1], places[1:], bows, lambda: disc(radius, turned, 4096))


def plane(
    origin: Sequence[float], x: Sequence[float], y: Sequence[float], border: Border
) -> Region:
    start, along, across = (np.array(v, dtype=float) for v in (origin, x, y))

    def jet(a: Array, b: Array) -> Jet:
        shape = (len(a), 3)
        point = start + a[:, None] * along + b[:, None] * across
        return point, np.broadcast_to(along, shape), np.broadcast_to(across, shape)

    sizes = Sizes((1.0, 1.0), (0.0, 0.0, 0.0), np.abs(start))
    flat = SurfaceFunction(jet, (np.empty(0), np.empty(0)), (1, 1), lambda: sizes)
    return Region(flat, border, 0.0, EVERYWHERE)


def test_cells_hold_all_of_a_sphere() -> None:
    face = sphere(2.0)
    assert not face.trimmed
    cells = whole([face])
    for longest in (2.0, 1.0, 0.5):
        cells = halved([face], cells, np.ones(len(cells), dtype=bool), longest)[0]
    random = np.random.default_rng(1)
    for k in range(0, len(cells), 7):
        at = random.uniform(cells.low[k], cells.high[k], (100, 2))
        point = face.surface.jet(at[:, 0], at[:, 1])[0]
        share = (at - cells.low[k] - cells.half[k]) / cells.half[k]
        flat = cells.point[k] + share @ cells.spans[k]
        assert np.linalg.norm(point - flat, axis=1).max() <= cells.error[k] * (1 + 1e-12)
    area = np.linalg.norm(np.cross(cells.spans[:, 0], cells.spans[:, 1]), axis=1).sum() * 4
    assert area == pytest.approx(4 * pi * 4, rel=0.05)  # all of it, once


def test_a_border_tells_cells_outside_and_inside() -> None:
    border = disc(1.0)
    low = np.array([[0.8, 0.8], [0.0, 0.0], [0.66, 0.66], [-3, -3], [-0.2, -0.1]])
    high = low + 0.1
    assert border.outside(low, high).tolist() == [True, False, False, True, False]
    half = Border(border.starts[:32], border.ends[:32], border.bows[:32])
    assert not half.outside(low, high).any()  # it does not close
    assert border.inside(low, high).tolist() == [False, True, False, False, True]


# -- curves that are known exactly -----------------------------------------------------------------


def known(*curves: Array, apart: float = 1e-15) -> dict:
    lines = [KnownCurve(places, closed=False) for places in curves]
    return {(0, 1): lambda count: KnownCurves(lines, apart, 1e-9)}


def proved(first: Region, second: Region, curves: dict, size: float = 4.0) -> Crossings:
    return prove_crossings([first, second], np.arange(2), curves, size)


def circle_arcs(height: float) -> list[Array]:
    """The circle x = height on the unit sphere, on both sides of its seam: (a, b, y, z)."""
    radius, arcs = sqrt(1 - height**2), []
    for start in (-pi / 2, pi / 2):
        t = np.linspace(start, start + pi, 257)
        y, z = radius * np.cos(t), radius * np.sin(t)
        y[[0, -1]] = 0.0
        angle = np.arctan2(y, height)
        angle = np.where(angle < 0, angle + 2 * pi, angle)
        if start > 0:
            angle[[0, -1]] = 2 * pi
        arcs.append(np.column_stack((angle, np.arcsin(z), y, z)))
    return arcs


def across_x(height: float) -> Region:
    return plane((height, 0, 0), (0, 1, 0), (0, 0, 1), rectangle((-2, -2), (2, 2)))


@pytest.mark.parametrize("height", [0.5, 0.99, 1 - 1e-4, 1 - 1e-6])
def test_a_plane_cuts_a_sphere_in_one_circle(height: float) -> None:
    arcs = circle_arcs(height)
    found = proved(sphere(1.0), across_x(height), known(*arcs))
    assert found.open is None
    assert found.within < 1e-6
    for lacking in ([arcs[0]], [arcs[1]], [arcs[0], arcs[1][:200]], [arcs[0][3:], arcs[1]]):
        open_at = proved(sphere(1.0), across_x(height), known(*lacking)).open
        assert open_at is not None
        assert open_at.point[0] == pytest.approx(height, abs=1e-2)
    without = proved(sphere(1.0), across_x(height), {}).open
    assert without is not None
    assert without.missed
    assert np.linalg.norm(without.point) == pytest.approx(1, abs=1e-9)


def test_what_lies_beside_a_sphere_is_proved_to_miss_it() -> None:
    for gap in (1e-1, 1e-3, 1e-6):
        assert proved(sphere(1.0), across_x(1 + gap), {}).open is None
    touching = proved(sphere(1.0), across_x(1.0), {}).open
    assert touching is not None
    assert not touching.missed


def chord(low: float, high: float) -> Array:
    """A line x = y = 0 .. on the plane z = 0 and the upright plane at x = 1/2."""
    y = np.linspace(low, high, 65)
    return np.column_stack((np.full(65, 0.5), y, y, np.zeros(65)))


@pytest.mark.parametrize("turned", [1, -1])
def test_a_curve_ends_at_a_curved_border(turned: int) -> None:
    """A round plate and an upright plane: the chord ends on the circle, wherever the plane goes."""
    plate = plane((0, 0, 0), (1, 0, 0), (0, 1, 0), disc(1.0, turned))
    upright = plane((0.5, 0, 0), (0, 1, 0), (0, 0, 1), rectangle((-3, -3), (3, 3)))
    end = sqrt(3) / 2
    assert plate.trimmed
    assert not plate.border.outside(*(np.array([[x, x]]) for x in (-0.1, 0.1))).any()
    if turned < 0:  # no border of a face runs so, and nothing is concluded from one that does
        assert proved(plate, upright, known(chord(-end, end))).open is not None
        return
    assert proved(plate, upright, known(chord(-end, end))).open is None
    for short in (1e-2, 1e-4, 1e-6):
        assert proved(plate, upright, known(chord(-end, end - short))).open is not None
        assert proved(plate, upright, known(chord(-end + short, end))).open is not None
    assert proved(plate, upright, known(chord(-end, 0), chord(0, end))).open is not None
    cut = plane((0.5, 0, 0), (0, 1, 0), (0, 0, 1), rectangle((-0.25, -3), (0.5, 3)))
    assert proved(plate, cut, known(chord(-0.25, 0.5))).open is None
    assert proved(plate, cut, known(chord(-0.25, 0.4))).open is not None


def test_a_curve_ends_at_slanting_borders() -> None:
    """A triangle and an upright plane: the chord ends on two sides, neither along a parameter."""
    corners = np.array([[-1.0, -1.0], [1.2, -0.7], [0.3, 1.1]])
    border = Border(corners, np.roll(corners, -1, axis=0), np.zeros(3))
    plate = plane((0, 0, 0), (1, 0, 0), (0, 1, 0), border)
    upright = plane((0.5, 0, 0), (0, 1, 0), (0, 0, 1), rectangle((-3, -3), (3, 3)))
    low, high = -1 + 0.3 * 1.5 / 2.2, 1.1 - 1.8 * 0.2 / 0.9
    assert proved(plate, upright, known(chord(low, high))).open is None
    for short in (1e-2, 1e-6):
        assert proved(plate, upright, known(chord(low + short, high))).open is not None
        assert proved(plate, upright, known(chord(low, high - short))).open is not None
    beside = plane((1.21, 0, 0), (0, 1, 0), (0, 0, 1), rectangle((-3, -3), (3, 3)))
    assert proved(plate, beside, {}).open is None


def test_two_sheets_near_one_known_curve_are_not_taken_for_one() -> None:
    """Planes that cross at x = 0 and x = d: with one line known, the other one is not proved."""
    floor = plane((0, 0, 0), (1, 0, 0), (0, 1, 0), rectangle((-1, -1), (1, 1)))
    sizes = Sizes((1.0, 4.0), (0.0, 0.0, 2.0), np.ones(3))
    t = np.linspace(-1, 1, 2049)
    line = np.column_stack((0 * t, t, t, 0 * t))
    for d in (1e-2, 1e-4, 1e-6):
        # a sheet that goes through the floor twice, d apart: z = x (x - d) along x
        def bent(a: Array, b: Array, d: float = d) -> Jet:
            zero, one = np.zeros_like(a), np.ones_like(a)
            return (
                np.column_stack((b, a, b * (b - d))),
                np.column_stack((zero, one, zero)),
                np.column_stack((one, zero, 2 * b - d)),
            )

        sizes = Sizes((1.0, 4.0), (0.0, 0.0, 2.0), np.ones(3))
        surface = SurfaceFunction(
            bent, (np.empty(0), np.empty(0)), (1, 1), lambda sizes=sizes: sizes
        )
        sheet = Region(surface, rectangle((-1, -1), (1, 1)), 0.0, EVERYWHERE)
        other = line + np.array([d, 0, 0, d])
        assert proved(floor, sheet, known(line)).open is not None
        if d >= 1e-2:
            assert proved(floor, sheet, known(line, other)).open is None


# -- bodies ----------------------------------------------------------------------------------------


Body = tuple[str, str, str]


def joined(kind: str, first: Body, second: Body) -> Part:
    text = f'title = "t"\nresult = "{kind}(a, b)"\n'
    for name, (x, y, z) in (("a", first), ("b", second)):
        text += f'[[bodies]]\nname = "{name}"\n[bodies.solid]\nx = "{x}"\ny = "{y}"\nz = "{z}"\n'
    return pc.compile_equation(parse_template(text, "t").bind())


def ellipsoid(radii: Sequence[float], at: Sequence[float] = (0, 0, 0)) -> Body:
    return (
        f"{at[0]} + {radii[0]}*w*cos(pi*(v - 1/2))*cos(2*pi*u)",
        f"{at[1]} + {radii[1]}*w*cos(pi*(v - 1/2))*sin(2*pi*u)",
        f"{at[2]} + {radii[2]}*w*sin(pi*(v - 1/2))",
    )


def box(low: Sequence[float], high: Sequence[float]) -> Body:
    x, y, z = (f"{a} + {b - a}*{p}" for a, b, p in zip(low, high, "uvw", strict=True))
    return x, y, z


def rod(radius: float, low: float, height: float, at: tuple[float, float] = (0, 0)) -> Body:
    x, y = f"{at[0]} + {radius}*w*cos(2*pi*u)", f"{at[1]} + {radius}*w*sin(2*pi*u)"
    return x, y, f"{low} + {height}*v"


def ring(major: float, minor: float) -> Body:
    out = f"({major} + {minor}*w*cos(2*pi*v))"
    return f"{out}*cos(2*pi*u)", f"{out}*sin(2*pi*u)", f"{minor}*w*sin(2*pi*v)"


def loops(part: Part) -> int:
    """Return in how many closed curves two bodies meet: components of edges joined at ends."""
    left = [set(e.ends) for e in part.edges if e.names[0][0].body != e.names[1][0].body]
    count = 0
    while left:
        count, grown = count + 1, left.pop()
        while joining := [ends for ends in left if ends & grown]:
            grown = grown.union(*joining)
            left = [ends for ends in left if ends not in joining]
    return count


def topology(part: Part) -> tuple[str, str]:
    (step,) = part.report.steps
    assert step.topology is not None
    assert bool(step.topology.open) == (step.topology.evidence == "sampled")
    return step.topology.evidence, step.topology.open


CROSSING: list[tuple[str, Body, Body, int]] = [
    ("union", ellipsoid((1, 1, 1)), box((0.5, -2, -2), (3, 2, 2)), 1),
    ("union", ellipsoid((1, 1, 1)), box((0.999, -2, -2), (3, 2, 2)), 1),
    ("union", ellipsoid((1, 1, 1)), box((0.9999, -2, -2), (3, 2, 2)), 1),
    ("cut", ellipsoid((1, 1, 1)), box((1.001, -2, -2), (3, 2, 2)), 0),
    ("cut", ellipsoid((2, 1.5, 1)), rod(0.5, -3, 6, (0.3, 0.2)), 2),
    ("cut", ring(3, 1), box((2.5, -6, -6), (6, 6, 6)), 1),
    ("cut", ring(3, 1), box((1, -6, -6), (6, 6, 6)), 2),
    ("union", box((0, 0, 0), (1, 1, 1)), box((0.5, 0.5, 0.5), (2, 2, 2)), 1),
    ("cut", box((0, 0, 0), (1, 1, 1)), rod(0.5, -1, 3, (0.1, 0.1)), 1),
]


@pytest.mark.parametrize(("kind", "first", "second", "count"), CROSSING)
def test_bodies_that_cross_are_proved_to_meet_in_so_many_loops(
    kind: str, first: Body, second: Body, count: int
) -> None:
    part = joined(kind, first, second)
    assert topology(part) == ("proved", "")
    assert loops(part) == count


def test_a_plane_that_is_tangent_to_a_ring_within_is_refused() -> None:
    """What is left has no thickness there: both its ends are one lemniscate."""
    with pytest.raises(TouchingBodiesError, match=r"a:w=1 and b:u=0 .* in a point at \(2, "):
        joined("cut", ring(3, 1), box((2, -6, -6), (6, 6, 6)))


def test_bodies_that_touch_or_share_a_plane_are_not_proved() -> None:
    cube = box((-1, -1, -1), (1, 1, 1))
    assert topology(joined("union", cube, ellipsoid((1, 1, 1))))[0] == "sampled"
    evidence, where = topology(joined("union", cube, box((0, 0, -1), (2, 2, 2))))
    assert evidence == "sampled"
    assert where.endswith("touch or coincide, or nearly so")


@pytest.mark.parametrize("seed", range(6))
def test_random_ellipsoids_and_planes_meet_as_closed_forms_say(seed: int) -> None:
    """The support of an ellipsoid along a normal says whether a half space's side cuts it."""
    random = np.random.default_rng([20, seed])
    radii = random.uniform(0.5, 2, 3).round(3)
    turn, tilt = random.uniform(0.2, 1.4, 2)
    normal = np.array([cos(turn) * cos(tilt), sin(turn) * cos(tilt), sin(tilt)])
    support = float(np.linalg.norm(radii * normal))
    height = support * (random.uniform(0.2, 0.98) if seed % 2 else random.uniform(1.002, 1.2))
    across = np.cross(normal, AXES[2])
    across /= np.linalg.norm(across)
    axes = 20 * np.array([normal, across, np.cross(normal, across)])
    terms = [
        f"{height * normal[i]:.17g} + {axes[0, i]:.17g}*u + {axes[1, i]:.17g}*(v - 1/2) "
        f"+ {axes[2, i]:.17g}*(w - 1/2)"
        for i in range(3)
    ]
    part = joined("cut", ellipsoid(radii), (terms[0], terms[1], terms[2]))
    assert loops(part) == seed % 2
    beside_a_pole = abs(radii[2] * normal[2] - height) < 0.2
    assert topology(part)[0] == "proved" or beside_a_pole


# -- results that lack an edge ---------------------------------------------------------------------


def lacking(which: Callable[[int], bool]) -> Callable[[NamedShape], Iterator[NamedEdge]]:
    """Return what tells a shape's edges, without some of those between its bodies."""

    def edges(shape: NamedShape) -> Iterator[NamedEdge]:
        number = 0
        for edge in edges_between(shape):
            if edge.names[0][0].body == edge.names[1][0].body:
                yield edge
                continue
            if not which(number):
                yield edge
            number += 1

    return edges


@pytest.mark.parametrize(
    ("bodies", "which"),
    [
        ((ellipsoid((2, 1.5, 1)), rod(0.5, -3, 6, (0.3, 0.2))), lambda k: k == 0),
        ((ellipsoid((2, 1.5, 1)), rod(0.5, -3, 6, (0.3, 0.2))), lambda k: k in (0, 1)),
        ((ring(3, 1), box((1, -6, -6), (6, 6, 6))), lambda k: k == 1),
        ((ring(3, 1), box((2.5, -6, -6), (6, 6, 6))), lambda k: k == 2),
        ((box((0, 0, 0), (1, 1, 1)), box((0.5, 0.5, 0.5), (2, 2, 2))), lambda k: k == 4),
        ((box((0, 0, 0), (1, 1, 1)), rod(0.5, -1, 3, (0.1, 0.1))), lambda k: k == 0),
    ],
)
def test_a_result_without_one_of_its_edges_is_never_proved(
    monkeypatch: pytest.MonkeyPatch,
    bodies: tuple[Body, Body],
    which: Callable[[int], bool],
) -> None:
    monkeypatch.setattr(completeness, "edges_between", lacking(which))
    try:
        evidence = topology(joined("cut", *bodies))[0]
    except KernelError as error:
        evidence = str(error)
    proof = "proved by enclosures, and the CAD kernel has made no edge there"
    assert evidence == "sampled" or proof in evidence


def test_a_loop_that_the_kernel_misses_is_a_crossing_that_is_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(completeness, "edges_between", lacking(lambda number: True))
    with pytest.raises(MissedCrossingError, match="the faces a:w=1 and b:u=0 cross at"):
        joined("cut", ring(3, 1), box((1, -6, -6), (6, 6, 6)))
