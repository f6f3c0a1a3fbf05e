"""Derivatives of a solid's figures: two ways, against closed forms and against differences."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from shipped import LONG, checked_of

import pc2cad as pc
from pc2cad.checked import CheckedMap, check_map
from pc2cad.cli.main import main
from pc2cad.domain.velocity import DIFFERENCES, SYMBOLIC, NotDifferentiableError
from pc2cad.errors import InputError
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import substitute
from pc2cad.integrals.sensitivity import Sensitivity
from pc2cad.templates.file import parse_template
from pc2cad.templates.shipped import template_paths
from pc2cad.templates.template import Template


def template(name: str) -> Template:
    found = pc.read_template(template_paths()[name])
    assert isinstance(found, Template)
    return found


#: smooth in every parameter, and quick: one of each kind of map
QUICK = ("bilinear_top", "cone_frustum", "simplex_torus")
SLOW = sorted(set(template_paths()) - set(QUICK) - set(LONG))


#: numbers of things: a closed form that sums over them holds for whole ones only
WHOLE = {("gerotor", "pins")}


@cache
def every(name: str) -> tuple[Sensitivity, ...]:
    checked = checked_of(name)
    return tuple(checked.sensitivity(p) for p in checked.equation.parameters)


def both_ways_and_closed_forms(name: str) -> None:
    """Hold dV/dp by flux, and dV/dp and dA/dp of what [expect] states, against the integrals."""
    stated, mass = template(name).expected, checked_of(name).mass
    bound = {p.name: p.default for p in template(name).parameters}
    for s in every(name):
        assert s.how == SYMBOLIC
        assert s.volume_by_flux == pytest.approx(s.volume, rel=1e-12, abs=1e-12 * mass.volume)
        if (name, s.parameter) in WHOLE:
            continue
        for figure, size in (("volume", mass.volume), ("area", mass.area)):
            for tree in stated.get((figure,), ()):
                (along,) = substitute(derivatives((tree,), s.parameter), bound)
                wanted = evaluate(along, {})
                assert getattr(s, figure) == pytest.approx(wanted, rel=1e-11, abs=1e-11 * size)


@pytest.mark.parametrize("name", QUICK)
def test_both_ways_and_closed_forms(name: str) -> None:
    assert len(every(name)) > 1
    both_ways_and_closed_forms(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_both_ways_and_closed_forms_of_every_template(name: str) -> None:
    both_ways_and_closed_forms(name)


def moved(name: str, p: str, by: float) -> CheckedMap:
    bound = template(name).bind({p: template(name).bind().parameters[p] + by})
    return check_map(bound)


@pytest.mark.parametrize(
    ("name", "p", "h"),
    [("bilinear_top", "k", 0.02), pytest.param("cone", "h", 0.04, marks=pytest.mark.slow)],
)
def test_all_figures_against_differences(name: str, p: str, h: float) -> None:
    found = checked_of(name).sensitivity(p, density=2.5)
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    places = {k: moved(name, p, k * h) for j in weights for k in (j, -j)}

    def difference(figure) -> np.ndarray:
        values = {k: np.array(figure(at)) for k, at in places.items()}
        return sum(c * (values[k] - values[-k]) for k, c in weights.items()) / h

    for own, figure in (
        (found.area, lambda at: at.mass.area),
        (found.centroid, lambda at: at.mass.centroid),
        (found.mass, lambda at: at.mass_properties(2.5).mass),
        (found.inertia, lambda at: at.mass_properties(2.5).inertia),
    ):
        wanted = difference(figure)
        np.testing.assert_allclose(own, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.slow
def test_guides_given_by_numbers_are_derived_by_differences() -> None:
    """A helix with a round wire: V = π r² L, L = n √((2πR)² + p²)."""
    checked = check_map(template("spring").bind({"turns": "1/2"}))
    at = checked.equation.parameters
    length = 0.5 * np.hypot(2 * np.pi * at["radius"], at["pitch"])
    found = checked.sensitivity("radius")
    wanted = np.pi * at["wire"] ** 2 * 0.5**2 * (2 * np.pi) ** 2 * at["radius"] / length
    assert found.how == DIFFERENCES
    assert abs(found.volume / wanted - 1) < 1e-9
    assert found.relative_error < 1e-7


def test_the_design_velocity_is_the_equations() -> None:
    """Of the ball x = R w …, M/R; of the wedge's turn, u/turn of a full turn about the axis."""
    places = np.array([[0.3, 0.4, 0.5], [0.1, 0.8, 1.0]])
    ball, R = checked_of("ball"), checked_of("ball").equation.parameters["R"]
    speed = ball.sensitivity("R").velocity(places)
    np.testing.assert_allclose(speed, ball.map.points(*places.T) / R, rtol=1e-13)
    wedge = checked_of("ball_wedge")
    turn = wedge.equation.parameters["turn"]
    own = places * [turn, 1, 1]
    x, y, _ = wedge.map.points(*places.T).T
    wanted = np.stack((-y, x, 0 * x), axis=1) * 2 * np.pi * places[:, :1]
    np.testing.assert_allclose(wedge.sensitivity("turn").velocity(own), wanted, atol=1e-12)


def test_a_kink_that_moves_has_no_derivative_and_says_so() -> None:
    text = """
title = "A block with a bend at p"
[parameters]
p = 0.4
q = 1
[solid]
x = "u + abs(u - p)/2"
y = "v"
z = "q*w"
"""
    found = parse_template(text, "bend")
    assert isinstance(found, Template)
    checked = check_map(found.bind())
    assert checked.sensitivity("q").volume == pytest.approx(checked.mass.volume, rel=1e-13)
    with pytest.raises(NotDifferentiableError, match="a kink or a jump of M moves"):
        checked.sensitivity("p")
    with pytest.raises(InputError, match="has no parameter 'z'"):
        checked.sensitivity("z")


