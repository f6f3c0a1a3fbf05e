"""A compiled part: the solid, the report on it, and the ways out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.brep.build import BuiltSolid
from pc2cad.brep.inspect import bounding_box
from pc2cad.checked import CheckedMap, Stages
from pc2cad.errors import require
from pc2cad.export.colours import side_colour
from pc2cad.export.files import by_ending, write_atomically
from pc2cad.export.model import (
    Exportable,
    ExportOptions,
    GeometricProperties,
    NamedFace,
    NamedSolid,
)
from pc2cad.export.registry import check_holds_fields, write
from pc2cad.part.one_equation import OfOneEquation
from pc2cad.report import Integrals, Report, SeveralBodiesError
from pc2cad.representation.boundary_model import BoundaryModel

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

    from pc2cad.brep.booleans import NamedEdge
    from pc2cad.integrals.inertia import Mass
    from pc2cad.integrals.sensitivity import Sensitivity
    from pc2cad.mesh.meshing import MeshOptions
    from pc2cad.mesh.report import MeshReport
    from pc2cad.mesh.tetrahedra import KernelSolid
    from pc2cad.mesh.volume_mesh import VolumeMesh
    from pc2cad.part.several import BodiesSensitivity, Several
    from pc2cad.sampling.formulas import FieldFormula
    from pc2cad.topology.cells import Cell, SideKey

#: share by which a receipt may find figures off, with as much to spare for what it integrates
SEEN: Final = 5e-7


@dataclass(frozen=True, eq=False)
class Body(OfOneEquation):
    """One point equation with its solid, by itself: all of a part, or an operand of Booleans."""

    checked: CheckedMap
    model: BoundaryModel
    built: BuiltSolid
    report: Report

    @property
    def body(self) -> Body:
        """The body itself."""
        return self

    @property
    def shape(self) -> TopoDS_Solid:
        """The kernel's solid, in the equation's units."""
        return self.built.solid

    def patches(self, key: SideKey) -> list[Cell]:
        """Return the patches of the box that a face is made of, by the key of its side."""
        own = replace(key, body="")
        (face,) = (face for face in self.model.faces if face.key == own)
        return [self.model.complex.faces[cell].patch for cell in face.cells]


@dataclass(frozen=True, eq=False, repr=False)
class Part(OfOneEquation):
    """One validated solid, of one point equation or of several bodies joined by Booleans."""

    bodies: Mapping[str, Body]
    #: the kernel's solid, in the part's units
    shape: TopoDS_Solid
    #: the faces of its boundary with their names, and colours that tell sides or bodies apart
    surface: tuple[NamedFace, ...]
    report: Report
    #: edges between differently named faces, where Booleans have made them
    edges: tuple[NamedEdge, ...] = ()
    about: str = ""
    #: of several bodies: what they know of themselves as a whole
    several: Several | None = None

    def to_mesh(self) -> KernelSolid:
        """Return what tetrahedra are made of."""
        return self.body.to_mesh() if self.several is None else self.several.regions()

    def mass_properties(self, density: float | str | Mapping[str, float] | None = None) -> Mass:
        """Return mass, centre of mass, inertia about it, principal moments and axes, and radii.

            part.mass_properties(density=7.85e-6).principal      # kg/mm^3 gives kg and kg mm^2

        One density for all, one for each layer or body by name, or the name of the field that is it
        (``density`` where there is one and nothing is given; else 1). From the equation: closed
        form where M is a rational polynomial, else with an error estimate; of several bodies, from
        the B-rep. Raises InputError, also where bodies overlap whose densities differ.
        """
        if self.several is not None:
            return self.several.mass(density)
        return super().mass_properties(density)

    def sensitivity(  # type: ignore[override]
        self, name: str, density: float | str | Mapping[str, float] | None = None
    ) -> Sensitivity | BodiesSensitivity:
        """Return d/dp of volume, area, centroid, mass and inertia, and ∂M/∂p wherever it is asked.

            part.sensitivity("r").volume            # mm^3 per unit of r

        Of several bodies that of the area may be None (see `BodiesSensitivity`). Raises InputError
        for a name of no parameter, and NotDifferentiableError.
        """
        if self.several is not None:
            return self.several.sensitivity(name, density)
        return super().sensitivity(name, density)

    def meshed(
        self, options: MeshOptions, stages: Stages | None = None
    ) -> tuple[VolumeMesh, MeshReport]:
        """Return the mesh that `mesh` returns, and the report on it.

        Tetrahedra of several bodies have a set for each region (of the places that lie in the same
        bodies) and for each body's side; hexahedra need bodies that share whole sides. Raises
        SidesNotSharedError besides.
        """
        if self.several is None:
            return self.body.meshed(options, stages)
        if options.shape == "tetrahedra":
            from pc2cad.mesh.meshing import mesh_solid

            return mesh_solid(self.to_mesh(), None, options, stages)
        from pc2cad.mesh.joined import Whole, mesh_joined

        report, checked = self.report, {name: body.checked for name, body in self.bodies.items()}
        whole = Whole(report.name, report.units, report.solid.volume, report.solid.area)
        return mesh_joined(checked, whole, options, stages or Stages())

    @property
    def body(self) -> Body:
        """The one body; SeveralBodiesError where there are several, or copies of one."""
        if self.several is not None:
            raise SeveralBodiesError(self.report.name, self.bodies)
        return next(iter(self.bodies.values()))

    @property
    def checked(self) -> CheckedMap:
        """What is known of the one equation."""
        return self.body.checked

    @property
    def model(self) -> BoundaryModel:
        """The boundary of the one equation's solid, before the kernel."""
        return self.body.model

    @property
    def built(self) -> BuiltSolid:
        """The kernel's solid of the one equation, face by face of the model."""
        return self.body.built

    @property
    def named_faces(self) -> tuple[tuple[str, TopoDS_Face], ...]:
        """The kernel's faces, each with the name of its side, without those between layers.

        Of several bodies it is ``body:side``, and several faces may be parts of one side.
        """
        return tuple((face.name, face.face) for face in self.surface)

    def exportable(
        self, colours: bool = False, fields: Sequence[str] = (), voxels: int | None = None
    ) -> Exportable:
        """Return what the writers take, with scalar fields.

        They are formulas of the place where they can be, unless so many voxels are asked for.
        """
        report = self.report
        formulas, pictured = self._formulas(fields) if fields and voxels is None else ({}, {})
        others = [name for name in fields if name not in formulas]
        held = self.voxels(others, voxels) if others else None
        layers, between = (self.layers, _between(self.body)) if self.several is None else ({}, ())
        return Exportable(
            solid=self.shape,
            name=self.title,
            description=self.about.strip(),
            units=report.units,
            faces=_painted(self.surface, colours),
            interfaces=_painted(between, colours),
            layers=tuple(NamedSolid(*item) for item in layers.items()),
            properties=_properties(report),
            tolerance=report.tolerance,
            evidence=report.statements(),
            voxels=held,
            formulas=formulas,
            pictured=pictured,
        )

    def _formulas(
        self, fields: Sequence[str]
    ) -> tuple[Mapping[str, FieldFormula], Mapping[str, str]]:
        from pc2cad.sampling.formulas import field_formulas

        if self.several is not None:
            return self.several.formulas(fields), {}
        return field_formulas(self.checked, fields)

    def __repr__(self) -> str:
        return f"<Part {self.name}: {self.report.summary}>"

    def _repr_png_(self) -> bytes | None:
        picture: bytes | None = _outside("picture.image").notebook_picture(self)
        return picture

    def render(
        self,
        path: str | os.PathLike[str],
        *,
        view: str | tuple[float, float, float] = "iso",
        size: tuple[int, int] = (960, 640),
        **style: Any,
    ) -> None:
        """Write a picture, .png or .svg by the name's ending.

            part.render("duct.png", view="front", colours=True)

        `view` is iso, front, back, left, right, top, bottom, or a direction to the eye; `size` in
        pixels; the rest is `Style`'s. Raises InputError, FileNotWrittenError, NoRendererError.
        """
        draw = _outside("picture.image").picture_of
        write_atomically(path, draw(self, path, view=view, size=size, **style))

    def view(self, path: str | os.PathLike[str]) -> None:
        """Write a self-contained page (.html) to turn the part on; InputError for other names."""
        by_ending(path, {".html": None, ".htm": None}, "page")
        write_atomically(path, _outside("viewer.payload").page_of(self))

    def show(self) -> None:
        """Open that page in the browser."""
        _outside("viewer.payload").open_page(self)

    @property
    def name(self) -> str:
        """The part's name."""
        return self.report.name

    @property
    def units(self) -> str:
        """The unit of its lengths: mm, cm, m or in."""
        return self.report.units

    @property
    def volume(self) -> float:
        """Of the equation, in units cubed; of several bodies, of the solid."""
        return self.report.integrals.volume

    @property
    def area(self) -> float:
        """Of the whole boundary, in units squared; as `volume`."""
        return self.report.integrals.area

    @property
    def center(self) -> tuple[float, float, float]:
        """The centroid of the volume, in units; as `volume`."""
        return self.report.integrals.centroid

    @property
    def is_exact(self) -> bool:
        """Whether every face and edge is exact."""
        return self.report.evidence == "exact"

    @cached_property
    def bounding_box(self) -> Array:
        """The least and the largest coordinates of the solid, (2, 3), in units."""
        return bounding_box(self.shape)

    @cached_property
    def inertia(self) -> Array:
        """The tensor of inertia about the centroid for density 1, (3, 3), units^5; one body's."""
        return np.array(self.mass_properties().inertia)

    @property
    def title(self) -> str:
        """The solid's title, its name where there is none."""
        return self.report.title or self.report.name

    def to_cadquery(self) -> Any:
        """Return the solid as a `cadquery.Solid`; PackageMissingError without CadQuery.

        It has triangles for viewers, which no file of this part holds.
        """
        require("cadquery", "CadQuery's solids", "cadquery")
        from cadquery import Solid as CadQuerySolid

        from pc2cad.brep.display import attach_for_display

        attach_for_display(self.shape)
        return CadQuerySolid(self.shape)

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        colours: bool = False,
        fields: Sequence[str] = (),
        voxels: int | None = None,
        options: ExportOptions | None = None,
    ) -> None:
        """Write a file, its format by the name's ending; it appears whole or not at all.

        `colours` paints each side of the box, or each body, its own colour. A .3mf file holds
        scalar `fields` too: as functions of x, y, z, with M inverted in them; where that does
        not hold to 1e-9, or `voxels` is given, on so many along its longest edge (64). Raises
        InputError for an unknown ending, FileNotWrittenError or KernelError.
        """
        check_holds_fields(path, fields)
        write(self.exportable(colours, fields, voxels), path, options)

    def triangle_integrals(self, deflection: float | None = None) -> Integrals:
        """Return volume, area and centroid of the triangles that an STL file would hold.

        `deflection` in model units; None chooses it as the STL writer does.
        """
        from pc2cad.brep.triangle_integrals import triangle_integrals
        from pc2cad.brep.triangles import tessellate

        own = self.report.integrals
        mesh = tessellate(self.shape, deflection=deflection, volume=own.volume, area=own.area)
        found = triangle_integrals(mesh.vertices, mesh.triangles)
        source = f"{len(mesh.triangles)} triangles, deflection {mesh.deflection:.3g}"
        return Integrals(source, found.volume, found.area, found.centroid)


