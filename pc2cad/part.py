"""A compiled part: the solid, the report on it, and the ways out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from pc2cad.brep.build import BuiltSolid
from pc2cad.checked import CheckedMap
from pc2cad.equation.point_equation import PointEquation
from pc2cad.export.model import (
    Exportable,
    ExportOptions,
    GeometricProperties,
    NamedFace,
    NamedSolid,
)
from pc2cad.export.registry import write
from pc2cad.options import CompileOptions
from pc2cad.report import BodiesReport, Integrals, Report
from pc2cad.representation.boundary_model import BoundaryModel, ModelFace
from pc2cad.topology.cells import Cell, normal_direction

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

    from pc2cad.mesh.volume_mesh import VolumeMesh
    from pc2cad.representation.volume import VolumeModel
    from pc2cad.sampling.interior import Location, PointSet

#: lower and upper side of u, v and w: distinguishable also for colour-blind eyes (Okabe, Ito)
SIDE_COLOURS = (
    ((0.90, 0.62, 0.00), (0.84, 0.37, 0.00)),
    ((0.34, 0.71, 0.91), (0.00, 0.45, 0.70)),
    ((0.00, 0.62, 0.45), (0.80, 0.47, 0.65)),
)


class Solid:
    """One validated solid: what a part of one equation and one of several bodies have in common."""

    report: Report | BodiesReport

    @property
    def shape(self) -> TopoDS_Solid:
        """The kernel's solid, in the model's units."""
        raise NotImplementedError

    @property
    def named_faces(self) -> tuple[tuple[str, TopoDS_Face], ...]:
        """The kernel's faces, each with its name."""
        raise NotImplementedError

    def exportable(self, colours: bool = False) -> Exportable:
        """Return what the writers take."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """The solid's title, its name where there is none."""
        return self.report.title or self.report.name

    def to_cadquery(self) -> Any:
        """Return the solid as a `cadquery.Solid` (imports CadQuery)."""
        from cadquery import Solid as CadQuerySolid

        return CadQuerySolid(self.shape)

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        colours: bool = False,
        options: ExportOptions | None = None,
    ) -> None:
        """Write a file, its format by the name's ending; it appears whole or not at all.

        `colours` paints each side of the box, or each body, its own colour. Raises InputError for
        an unknown ending, FileNotWrittenError or KernelError.
        """
        write(self.exportable(colours), path, options)

    def triangle_integrals(self, deflection: float | None = None) -> Integrals:
        """Return volume, area and centroid of the triangles that an STL file would hold.

        They are meshed for this alone. `deflection` is the largest distance of a chord from its
        surface, in model units; None chooses it as the STL writer does.
        """
        from pc2cad.brep.triangle_integrals import triangle_integrals
        from pc2cad.brep.triangles import tessellate

        own = self.report.integrals
        mesh = tessellate(self.shape, deflection=deflection, volume=own.volume, area=own.area)
        found = triangle_integrals(mesh.vertices, mesh.triangles)
        source = f"{len(mesh.triangles)} triangles, deflection {mesh.deflection:.3g}"
        return Integrals(source, found.volume, found.area, found.centroid)


@dataclass(frozen=True, eq=False)
class Part(Solid):
    """One validated solid of one point equation."""

    checked: CheckedMap
    model: BoundaryModel
    built: BuiltSolid
    report: Report

    @property
    def equation(self) -> PointEquation:
        """The point equation."""
        return self.checked.equation

    @property
    def shape(self) -> TopoDS_Solid:
        """The kernel's solid, in the equation's units."""
        return self.built.solid

    @property
    def faces(self) -> dict[str, TopoDS_Face]:
        """The kernel's faces by the name of their side, without those between layers."""
        return dict(self.named_faces)

    @property
    def layers(self) -> dict[str, TopoDS_Solid]:
        """The solids of a part in layers by name; they share the faces between them."""
        return {x.name: s for x, s in zip(self.model.layers, self.built.layers, strict=True)}

    @property
    def named_faces(self) -> tuple[tuple[str, TopoDS_Face], ...]:
        """The kernel's faces, each with the name of its side, without those between layers."""
        return tuple((self.model.faces[i].name, self.built.faces[i]) for i in self.model.outer)

    @property
    def face_areas(self) -> dict[str, float]:
        """The equation's area of each face by the name of its side, without those between layers.

        In units squared.
        """
        areas, outer = self.checked.mass.face_areas, (self.model.faces[i] for i in self.model.outer)
        return {face.name: sum(areas[cell] for cell in face.cells) for face in outer}

    def mesh(
        self,
        *,
        cells: tuple[int, int, int] | None = None,
        size: float | None = None,
        order: Literal[1, 2] = 1,
        shape: Literal["hexahedra", "tetrahedra"] = "hexahedra",
        core: Literal["grid", "ogrid"] = "grid",
    ) -> VolumeMesh:
        """Return structured hexahedra of the equation's own (u,v,w) grid, or gmsh's tetrahedra.

        Tetrahedra are of this part's solid, with its tolerance and its splines.
        `cells` along u, v and w, or the `size` of the longest ones in model units. The `core` at an
        axis is the grid's own, with wedges and pyramids, or an O-grid of hexahedra. Raises
        UnsuitableGridError, or InvertedElementError where the cells are too coarse.
        """
        from pc2cad.mesh.meshing import MeshOptions, mesh_solid, mesh_volume

        options = MeshOptions(cells, size, order, shape, core=core)
        if shape == "tetrahedra":
            return mesh_solid(self, options)[0]
        return mesh_volume(self.checked, options)[0]

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
        return represent_volume(self.checked, options)

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
        return draw(self.checked, count, seed)

    def locate(self, points: ArrayLike) -> Location:
        """Return for points (n, 3) whether they are inside, and the nearest (u, v, w)."""
        from pc2cad.sampling.interior import locate

        return locate(self.checked, points)

    def exportable(self, colours: bool = False) -> Exportable:
        """Return what the writers take."""
        named = [
            NamedFace(face.name, kernel, self._colour(face) if colours else None)
            for face, kernel in zip(self.model.faces, self.built.faces, strict=True)
        ]
        outer = self.model.outer
        return Exportable(
            solid=self.built.solid,
            name=self.title,
            description=self.equation.about.strip(),
            units=self.equation.units,
            faces=tuple(f for i, f in enumerate(named) if i in outer),
            interfaces=tuple(f for i, f in enumerate(named) if i not in outer),
            layers=tuple(NamedSolid(*item) for item in self.layers.items()),
            properties=GeometricProperties(
                self.report.equation.volume,
                self.report.equation.area,
                self.report.equation.centroid,
            ),
            tolerance=self.report.tolerance,
            evidence=self.report.statements(),
        )

    def _colour(self, face: ModelFace) -> tuple[float, float, float]:
        return side_colour(self.model.complex.faces[face.cells[0]].patch)


def side_colour(patch: Cell) -> tuple[float, float, float]:
    """Return the colour (red, green, blue in 0…1) of a side of the box, or of a piece of one."""
    direction = normal_direction(patch)
    return SIDE_COLOURS[direction][1 if patch[direction] else 0]
