"""How nodes of meshes and poles of splines move with a parameter, against made anew ones."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

import pc2cad as pc
from pc2cad.arrays import Array
from pc2cad.cli.main import main
from pc2cad.compiler import mesh_equation, spline_equation
from pc2cad.domain.analysis import derive, sample_sides
from pc2cad.domain.restrictions import RestrictedMap
from pc2cad.equation.fields import FieldError
from pc2cad.errors import InputError
from pc2cad.geometry.splines.trivariate import fit_volume
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.representation.volume import turned


@pytest.mark.parametrize(
    ("name", "parameter", "proved"),
    [
        ("cone", "r", True),
        ("torus", "r", False),
        ("elbow_pipe", "R", False),
        pytest.param("channel_ellipse", "delta", True, marks=pytest.mark.slow),
    ],
)
def test_poles_move_as_poles_of_new_fits_do(name: str, parameter: str, proved: bool) -> None:
    """The same linear fit in the same spaces, of M at five values: differences of order 4."""
    template = pc.read_template(name)
    value = template.bind().parameters[parameter]
    model, _ = spline_equation(template.bind().with_velocities(parameter))
    found = model.field(f"velocity_{parameter}")
    step = 1e-3 * value

    def poles(at: float) -> list[Array]:
        analysis = derive(sample_sides(template.bind({parameter: at})))
        return [
            fit_volume(
                turned(RestrictedMap(analysis, patch.cell), model.directions), patch.volume.axes
            ).poles
            for patch in model.patches
        ]

    a, b, c, d = (poles(value + k * step) for k in (1, -1, 2, -2))
    assert len(found.volumes) == len(model.patches) > 0
    for k, volume in enumerate(found.volumes):
        difference = (8 * (a[k] - b[k]) - (c[k] - d[k])) / (12 * step)
        assert np.abs(difference - volume.poles).max() < 1e-8 * np.abs(volume.poles).max()
    assert (found.bound is not None) == proved
    assert found.deviation <= (found.bound or 1e-12)
    # what the poles make deviates from ∂M/∂p as their volume does from M, and no more
    assert (found.bound or found.deviation) < max(10 * model.deviation, 1e-12) * found.largest


def test_nodes_move_as_nodes_of_new_meshes_do(tmp_path: Path) -> None:
    template, options = pc.read_template("elbow_pipe"), MeshOptions(cells=(9, 6, 2), order=2)
    value = template.bind().parameters["R"]
    ahead, behind = (
        mesh_equation(template.bind({"R": value + k * 1e-4}), options)[0].points for k in (1, -1)
    )
    path = tmp_path / "elbow.vtu"
    given = ["--cells", "9x6x2", "--order", "2", "--velocity", "R", "--quiet"]
    assert main(["mesh", "elbow_pipe", *given, "-o", str(path)]) == 0
    read = meshio.read(path)
    moved = read.point_data["velocity_R"]
    np.testing.assert_allclose(moved, (ahead - behind) / 2e-4, atol=1e-8)
    assert read.cell_data["velocity_R"][0].shape[1] == 3


def test_limits_of_the_box_move_places_too() -> None:
    """z = u up to H: ∂M/∂H at the share u/H of the way."""
    template = pc.read_template("cone")
    equation = template.bind().with_velocities("h", "r")
    assert [field.name for field in equation.fields] == ["velocity_h", "velocity_r"]
    part = pc.compile_equation(equation)
    place = [(0.1, 1, 0.5)]
    np.testing.assert_allclose(
        part.field("velocity_h", parameters=place), part.sensitivity("h").velocity(place)
    )


def test_what_has_no_formula_is_refused() -> None:
    with pytest.raises(InputError, match=r"takes \w+ as a number"):
        pc.read_template("spring").bind().with_velocities("pitch")
    with pytest.raises(InputError, match="no parameter 'q'"):
        pc.read_template("cone").bind().with_velocities("q")
    with pytest.raises(FieldError, match="two fields"):
        pc.read_template("cone").bind().with_velocities("r", "r")
