"""Walls between layers are proved from the innermost and the outermost, where they lie between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

import pc2cad as pc
from pc2cad.channels.layers import depth
from pc2cad.checked import CheckedMap, check_map
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.equation.point_equation import PointEquation, point_equation
from pc2cad.expression.tree import as_expr
from pc2cad.options import CompileOptions
from pc2cad.representation import boundary
from pc2cad.representation.between_faces import between_others, lies_between
from pc2cad.representation.boundary import represent, spline_profile
from pc2cad.representation.boundary_model import BoundaryModel, ModelFace
from pc2cad.representation.plan import Cells

TOLERANCE = 1e-2
Wall = tuple[ModelFace, RestrictedMap]


def wall(*thicknesses: object) -> PointEquation:
    """Return layers on a twisted ring of nearly elliptic section."""
    u, v, w = pc.parameters()
    theta, phi = 2 * pc.pi * u, pc.pi * v / 3
    radial = pc.fourier([(0, 0, 5), (0, 1, -0.5), (1, 0, 1.5), (1, 1, 0.4)], periods=3)
    height = pc.fourier(sin=[(0, 1, 0.5), (1, 0, 1.5), (1, 1, -0.4), (2, 1, 0.1)], periods=3)
    r, z = radial(theta, phi), height(theta, phi)
    deep = depth([as_expr(t) for t in thicknesses])(w)
    along, up = pc.diff(r, u), pc.diff(z, u)
    stretch = pc.hypot(along, up)
    r, z = r + deep * (up / stretch), z - deep * (along / stretch)
    made = point_equation((r * pc.cos(phi), r * pc.sin(phi), z), units="m")
    return made.layered(["a", "b", "c"])


def modelled(equation: PointEquation) -> tuple[CheckedMap, BoundaryModel]:
    checked = check_map(equation)
    return checked, represent(checked, CompileOptions(TOLERANCE))


def walls(checked: CheckedMap, model: BoundaryModel) -> list[Wall]:
    """Return the faces w = const from w = 0 up, and what each carries."""
    cells = Cells(checked, spline_profile(CompileOptions(TOLERANCE)))
    rows = [(face, cells.faces[face.cells[0]]) for face in model.faces]
    return sorted((row for row in rows if row[1].cell[2] % 2 == 0), key=lambda row: row[1].cell[2])


@pytest.fixture(scope="module")
def proved() -> list[object]:
    """Keys of the faces that were proved on their own, after those of `even`."""
    return []


@pytest.fixture(scope="module")
def even(proved: list[object]) -> list[Wall]:
    original = boundary.prove_face

    def prove(face: ModelFace, *rest: object) -> object:
        proved.append(face.key)
        return original(face, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boundary, "prove_face", prove)
        return walls(*modelled(wall(0.1, 0.2, 0.15)))


def test_walls_between_layers_follow_from_two_proofs(
    even: list[Wall], proved: list[object]
) -> None:
    assert len(even) == 4
    splines = [key for key in proved if key in {face.key for face, _ in even}]
    assert set(splines) == {even[0][0].key, even[3][0].key}
    assert len(splines) == 2
    places = np.linspace(0.003, 0.997, 301)
    for face, function in even[1:3]:
        assert face.evidence == "bounded"
        surface = face.carrier
        seen = np.linalg.norm(
            spline_values(surface, places) - function(places, places), axis=-1
        ).max()
        assert seen <= face.deviation <= TOLERANCE
        assert face.deviation <= 2 * max(seen, face.sampled)


def test_fits_of_walls_that_lie_between_are_no_further_off(even: list[Wall]) -> None:
    functions = [function for _, function in even]
    assert between_others(functions) == {1: (0, 3), 2: (0, 3)}
    assert between_others(functions[:2]) == {}
    sampled = [face.sampled for face, _ in even]
    assert max(sampled[1:3]) <= max(sampled[0], sampled[3]) * (1 + 1e-6)


def spline_values(surface: object, places: np.ndarray) -> np.ndarray:
    along, across = (
        BSpline.design_matrix(places, knots, degree).toarray()
        for knots, degree in zip(surface.knots, surface.degrees, strict=True)
    )
    return np.einsum("ai,bj,ijk->abk", along, across, surface.poles)


@pytest.mark.slow
def test_walls_that_lie_elsewhere_are_proved_on_their_own() -> None:
    u, _, _ = pc.parameters()
    waves = pc.cos(2 * pc.pi * u) / 20
    rows = walls(*modelled(wall(0.1 + waves, 0.2, 0.15 - waves)))
    assert all(face.evidence == "bounded" for face, _ in rows)
    ends = rows[0], rows[3]
    assert lies_between(rows[1], *ends) is None


def test_a_wall_that_lies_between_does_so_with_its_poles(even: list[Wall]) -> None:
    found = lies_between(even[2], even[0], even[3])
    assert found is not None
    assert lies_between(even[3], even[0], even[2]) is None  # outside
    moved = even[2][0].carrier.poles + 1e-3
    off = replace(even[2][0], carrier=replace(even[2][0].carrier, poles=moved))
    assert lies_between((off, even[2][1]), even[0], even[3]).deviation > 1e-3
