"""Pieces keep their exactness: choices become breaks of one parameter, and faces of their own."""

from __future__ import annotations

from fractions import Fraction
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pc2cad as pc
from pc2cad.errors import NotASolidError
from pc2cad.expression.breaks import BreaksNotAlignedError, find_breaks
from pc2cad.expression.choices import CHOICES
from pc2cad.expression.evaluation import Program
from pc2cad.expression.kinks import take_kinks_apart
from pc2cad.expression.tree import Expr, pieces, walk

u, v, w = pc.parameters()
THIRD = Fraction(1, 3)


def split(tree: Expr) -> Expr:
    (found,) = take_kinks_apart((tree,), (u, v, w))
    return found


SQUARES = pieces(
    3 * u * u, (Fraction(0), Fraction(1), Fraction(2), Fraction(3)),
    tuple((c, 2 * c + 1) for c in (pc.pi * 0, pc.pi * 0 + 1, pc.pi * 0 + 4)), 0, closed=False,
)  # fmt: skip
#: tree -> where it changes, and how smooth it is there
CHANGES = {
    "condition": (pc.where(u < THIRD, u, THIRD), [(1 / 3, 0)]),
    "smooth": (pc.where(u <= THIRD, u * u, 2 * u * THIRD - THIRD**2), [(1 / 3, 1)]),
    "wave": (pc.where(pc.sin(3 * u) > 1 / 2, 1 / 2, pc.sin(3 * u)),
             [(pi / 18, 0), (5 * pi / 18, 0)]),
    "joined": (pc.where((u < 0.2) | (u > 0.7), 0, (u - 0.2) * (0.7 - u)), [(0.2, 0), (0.7, 0)]),
    "both": (pc.where((u >= 0.2) & ~(u > 0.7), (u - 0.2) * (0.7 - u), 0), [(0.2, 0), (0.7, 0)]),
    "smaller": (pc.minimum(u, 1 - u, 0.4), [(0.4, 0), (0.6, 0)]),
    "larger": (pc.maximum(u * u, v * 0 + 0.25), [(0.5, 0)]),
    "clamped": (pc.clamp(2 * u - 0.5, 0, 1), [(0.25, 0), (0.75, 0)]),
    "remainder": (pc.mod(3 * u, 1), [(1 / 3, 0), (2 / 3, 0)]),
    "remainder of another": (pc.mod(u * u, 0.25), [(0.5, 0), (0.75**0.5, 0), (0.5**0.5, 0)]),
    "whole part": (pc.floor(2.5 * u), [(0.4, 0), (0.8, 0)]),
    "within a root": (pc.sqrt(pc.minimum(u, 0.5) + 1), [(0.5, 0)]),
    "below a quotient": (1 / pc.maximum(u, 0.5), [(0.5, 0)]),
    "in another's formula": (pc.where(u < v * 0 + 0.5, v * u, v * (1 - u)), [(0.5, 0)]),
    "table of a square": (SQUARES, [(3**-0.5, 0), ((2 / 3) ** 0.5, 0)]),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_choices_become_pieces_and_keep_their_values(name: str) -> None:
    tree, expected = CHANGES[name]
    found = split(tree)
    assert CHOICES.isdisjoint(node.op for node in walk((found,)))
    breaks = [(b.position, b.smoothness) for b in find_breaks((found,))[0]]
    assert breaks == [(pytest.approx(x), order) for x, order in sorted(expected)]
    jumps = np.array([x for x, _ in expected])[:, None] + np.array([-1e-9, 1e-9])
    places = np.concatenate((np.linspace(0, 1 - 1e-9, 499), jumps.ravel()))
    places = places[np.abs(places[:, None] - [x for x, _ in expected]).min(axis=1) > 1e-12]
    values, wanted = (Program((t,))({"u": places, "v": 0.3})[0] for t in (found, tree))
    assert np.abs(values - wanted).max() < 1e-13


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.integers(-99, 99), st.integers(-99, 99)), min_size=2, max_size=5))
def test_the_least_of_lines_is_pieces_of_them(lines: list[tuple[int, int]]) -> None:
    trees = [Fraction(a, 32) * u + Fraction(b, 32) for a, b in lines]
    found = split(pc.minimum(*trees))
    places = np.linspace(0, 1, 301)
    (values,) = Program((found,))({"u": places})
    wanted = np.min([(a * places + b) / 32 for a, b in lines], axis=0)
    assert np.abs(values - wanted).max() < 1e-12
    assert "min" not in {node.op for node in walk((found,))}