def _outside(name: str) -> Any:
    """Return a module of the outside, which is above this room: looked up when a user asks."""
    return import_module(f"pc2cad.{name}")


def part_of(body: Body) -> Part:
    """Return the part that one body is."""
    faces = tuple(_named(body, index) for index in body.model.outer)
    equation = body.equation
    return Part({equation.name: body}, body.shape, faces, body.report, about=equation.about)


def _between(body: Body) -> tuple[NamedFace, ...]:
    """Return the faces between the layers of a body."""
    outer, count = body.model.outer, len(body.model.faces)
    return tuple(_named(body, index) for index in range(count) if index not in outer)


def _properties(report: Report) -> GeometricProperties:
    """Return what a file states: the equation's figures, or those of the solid that it holds.

    A receiver integrates what it reads: under a loose tolerance the equation's would look false.
    """
    best, solid = report.integrals, report.solid
    off = float(np.linalg.norm(np.subtract(best.centroid, solid.centroid)))
    if (
        abs(best.volume - solid.volume) > SEEN * solid.volume
        or abs(best.area - solid.area) > SEEN * solid.area
        or off > SEEN * report.size
    ):
        best = solid
    return GeometricProperties(best.volume, best.area, best.centroid)


def _named(body: Body, index: int) -> NamedFace:
    face = body.model.faces[index]
    colour = side_colour(body.model.complex.faces[face.cells[0]].patch)
    return NamedFace(face.name, body.built.faces[index], colour, face.key.whole.label)


def _painted(faces: tuple[NamedFace, ...], colours: bool) -> tuple[NamedFace, ...]:
    return faces if colours else tuple(replace(face, colour=None) for face in faces)