GRADED = """
title = "A graded bar"
[parameters]
L = 6
k = 0.3
[domain]
u = [0, "L/6"]
[solid]
x = "6*u*(1 + k*w)"
y = "3*v"
z = "4*w + k*u*v"
[fields]
density = "1 + x/L + k*u + w*y"
"""


@pytest.mark.parametrize("p", ["L", "k", "x"])
def test_a_density_that_is_a_field_changes_too(p: str) -> None:
    """Its formula, the limits of u and the places go with the parameters: polynomials of them.

    A parameter may be called as a coordinate is, which fields do not know then.
    """
    graded = parse_template(GRADED if p == "L" else GRADED.replace("k", p), "graded")
    assert isinstance(graded, Template)
    bound = graded.bind()
    found, h = check_map(bound).sensitivity(p), 1 / 16

    def at(k: int) -> np.ndarray:
        weighed = check_map(graded.bind({p: bound.parameters[p] + k * h})).mass_properties()
        return np.array((weighed.mass, *np.ravel(weighed.inertia)))

    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    wanted = sum(c * (at(k) - at(-k)) for k, c in weights.items()) / h
    own = (found.mass, *np.ravel(found.inertia))
    np.testing.assert_allclose(own, wanted, atol=1e-8 * np.abs(wanted).max())


def test_a_root_of_nothing_has_no_derivative_and_says_so() -> None:
    text = 'title = "t"\nparameters = { p = 0, q = 0 }\n'
    text += 'solid = { x = "u*(1 + sqrt(p))", y = "v", z = "w*(1 + q)" }\n'
    graded = text.replace("sqrt(p)", "q") + 'fields = { density = "1 + sqrt(p)*x" }\n'
    for written in (text, graded):
        found = parse_template(written, "t")
        assert isinstance(found, Template)
        checked = check_map(found.bind())
        assert checked.sensitivity("q").volume > 0
        with pytest.raises(NotDifferentiableError, match=r"to p = 0: division by zero"):
            checked.sensitivity("p")
    with pytest.raises(InputError, match="no velocity with p = 0: division by zero"):
        parse_template(text, "t").bind().with_velocities("q", "p")


def test_a_density_that_jumps_where_places_move_is_refused() -> None:
    jump = parse_template(GRADED.replace("w*y", "if(x > 3, 1, 0)"), "jump")
    assert isinstance(jump, Template)
    with pytest.raises(NotDifferentiableError, match="the field density jumps at places that move"):
        check_map(jump.bind()).sensitivity("k")


def test_pieces_that_begin_elsewhere_are_followed() -> None:
    """A bar round a corner: V = 2 (18 - (2 - π/2) r), and a bend's wall is longer outside."""
    text = """
title = "A bar round a corner"
[parameters]
r = 3
[guide]
kind = "polyline"
points = [[0, 0, 0], [9, 0, 0], [9, 9, 0]]
radius = "r"
[frame]
kind = "rotation-minimising"
[solid]
M = "N + (R-N)*(2*v - 1) + (Q-N)*(w - 1/2)"
"""
    found = parse_template(text, "corner")
    assert isinstance(found, Template)
    derived = check_map(found.bind()).sensitivity("r")
    assert derived.how == DIFFERENCES
    assert derived.volume == pytest.approx(np.pi - 4, rel=1e-10)
    assert derived.volume_by_flux == pytest.approx(np.pi - 4, rel=1e-10)
    assert derived.area == pytest.approx(3 * (np.pi - 4), rel=1e-10)


def test_sides_that_part_are_named() -> None:
    """A section of three waves closes; of three and a bit it does not."""
    text = """
title = "A rod with waves"
[parameters]
n = 3
r = 2
[solid]
x = "w*(r + sin(2*pi*n*u)/5)*cos(2*pi*u)"
y = "w*(r + sin(2*pi*n*u)/5)*sin(2*pi*u)"
z = "v"
"""
    found = parse_template(text, "waves")
    assert isinstance(found, Template)
    checked = check_map(found.bind())
    assert checked.sensitivity("n").parting == ("u=0 and u=1",)
    assert checked.sensitivity("r").parting == ()


def test_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensitivities", "ball", "-s", "R=3", "--density", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["volume"]["R"] == pytest.approx(4 * np.pi * 9, rel=1e-13)
    assert found["area"]["R"] == pytest.approx(8 * np.pi * 3, rel=1e-13)
    assert found["mass"]["R"] == pytest.approx(8 * np.pi * 9, rel=1e-13)
    # 8/15 π ρ R⁵, derived
    wanted = np.eye(3) * 8 / 3 * np.pi * 2 * 81
    np.testing.assert_allclose(found["inertia"]["R"], wanted, atol=1e-9)
    assert np.abs(found["centroid"]["R"]).max() < 1e-12
    assert main(["sensitivities", "cone", "--for", "h"]) == 0
    assert "derivative of the equation" in capsys.readouterr().out
    for arguments, told in (
        (["cone", "--for", "x"], "--for: cone has no parameter 'x' (it has: r, h)"),
        (["pyramid"], "pyramid has no parameters"),
    ):
        assert main(["sensitivities", *arguments]) == 2
        assert told in capsys.readouterr().err
