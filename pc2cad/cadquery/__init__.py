"""Point solids in CadQuery: free functions, and two methods on `cadquery.Workplane`.

    import cadquery as cq
    import pc2cad.cadquery as pcq

    duct = cq.Workplane().channelSolid("ellipse", delta=0.3)
    duct.faces(tag="u=0")                                  # faces know their side of the box
    solid = pcq.point_solid("pyramid_cut", p=0.3)          # a cadquery.Solid
    solid.part.report.evidence                             # 'exact'
    cq.Workplane().rarray(20, 20, 2, 2).invoke(pcq.placed("pyramid"))

Importing this module registers `Workplane.pointSolid`, `Workplane.channelSolid` and
`Workplane.pointParts`; importing it again, as CQ-editor does at every render, replaces them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pc2cad.errors import require

require("cadquery", "pc2cad.cadquery and its methods", "cadquery")

import cadquery as cq  # noqa: E402

from pc2cad.cadquery import reloading  # noqa: E402

reloading.restore(cq)  # before anything loads what may be loaded once only

from OCP.Bnd import Bnd_Box  # noqa: E402
from OCP.BOPTools import BOPTools_AlgoTools3D  # noqa: E402
from OCP.BRep import BRep_Tool  # noqa: E402
from OCP.BRepBndLib import BRepBndLib  # noqa: E402
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex  # noqa: E402
from OCP.BRepExtrema import BRepExtrema_DistShapeShape  # noqa: E402
from OCP.gp import gp_Pnt, gp_Pnt2d  # noqa: E402
from OCP.IntTools import IntTools_Context  # noqa: E402

from pc2cad.api import parameters as parameters  # noqa: E402
from pc2cad.api import points as points  # noqa: E402
from pc2cad.brep.display import attach_for_display  # noqa: E402
from pc2cad.compiler import compile_solid  # noqa: E402
from pc2cad.equation.point_equation import (  # noqa: E402
    Domain,
    Equation,
    PointEquation,
    point_equation,
)
from pc2cad.errors import InputError  # noqa: E402
from pc2cad.export.model import NamedFace  # noqa: E402
from pc2cad.options import CompileOptions  # noqa: E402
from pc2cad.part import Part  # noqa: E402
from pc2cad.templates.bodies import Bodies, BodiesTemplate  # noqa: E402
from pc2cad.templates.file import read_template  # noqa: E402
from pc2cad.templates.shipped import find_template, template_paths  # noqa: E402
from pc2cad.templates.template import Template  # noqa: E402

#: a template's name or file, a template, an equation in any form that `compile_part` takes, a part
Source = (
    str | os.PathLike[str] | Template | BodiesTemplate | PointEquation | Bodies | Equation
    | Part
)  # fmt: skip
#: True or "a": fuse with the chain's solid; "cut" or "s": cut from it; False: keep apart
CombineMode = bool | str

#: names that a context keeps the compiled parts under
_PARTS = "pc2cad_parts"


class PluginClashError(InputError):
    """Another plugin has given Workplane a method of the same name."""


def point_solid(
    source: Source,
    domain: Domain | None = None,
    *,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    **parameters: Any,
) -> cq.Solid:
    """Compile a point equation into a `cadquery.Solid`.

    `source` is the name or file of a template, a `Template`, a point equation M(u,v,w), three
    coordinates (also SymPy's), or a compiled `Part`. `parameters` are values of a template's
    parameters; `domain`, `tolerance` (model units), `degree`, `max_degree` and `profile` are as in
    `compile_part`.

    The solid has the attributes ``part`` (the `Part` with its report) and ``label``; what CadQuery
    derives from it is another solid and has no ``part``. Raises what `compile_part` raises.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    part = _compile(source, domain, options, parameters)
    return _solid(part, cq.Location())


def channel_solid(
    channel: Source = "ellipse",
    domain: Domain | None = None,
    *,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    **parameters: Any,
) -> cq.Solid:
    """Compile a channel: a section carried along a guide, with a wall.

    `channel` is the section of a shipped channel, ``"ellipse"``, ``"sine"`` or ``"contour"``, or
    whatever `point_solid` takes. The rest is as there.
    """
    return point_solid(
        _channel(channel), domain, tolerance=tolerance, degree=degree, max_degree=max_degree,
        profile=profile, **parameters,
    )  # fmt: skip


def placed(
    source: Source,
    domain: Domain | None = None,
    *,
    combine: CombineMode = True,
    clean: bool = True,
    prefix: str = "",
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    **parameters: Any,
) -> Callable[[cq.Workplane], cq.Workplane]:
    """Return a function for `Workplane.invoke` that puts a point solid at every stack point.

    Points are local to the workplane; without any, its origin is taken. `combine` and `clean` are
    CadQuery's. Each face of the result that comes from a side of the box is tagged with the side's
    name after `prefix`, ``wp.faces(tag="w=1")``, and with ``w1``, which constraints of assemblies
    can spell; a piece of a side has its own tag besides. The compiled parts of a chain are at
    `Workplane.pointParts`. Raises what `compile_part` raises.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    part = _compile(source, domain, options, parameters)

    def place(workplane: cq.Workplane) -> cq.Workplane:
        copies: list[cq.Solid] = []

        def copy(location: cq.Location) -> cq.Solid:
            copies.append(_solid(part, location))  # eachpoint moves it into the workplane
            return copies[-1]

        result = workplane.eachpoint(copy, True, combine, clean)
        for solid in () if combine else result.vals():
            solid.part = part  # cleaning makes new objects of the same point sets
        sides = _sides(part, copies, result)
        for name in (name for face in part.surface for name in _names(face)):
            for tag in (prefix + name, prefix + _plain(name)):
                result.ctx.tags.pop(tag, None)  # of an earlier solid in the chain
                if name in sides:
                    result.ctx.tags[tag] = result.newObject(sides[name])
        vars(result.ctx).setdefault(_PARTS, []).append(part)
        return result

    return place


def register() -> None:
    """Give `cadquery.Workplane` the methods pointSolid, channelSolid and pointParts.

    Doing so again does no harm. Raises PluginClashError where another plugin was first.
    """
    for method in (pointSolid, channelSolid, pointParts):
        there = getattr(cq.Workplane, method.__name__, None)
        if there is not None and getattr(there, "__module__", "") != __name__:
            raise PluginClashError(
                f"cadquery.Workplane has a method {method.__name__} already, from "
                f"{getattr(there, '__module__', 'elsewhere')}; use the functions of "
                f"{__name__} instead of its methods"
            )
        setattr(cq.Workplane, method.__name__, method)


def pointSolid(
    self: cq.Workplane,
    source: Source,
    domain: Domain | None = None,
    combine: CombineMode = True,
    clean: bool = True,
    prefix: str = "",
    *,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    **parameters: Any,
) -> cq.Workplane:
    """Put a point solid at every stack point; see `pc2cad.cadquery.placed`."""
    return placed(
        source, domain, combine=combine, clean=clean, prefix=prefix, tolerance=tolerance,
        degree=degree, max_degree=max_degree, profile=profile, **parameters,
    )(self)  # fmt: skip


def channelSolid(
    self: cq.Workplane,
    channel: Source = "ellipse",
    domain: Domain | None = None,
    combine: CombineMode = True,
    clean: bool = True,
    prefix: str = "",
    *,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    **parameters: Any,
) -> cq.Workplane:
    """Put a channel at every stack point; see `pc2cad.cadquery.channel_solid` and `placed`."""
    return pointSolid(
        self, _channel(channel), domain, combine, clean, prefix, tolerance=tolerance,
        degree=degree, max_degree=max_degree, profile=profile, **parameters,
    )  # fmt: skip


def pointParts(self: cq.Workplane) -> tuple[Part, ...]:
    """Return the compiled parts of this chain, with their reports, in the order of their making."""
    return tuple(vars(self.ctx).get(_PARTS, ()))


def _plain(name: str) -> str:
    """Return a side's name as constraints of assemblies can spell it: ``w1`` for ``w=1``."""
    return "".join(c if c.isalnum() else "" if c == "=" else "_" for c in name)


def _channel(channel: Source) -> Source:
    shipped = f"channel_{channel}"
    return shipped if isinstance(channel, str) and shipped in template_paths() else channel


def _compile(
    source: Source,
    domain: Domain | None,
    options: CompileOptions,
    parameters: Mapping[str, Any],
) -> Part:
    if isinstance(source, (str, os.PathLike)):
        source = read_template(find_template(os.fspath(source)))
    if isinstance(source, (Template, BodiesTemplate)):
        source = source.bind(parameters)
    elif parameters:
        raise InputError(
            f"only a template has parameters, and {next(iter(parameters))} was given with "
            "something else"
        )
    if isinstance(source, Part):
        return source
    if not isinstance(source, (PointEquation, Bodies)):
        source = point_equation(source, domain)
    elif domain is not None:
        raise InputError("the domain belongs to the template or the point equation already")
    part = compile_solid(source, options)
    reloading.keep(cq)
    return part


def _solid(part: Part, location: cq.Location) -> cq.Solid:
    attach_for_display(part.shape)
    solid = cq.Solid(part.shape).moved(location)
    solid.part = part
    solid.label = part.title
    return solid


def _sides(
    part: Part, copies: Iterable[cq.Solid], result: cq.Workplane
) -> dict[str, list[cq.Face]]:
    """Return the faces of the result that lie on each side of the copies; sides cut away miss."""
    found: dict[str, list[cq.Face]] = {}
    faces = [face for shape in result.vals() if isinstance(shape, cq.Shape)
             for face in shape.Faces()]  # fmt: skip
    same = {face: face for face in faces}
    probes = [_Probe(face) for face in faces]
    for copy in copies:
        for named in part.surface:
            side = cq.Face(named.face.Moved(copy.wrapped.Location()))
            if side in same:
                matches = [same[side]]
            else:
                old = _Probe(side)
                matches = [p.face for p in probes if p.touches(old) or old.touches(p)]
            for name in _names(named) if matches else ():
                known = found.setdefault(name, [])
                known += [face for face in matches if face not in known]
    return found


def _names(face: NamedFace) -> tuple[str, ...]:
    """Return what a face is called: its piece of a side, and the whole side."""
    return tuple(dict.fromkeys((face.name, face.side or face.name)))


class _Probe:
    """A face, a box around it and a point inside it.

    Booleans and cleaning change faces, but what is left of a side has inner points on it.
    """

    def __init__(self, face: cq.Face) -> None:
        self.face = face
        self.box = Bnd_Box()
        BRepBndLib.Add_s(face.wrapped, self.box)
        self.point = gp_Pnt()
        status = BOPTools_AlgoTools3D.PointInFace_s(
            face.wrapped, self.point, gp_Pnt2d(), IntTools_Context()
        )
        self.inside = status == 0

    def touches(self, other: _Probe) -> bool:
        """Whether the inner point of this face lies on the other."""
        if not self.inside or other.box.IsOut(self.point):
            return False
        vertex = BRepBuilderAPI_MakeVertex(self.point).Vertex()
        distance = BRepExtrema_DistShapeShape(vertex, other.face.wrapped)
        faces = (self.face.wrapped, other.face.wrapped)
        return bool(
            distance.IsDone()
            and distance.Value() <= 2 * sum(BRep_Tool.Tolerance_s(face) for face in faces)
        )


register()
reloading.keep(cq)