def test_roots_that_begin_at_a_choice_keep_it() -> None:
    tree = pc.sqrt(pc.maximum(u - THIRD, 0))
    (values,) = Program((split(tree),))({"u": np.array([0.0, 1 / 3, 0.5, 1.0])})
    assert np.isfinite(values).all()


CURVES = {
    "smaller": pc.minimum(u, v), "condition": pc.where(u + v < 0.8, 1, u * v),
    "whole part": pc.floor(2 * u * v + v), "remainder": pc.mod(u + v, 0.5),
}  # fmt: skip


@pytest.mark.parametrize("name", CURVES)
def test_kinks_along_a_curve_are_refused_with_its_course(name: str) -> None:
    with pytest.raises(BreaksNotAlignedError, match=r"along a curve through u = .*, v = .*; ") as e:
        split(CURVES[name])
    assert "\n" not in str(e.value)


def revolved(rho: Expr, z: Expr) -> pc.Part:
    turn = 2 * pc.pi * v
    return pc.compile_part(pc.point(rho * pc.cos(turn), rho * pc.sin(turn), z))


#: crown R and knuckle a of a dished end over its diameter -> volume over D³
ENDS = {
    "DIN 28011": (Fraction(1), Fraction(1, 10), 0.0989659951180835),
    "DIN 28013": (Fraction(8, 10), Fraction(154, 1000), 0.130771733521775),
    "ASME": (Fraction(1), Fraction(6, 100), 0.0809990042911516),
}


@pytest.mark.parametrize("name", ENDS)
def test_a_dished_end_is_a_sphere_and_a_torus(name: str) -> None:
    R, a, volume = ENDS[name]
    full = pc.asin((Fraction(1, 2) - a) / (R - a))
    alpha, beta = full * pc.minimum(2 * u, 1), (pc.pi / 2 - full) * pc.maximum(2 * u - 1, 0)
    rho = R * pc.sin(alpha) + a * (pc.sin(full + beta) - pc.sin(full))
    z = R * pc.cos(alpha) + a * (pc.cos(full + beta) - pc.cos(full))
    part = revolved(1000 * rho, 1000 * w * (z - (R - a) * pc.cos(full)))
    assert part.report.solid.volume == pytest.approx(volume * 1e9, rel=1e-9)
    assert sorted(face.carrier for face in part.report.faces) == ["plane", "sphere", "torus"]
    assert all(face.evidence == "exact" for face in part.report.faces)


def test_a_camber_in_two_parabolas_is_exact() -> None:
    m, p = Fraction(2, 100), Fraction(4, 10)
    camber = pc.where(
        u < p, m / p**2 * (2 * p * u - u**2), m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * u - u**2)
    )
    part = pc.compile_part(pc.point(100 * u, 30 * v, 100 * camber + 2 * w))
    assert part.report.solid.volume == pytest.approx(6000, rel=1e-12)
    assert all(face.evidence == "exact" for face in part.report.faces)
    assert len(part.report.faces) == 6


def test_a_saw_has_a_face_for_each_flank() -> None:
    saw = pc.minimum(pc.mod(3 * u, 1), 1 - pc.mod(3 * u, 1))
    part = pc.compile_part(pc.point(10 * u, 5 * v, w + saw))
    assert part.report.solid.volume == pytest.approx(50, rel=1e-12)
    assert len(part.report.faces) == 4 + 2 * 6


@pytest.mark.parametrize("step", [pc.floor(3 * u), pc.where(u < 0.5, 0, 1), pc.sign(u - 0.4)])
def test_steps_are_no_solid(step: Expr) -> None:
    with pytest.raises(NotASolidError, match="the map jumps near u = "):
        pc.compile_part(pc.point(10 * u, 5 * v, w + step))


def test_points_are_chosen_like_numbers() -> None:
    straight, bent = pc.point(0, 0, u), pc.point(0, (u - 0.5) ** 2, u)
    part = pc.compile_part(pc.where(u < 0.5, straight, bent) + pc.vector(v, w, 0))
    assert part.report.solid.volume == pytest.approx(1, rel=1e-12)
