"""Piecewise generators: corners become edges between faces, smoother breaks become knots."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np
import pytest
from consumers.step_file import check_step

import pc2cad as pc
from pc2cad.expression.breaks import Break, find_breaks, resolve_pieces
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import number, pieces, substitute, walk

u, v, w = pc.parameters()
HALF = number(Fraction(1, 2))
RECTANGLE = [(2, 1), (-2, 1), (-2, -1), (2, -1)]
HEXAGON_OF_SPEC = [(2, 0), (1, 1.5), (-1, 1.8), (-2.2, 0.2), (-1.2, -1.4), (0.8, -1.7)]


def checked(part: pc.Part, path: Path) -> pc.Part:
    part.write(path / "part.step")
    step = check_step(path / "part.step")
    assert step.volume == pytest.approx(part.report.solid.volume, rel=1e-9)
    assert len(step.faces) == len(part.report.faces)
    return part


def test_square_duct_has_ten_plane_faces_and_its_caps_are_whole(tmp_path: Path) -> None:
    x, y = pc.polygon(RECTANGLE, v)
    part = checked(pc.compile_part((x * (1 + w / 4), y * (1 + w / 4), 5 * u)), tmp_path)
    report = part.report
    assert Counter(f.carrier for f in report.faces) == {"plane": 10}
    assert report.evidence == "exact"
    assert (report.edges, report.vertices, report.genus, report.euler) == (24, 16, (1,), 0)
    assert report.solid.volume == pytest.approx(5 * 8 * (25 / 16 - 1), rel=1e-13)
    caps = [f for f in report.faces if f.name in ("u=0", "u=1")]
    assert [f.area for f in caps] == pytest.approx([4.5, 4.5], rel=1e-12)


def test_solid_bar_of_a_polygon_is_a_prism(tmp_path: Path) -> None:
    x, y = pc.polygon(HEXAGON_OF_SPEC, v)
    part = checked(pc.compile_part((x * w, y * w, 3 * u)), tmp_path)
    corners = np.array(HEXAGON_OF_SPEC)
    following = np.roll(corners, -1, axis=0)
    area = abs(np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0])) / 2
    assert part.report.solid.volume == pytest.approx(3 * area, rel=1e-13)
    assert (len(part.report.faces), part.report.edges, part.report.vertices) == (8, 18, 12)


def test_closed_ring_of_a_rectangular_tube_has_two_shells(tmp_path: Path) -> None:
    x, y = pc.polygon(RECTANGLE, v)
    r, z, turn = 6 + x * (1 + w / 4), y * (1 + w / 4), 2 * pc.pi * u
    part = checked(pc.compile_part((r * pc.cos(turn), r * pc.sin(turn), z)), tmp_path)
    assert part.report.genus == (1, 1)
    # Pappus: both rectangles have their centroid on the circle of radius 6
    volume = 2 * pi * 6 * 8 * (25 / 16 - 1)
    assert part.report.equation.volume == pytest.approx(volume, rel=1e-12)
    assert part.report.solid.volume == pytest.approx(volume, rel=1e-7)


def test_sector_of_a_polygon_has_two_more_faces() -> None:
    x, y = pc.polygon(RECTANGLE, v)
    part = pc.compile_part((x * (1 + w / 4), y * (1 + w / 4), 5 * u), {"v": (0, 0.5)})
    assert {f.name for f in part.report.faces} >= {"v=0", "v=0.5"}
    assert part.report.solid.volume == pytest.approx(11.25, rel=1e-13)


def test_contour_prism_is_exact_with_the_contours_nodes_as_knots(tmp_path: Path) -> None:
    x, y = pc.contour(HEXAGON_OF_SPEC, v)
    part = checked(pc.compile_part((x * w, y * w, 5 * u)), tmp_path)
    wall = next(f for f in part.report.faces if f.name == "w=1")
    assert (wall.carrier, wall.evidence, wall.degrees) == ("B-spline surface", "exact", (1, 3))
    # six cubic arcs, C1 at the five inner nodes: 4 + 5·2 poles
    assert wall.poles == (2, 14)
    # the area that spec section 2.5 gives for this contour
    assert part.report.solid.volume == pytest.approx(5 * 46859 / 4000, rel=1e-13)


def test_contour_starting_between_two_nodes_is_the_same_solid() -> None:
    x, y = pc.contour(HEXAGON_OF_SPEC, v + 1 / 12)
    part = pc.compile_part((x * w, y * w, 5 * u))
    assert part.report.solid.volume == pytest.approx(5 * 46859 / 4000, rel=1e-13)


def test_open_pieces_go_on_and_may_be_any_functions() -> None:
    breaks = tuple(map(Fraction, (0, "1/2", 1)))
    line = pieces(u, breaks, ((number(0), number(1)), (HALF, number(3))), 0, closed=False)
    (slope,) = derivatives((line,), "u")
    for place, value, rise in ((-1, -1, 1), (0.25, 0.25, 1), (0.75, 1.25, 3), (1, 2, 3), (2, 5, 3)):
        assert evaluate(line, {"u": place}) == pytest.approx(value)
        assert Program((line, slope))({"u": np.array(float(place))}) == pytest.approx((value, rise))
        (folded,) = substitute((line,), {"u": number(place)})
        assert folded is number(Fraction(value))
    arc = pieces(u, breaks, ((pc.sin(pc.pi * u),), (1 + v - v * pc.cos(u),)), 1, closed=False)
    assert find_breaks((arc,)) == ((Break(0.5, 1),), (), ())
    (slope,) = derivatives((arc,), "u")
    assert slope.payload.smoothness == 0
    assert evaluate(slope, {"u": 0.25, "v": 9}) == pytest.approx(pi * np.cos(pi / 4))
    assert evaluate(slope, {"u": 0.75, "v": 9}) == pytest.approx(9 * np.sin(0.75))
    (only,) = resolve_pieces(substitute((arc,), {"u": HALF + HALF * u}))
    assert not any(node.op == "pieces" for node in walk((only,)))


@pytest.mark.parametrize("extra", [(), ((0, 1),), ((0.3, 1), (0, 1))])
def test_a_corner_on_a_straight_side_is_no_vertex(extra):
    corners = ((1, 1), *extra, (-1, 1), (-1, -1), (1, -1))
    x, y = pc.polygon(corners, v)
    report = pc.compile_part((x * w, y * w, 3 * u)).report
    assert (len(report.faces), report.edges, report.vertices) == (6, 12, 8)
    assert report.solid.volume == pytest.approx(12, rel=1e-12)


TRIANGLE = [(10, 0), (10, 10), (0, 10)]


@pytest.mark.parametrize(
    ("low", "high", "inside"),
    [
        # about (0, 0) the third side is seen from behind
        ("0", "2/3", 0), ("1/3", "2/3", 0), ("1/6", "2/3", 0), ("4/3", "5/3", 0), ("-1", "-1/3", 0),
        ("0", "1/3", 8), ("-1/3", "0", 8), ("-2/3", "-1/3", 8), ("1/3", "1/2", 8),
        ("-1/6", "1/6", 8), ("1/6", "1/3", 8),
    ],
)  # fmt: skip
def test_a_domain_that_ends_on_a_break_belongs_to_the_piece_inside(
    low: str, high: str, inside: int
) -> None:
    x, y = pc.polygon([(a - inside, b - inside) for a, b in TRIANGLE], v)
    domain = {"v": (Fraction(low), Fraction(high))}
    part = pc.compile_part((x * (1 + w), y * (1 + w), u), domain)
    corners = [np.array(c, dtype=float) - inside for c in TRIANGLE]

    def at(t: Fraction) -> np.ndarray:
        k, share = divmod(3 * t, 1)
        return corners[int(k) % 3] * float(1 - share) + corners[int(k + 1) % 3] * float(share)

    stops = sorted(
        {Fraction(low), Fraction(high)}
        | {Fraction(k, 3) for k in range(-6, 7) if Fraction(low) < Fraction(k, 3) < Fraction(high)}
    )
    doubled = sum(float(np.cross([*at(a), 0], [*at(b), 0])[2]) for a, b in pairwise(stops))
    assert part.report.solid.volume == pytest.approx(1.5 * doubled, rel=1e-12)
    assert len(part.report.faces) == 4 + 2 * (len(stops) - 1)


def test_the_end_of_an_open_curve_belongs_to_the_piece_inside() -> None:
    # beyond 1/2 the line turns back
    breaks = tuple(map(Fraction, (0, "1/2", 1)))
    line = pieces(u, breaks, ((number(0), number(1)), (HALF, number(-3))), 0, closed=False)
    for domain in ((0, HALF), (Fraction(1, 4), HALF), (-1, HALF)):
        part = pc.compile_part((line, v, w), {"u": domain})
        length = Fraction(1, 2) - Fraction(str(domain[0]))
        assert part.report.solid.volume == pytest.approx(float(length), rel=1e-13)
        assert len(part.report.faces) == 6
    part = pc.compile_part((-line, -v, w), {"u": (HALF, 1)})
    assert part.report.solid.volume == pytest.approx(1.5, rel=1e-13)


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0.1, 0.12), (0.4, 0.5), (-1, 2), (0.99, 1)])
def test_pieces_of_pieces_are_worked_out_as_one_by_one(low: float, high: float) -> None:
    breaks = tuple(Fraction(k, 9) for k in range(10))
    inner = pieces(v, breaks, tuple((pc.cos(k * u), number(k)) for k in range(9)), 0, closed=False)
    outer = pieces(u, breaks, tuple((pc.sin(k * v) * u, inner - k) for k in range(9)), 0)
    bent = pieces(inner / 20, breaks, tuple((pc.sin(k * u),) for k in range(9)), 0, closed=False)
    fixed = pieces(pc.pi / 4, breaks, tuple((number(k),) for k in range(9)), 0)
    trees = (outer, bent, outer * bent + fixed, fixed, u)
    program, rng = Program(trees), np.random.default_rng(1)
    for _ in range(3):
        places = {"u": rng.uniform(low, high, 30), "v": rng.uniform(low, high, 30)}
        table = np.stack([np.broadcast_to(column, 30) for column in program(places)])
        for i in range(30):
            at = {name: float(row[i]) for name, row in places.items()}
            assert table[:, i] == pytest.approx([evaluate(tree, at) for tree in trees], rel=1e-13)
