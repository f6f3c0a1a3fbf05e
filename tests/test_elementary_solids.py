"""The elementary solids of the simplex ABCD, with sectors, holes and walls by domain alone."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.compiler import compile_equation
from pc2cad.report import Report
from pc2cad.templates.shipped import template_paths

#: |det(A-D, B-D, C-D)| of the oblique simplex that the templates come with, and another
SIMPLEX = 24
#: template, other values -> volume / |det|, faces, edges, genus of the shells
FAMILY = {
    ("quad_pyramid", ""): (1 / 3, 5, 8, (0,)),
    ("quad_pyramid", "top=1/2"): (7 / 24, 6, 12, (0,)),
    ("simplex_cone", "k=1"): (pi, 3, 2, (0,)),
    ("simplex_cone", "k=0"): (pi / 3, 2, 1, (0,)),
    ("simplex_cone", "k=1/2"): (pi * 7 / 12, 3, 2, (0,)),
    ("simplex_cone", "k=1/2 hole=0.9"): (pi * 7 / 12 * 0.19, 4, 4, (1,)),
    ("simplex_cone", "k=0 hole=1/2"): (pi / 4, 3, 2, (0,)),
    ("simplex_cone", "k=1/2 turn=1/3 hole=1/2"): (pi * 7 / 48, 6, 12, (0,)),
    ("simplex_ball", ""): (4 * pi / 3, 1, 0, (0,)),
    ("simplex_ball", "turn=1/4"): (pi / 3, 3, 3, (0,)),
    ("simplex_ball", "hole=0.99"): (4 * pi / 3 * (1 - 0.99**3), 2, 0, (0, 0)),
    ("simplex_ball", "turn=1/4 hole=1/2"): (pi / 3 * 7 / 8, 4, 6, (0,)),
    ("simplex_paraboloid", ""): (pi / 2, 2, 1, (0,)),
    ("simplex_paraboloid", "turn=1/2 hole=1/2"): (pi * 3 / 16, 5, 8, (0,)),
    ("simplex_hyperboloid", ""): (8 * pi / 3, 3, 2, (0,)),
    ("simplex_hyperboloid", "turn=1/2 hole=1/2"): (pi, 6, 12, (0,)),
    ("simplex_torus", ""): (2 * pi**2 * 0.4, 1, 0, (1,)),
    ("simplex_torus", "hole=0.9"): (2 * pi**2 * 0.4 * 0.19, 2, 0, (1, 1)),
    ("simplex_torus", "turn=1/2 epsilon=1/2"): (pi**2 / 2, 3, 2, (0,)),
    ("simplex_torus", "turn=1/2 epsilon=1/2 hole=1/2"): (pi**2 * 3 / 8, 4, 4, (1,)),
}


def report_of(template: str, settings: str, **points: object) -> Report:
    values = dict(pair.split("=") for pair in settings.split())
    equation = pc.read_template(template_paths()[template]).bind(values)
    return compile_equation(equation.move(**points) if points else equation).report


@pytest.mark.parametrize(("template", "settings"), FAMILY)
def test_volume_and_topology(template, settings):
    share, faces, edges, genus = FAMILY[template, settings]
    report = report_of(template, settings)
    assert report.equation.volume == pytest.approx(SIMPLEX * share, rel=1e-12)
    assert report.solid.volume == pytest.approx(SIMPLEX * share, rel=1e-7)
    assert (len(report.faces), report.edges, report.genus) == (faces, edges, genus)


@pytest.mark.parametrize("template", sorted({name for name, _ in FAMILY}))
def test_any_simplex(template):
    """Moved and turned, and left-handed: the volume goes with the determinant alone."""
    points = {"A": (2, 7, 1), "B": (5, 3, 2), "C": (1, 4, 6), "D": (1, 3, 1)}
    a, b, c, d = (np.array(points[name]) for name in "ABCD")
    size = abs(np.linalg.det([a - d, b - d, c - d]))
    share = FAMILY[next(key for key in FAMILY if key[0] == template)][0]
    values = "k=1" if template == "simplex_cone" else ""
    report = report_of(template, values, **points)
    assert report.equation.volume == pytest.approx(size * share, rel=1e-12)
    assert report.solid.volume == pytest.approx(size * share, rel=1e-7)


def patch_volume(a, b, c, d) -> float:
    """∫ S·(S_u × S_v)/3 of the bilinear patch a, b (u), c (v), d: both its triangulations' mean."""
    det = np.linalg.det
    return (det([a, b, d]) + det([a, d, c]) + det([a, b, c]) + det([b, d, c])) / 12


def test_hexahedron_by_its_faces():
    template = pc.read_template(template_paths()["hexahedron"])
    corner = {
        d.name[1:]: np.array([float(c.payload) for c in d.value.coordinates])
        for d in template.points
    }
    total = 0.0
    for axis in range(3):
        for limit, sign in (("0", -1), ("1", 1)):
            keys = [f"{s}{t}" for t in "01" for s in "01"]
            names = [key[:axis] + limit + key[axis:] for key in keys]
            total += sign * (-1) ** axis * patch_volume(*(corner[n] for n in names))
    assert total == pytest.approx(533 / 12, rel=1e-13)
    report = report_of("hexahedron", "")
    assert report.solid.volume == pytest.approx(total, rel=1e-13)
    assert (len(report.faces), report.edges, report.vertices) == (6, 12, 8)
    assert report.evidence == "exact"
