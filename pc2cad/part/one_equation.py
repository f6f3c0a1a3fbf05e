"""What is asked of one point equation: of a part that has one, or of a body of several."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from pc2cad.arrays import Array
from pc2cad.equation.point_equation import PointEquation
from pc2cad.options import CompileOptions
from pc2cad.topology.cells import SideKey

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

    from pc2cad.checked import FieldFigures, Stages
    from pc2cad.integrals.inertia import Mass
    from pc2cad.integrals.sensitivity import Sensitivity
    from pc2cad.mesh.grid import Growth
    from pc2cad.mesh.meshing import MeshOptions
    from pc2cad.mesh.report import MeshReport
    from pc2cad.mesh.results import Results
    from pc2cad.mesh.tetrahedra import KernelSolid
    from pc2cad.mesh.volume_mesh import VolumeMesh
    from pc2cad.part import Body
    from pc2cad.representation.volume import VolumeModel
    from pc2cad.sampling.interior import Location, PointSet
    from pc2cad.sampling.voxels import Voxels


class OfOneEquation(ABC):
    """What is asked of the one equation of a part, or of one body of several."""

    @property
    @abstractmethod
    def body(self) -> Body:
        """The one body; SeveralBodiesError where there are several."""

    @property
    def equation(self) -> PointEquation:
        """The point equation."""
        return self.body.checked.equation

    @property
    def kernel_sides(self) -> dict[SideKey, TopoDS_Face]:
        """The kernel's faces by their side, without those between layers."""
        model, built = self.body.model, self.body.built
        return {model.faces[i].key: built.faces[i] for i in model.outer}

    @property
    def side_areas(self) -> dict[SideKey, float]:
        """The equation's area of each of those, in units squared."""
        model, areas = self.body.model, self.body.checked.mass.face_areas
        outer = (model.faces[i] for i in model.outer)
        return {face.key: sum(areas[cell] for cell in face.cells) for face in outer}

    def to_mesh(self) -> KernelSolid:
        """Return what tetrahedra are made of."""
        from pc2cad.mesh.report import by_side
        from pc2cad.mesh.tetrahedra import KernelSolid, NamedSurface
        from pc2cad.mesh.volume_mesh import by_whole_side

        body, layers = self.body, self.layers
        surfaces = [
            NamedSurface(face, tuple(by_whole_side(side)))
            for side, face in self.kernel_sides.items()
        ]
        mass, equation = body.checked.mass, body.checked.equation
        return KernelSolid(
            body.shape, equation.name, equation.units, mass.volume, tuple(surfaces),
            frozenset(side.label for side in self.kernel_sides if side.is_piece),
            by_side(self.side_areas.items()),
            tuple((name, layer, volume) for (name, layer), (volume, _) in
                  zip(layers.items(), mass.layers if layers else (), strict=True)),
        )  # fmt: skip

    @property
    def faces(self) -> dict[str, TopoDS_Face]:
        """The kernel's faces by the name of their side, without those between layers."""
        return {side.label: face for side, face in self.kernel_sides.items()}

    @property
    def layers(self) -> dict[str, TopoDS_Solid]:
        """The solids of a part in layers by name; they share the faces between them."""
        layers = zip(self.body.model.layers, self.body.built.layers, strict=True)
        return {layer.name: solid for layer, solid in layers}

    @property
    def face_areas(self) -> dict[str, float]:
        """The equation's area of each face by the name of its side, without those between layers.

        In units squared.
        """
        return {side.label: area for side, area in self.side_areas.items()}

    def mesh(
        self,
        *,
        cells: tuple[int, int, int] | None = None,
        size: float | None = None,
        order: Literal[1, 2] = 1,
        shape: Literal["hexahedra", "tetrahedra"] = "hexahedra",
        core: Literal["grid", "ogrid"] = "grid",
        grading: Mapping[str, Growth] | None = None,
    ) -> VolumeMesh:
        """Return structured hexahedra of the equation's own (u,v,w) grid, or gmsh's tetrahedra.

        Tetrahedra are of the compiled solid, with its tolerance and its splines.
        `cells` along u, v and w (tetrahedra get the size of as many cubes that fill the volume), or
        the `size` of the longest ones in model units. The `core` at an axis is the grid's own, with
        wedges and pyramids, or an O-grid of hexahedra. Cells grow by the `grading`, ``{"w": 4}``
        (length at the end over that at the start: of n cells the last is 4^((n - 1)/n) times the
        first) or ``{"w": (4, "both")}`` (in the middle over both ends). Raises InputError,
        UnsuitableGridError, or InvertedElementError where the cells are too coarse.
        """
        from pc2cad.mesh.grid import gradings
        from pc2cad.mesh.meshing import MeshOptions

        options = MeshOptions(cells, size, order, shape, gradings(grading or {}), core)
        return self.meshed(options)[0]

    def meshed(
        self, options: MeshOptions, stages: Stages | None = None
    ) -> tuple[VolumeMesh, MeshReport]:
        """Return the mesh that `mesh` returns, and the report on it."""
        from pc2cad.mesh.meshing import mesh_solid, mesh_volume

        if options.shape == "tetrahedra":
            return mesh_solid(self.to_mesh(), self.body.checked, options, stages)
        return mesh_volume(self.body.checked, options, stages)

    def splines(
        self,
        tolerance: float | None = None,
        *,
        degree: int | None = None,
        max_degree: int | None = None,
        profile: str = "compact",
    ) -> VolumeModel:
        """Return the volume itself as trivariate splines, exact where M is polynomial or rational.

        `tolerance` bounds the distance elsewhere; it and the rest are those of `compile_equation`.
        """
        from pc2cad.representation.volume import represent_volume

        options = CompileOptions(tolerance, degree, max_degree, profile)
        return represent_volume(self.body.checked, options)

    def sample(
        self,
        count: int = 1000,
        *,
        method: Literal["uniform", "blue"] = "uniform",
        seed: int = 0,
    ) -> PointSet:
        """Return random points of the interior, uniform in space or kept apart (blue noise)."""
        from pc2cad.sampling.interior import sample_blue, sample_uniform

        draw = sample_blue if method == "blue" else sample_uniform
        return draw(self.body.checked, count, seed)

    def mass_properties(self, density: float | str | Mapping[str, float] | None = None) -> Mass:
        """Return mass, centre of mass, inertia about it, principal moments and axes, and radii.

            part.mass_properties(density=7.85e-6).principal      # kg/mm^3 gives kg and kg mm^2

        One density for all, one for each layer by name, or the name of the field that is it
        (``density`` where there is one and nothing is given; else 1). From the equation: closed
        form where M is a rational polynomial, else with an error estimate. Raises InputError.
        """
        return self.body.checked.mass_properties(density)

    def sensitivity(
        self, name: str, density: float | str | Mapping[str, float] | None = None
    ) -> Sensitivity:
        """Return d/dp of volume, area, centroid, mass and inertia, and ∂M/∂p wherever it is asked.

            part.sensitivity("r").volume            # mm^3 per unit of r

        Raises InputError for a name of no parameter, and NotDifferentiableError.
        """
        return self.body.checked.sensitivity(name, density)

    def field(
        self, name: str, points: ArrayLike | None = None, *, parameters: ArrayLike | None = None
    ) -> Array:
        """Return a field's values (n,), or (n, 3), at points in space or at u, v, w (n, 3 each).

            part.field("temperature", [(1, 2, 0.5)])

        For a point outside the solid it is the value at the nearest place. Raises InputError for a
        name of no field, and FieldNotFiniteError.
        """
        from pc2cad.sampling.fields import field_values

        return field_values(self.body.checked, name, points, parameters)

    def voxels(self, fields: Sequence[str] = (), count: int | None = None) -> Voxels:
        """Return a box of voxels: what is inside, and scalar fields there.

            part.voxels(["temperature"], 128).values["temperature"]     # (nz, ny, nx)

        `count` along the longest edge (64). Raises InputError and FieldNotFiniteError.
        """
        from pc2cad.sampling.voxels import USUAL, voxels

        return voxels(self.body.checked, fields, USUAL if count is None else count)

    def field_figures(self, name: str) -> FieldFigures:
        """Return integral, mean, least and largest value of a field, and how they are known.

        Raises InputError for a name of no field, and where it has no finite integral.
        """
        return self.body.checked.field_figures(name)

    def locate(self, points: ArrayLike) -> Location:
        """Return for points (n, 3) whether they are inside, and the nearest (u, v, w)."""
        from pc2cad.sampling.interior import locate

        return locate(self.body.checked, points)

    def read_results(self, path: str | os.PathLike[str]) -> Results:
        """Return what CalculiX found on a mesh of this part (.frd), with u, v, w of its nodes.

        The file's coordinates have six digits: so have the parameters.

        Raises InputError, with the line, where the file is none.
        """
        from pc2cad.mesh.results import read_results

        found = read_results(path)
        return replace(found, parameters=self.locate(found.points).parameters)
