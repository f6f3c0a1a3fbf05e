"""One point equation in, one of these out: a part, splines or a mesh of its volume.

    PointEquation ─check→ CheckedMap ─represent→ BoundaryModel ─build→ BuiltSolid ─validate→ Part
                               ├─represent_volume→ VolumeModel
                               └─mesh_volume→ VolumeMesh         (tetrahedra: mesh_solid of a Part)

`checked` has the stages of the first arrow. Each stage takes the results before it and returns one
frozen value. Rooms are imported where they are used: only parts and tetrahedra load the kernel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

from pc2cad.checked import CheckedMap, Progress, Stages, check_map, halved, parted
from pc2cad.equation.point_equation import Domain, Equation, PointEquation, point_equation
from pc2cad.errors import InputError, require
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.templates.bodies import Bodies
from pc2cad.templates.shipped import bodies_paths, template_paths

if TYPE_CHECKING:
    from pc2cad.mesh.grid import Growth
    from pc2cad.mesh.meshing import MeshOptions
    from pc2cad.mesh.report import MeshReport
    from pc2cad.mesh.volume_mesh import VolumeMesh
    from pc2cad.part import Body, Part
    from pc2cad.report import Report
    from pc2cad.representation.volume import VolumeModel
    from pc2cad.solidity.over_ranges.boxes import ProvedBox

#: how often faces are halved for the kernel's checker
MOST_CUTS: Final = 4


def compile_solid(
    equation: PointEquation | Bodies,
    options: CompileOptions = DEFAULTS,
    progress: Progress | None = None,
    known: ProvedBox | None = None,
) -> Part:
    """Compile a point equation, or several with their Booleans, into a validated part.

    Of one equation the sign of det J and the boundary may be `known`, by a proof over a box of
    parameters that has those of the equation (`RangeProof.at`). Raises InputError, NotASolidError,
    ToleranceNotReachedError or KernelError; nothing doubtful is returned.
    """
    if isinstance(equation, Bodies):
        from pc2cad.csg.ways import compile_bodies

        if options.profile == "compact":
            # the kernel's section of a face that is a whole turn in one piece was 4e-4 off where
            # the other is tangent to it
            options = replace(options, profile="polynomial")

        def halve(body: Body) -> Body:
            checked = halved(body.checked)
            return body if checked is body.checked else compile_checked(checked, options).body

        def fit(body: Body, tolerance: float) -> Body:
            return compile_checked(body.checked, replace(options, tolerance=tolerance)).body

        def compile_body(body: PointEquation, tell: Progress) -> Body:
            return compile_solid(body, options, tell).body

        return compile_bodies(equation, compile_body, halve, fit, progress)
    from pc2cad.validation import check_thickness

    stages = Stages(progress)
    checked = check_map(equation, options, stages, check_thickness, faces=True, known=known)
    return compile_checked(checked, options, stages)


def compile_checked(
    checked: CheckedMap, options: CompileOptions = DEFAULTS, stages: Stages | None = None
) -> Part:
    """Return the part of a checked map: represented, built and validated.

    Where the kernel's checker takes walls of a plane face for one that are proved to be apart,
    faces are cut across them until none has both; the report says so.
    """
    from pc2cad.part import part_of
    from pc2cad.representation.plane_faces import longer_direction
    from pc2cad.validation import WallsTakenForOneError

    run, cut = stages or Stages(), ""
    for left in reversed(range(1 + MOST_CUTS)):
        try:
            body = _compiled(checked, options, run)
            break
        except WallsTakenForOneError as error:
            if not left:
                raise
            cut = cut or f"faces are cut into smaller ones: {error}"
            checked = parted(checked, longer_direction(checked.analysis, error.cells))
    if cut:
        body = replace(body, report=replace(body.report, warnings=(*body.report.warnings, cut)))
    return part_of(body)


def _compiled(checked: CheckedMap, options: CompileOptions, run: Stages) -> Body:
    """Return the body of a checked map; raise what its stages raise."""
    from pc2cad.brep.build import build
    from pc2cad.channels.limits import check_limits
    from pc2cad.part import Body
    from pc2cad.representation.boundary import represent
    from pc2cad.representation.embedding import embed, not_proved
    from pc2cad.validation import validate

    if checked.question.can_wait:
        run.put_off("solidity", lambda: checked.solidity)
    model = run("represent", lambda: represent(checked, options))
    embedding = run("embed", lambda: embed(checked, model, run.make_up))
    if not_proved(checked, model, embedding):
        run.make_up()
    if not embedding.proved:
        run("limits", lambda: check_limits(checked.limits))
    built = run("build", lambda: build(model))
    report = run("validate", lambda: validate(checked, model, built, embedding))
    return Body(checked, model, built, replace(report, times=run.times))


def compile_equation(
    equation: PointEquation | Bodies,
    tolerance: float | None = None,
    degree: int | None = None,
    progress: Progress | None = None,
    *,
    max_degree: int | None = None,
    profile: str = "compact",
) -> Part:
    """Compile a point equation, or several with their Booleans, into a validated part.

    `tolerance` is the largest distance, in model units, that a face may have from the equation;
    None means 1e-7 of the part's size, or 1e-6 of its thickness 2V/A where that is less. Where a
    spline is fitted, its degree in each direction is 3, 5 or 7, whichever needs the fewest poles;
    `degree` fixes it, `max_degree` lets fits choose from 3 up to it (at most 13). The profile
    "polynomial" has rational splines only where they are exact, as have bodies that are joined;
    "cubic" keeps every spline at degree 3 and not rational. Raises what `compile_solid` raises.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    if not isinstance(equation, Bodies):
        equation = point_equation(equation)
    return compile_solid(equation, options, progress)


def compile_part(
    equation: Equation | Bodies,
    domain: Domain | None = None,
    tolerance: float | None = None,
    *,
    name: str = "part",
    units: str = "mm",
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
) -> Part:
    """Compile a Python point equation (or its three coordinates) over a box into a part.

    `domain` maps ``u``, ``v``, ``w`` to ``(lower, upper)``; what is missing runs from 0 to 1. What
    a template binds, several bodies too, has its own domain, name and units. See
    `compile_equation` for the rest.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    if isinstance(equation, str) and (
        equation.endswith(".toml") or equation in template_paths() | bodies_paths()
    ):
        raise InputError(
            f"'{equation}' is a template, and a text is an equation here: "
            f"pc2cad.read_template('{equation}').bind() makes one of it"
        )
    if not isinstance(equation, Bodies):
        equation = point_equation(equation, domain, name=name, units=units)
    elif domain is not None:
        raise InputError(f"{equation.name} has several bodies, each with a domain of its own")
    return compile_solid(equation, options)


def with_arithmetic(
    part: Part,
    report: Report,
    options: CompileOptions = DEFAULTS,
    progress: Progress | None = None,
) -> Report:
    """Return the report with what is known of M as a sum of points, where it is written as one.

    The points that are added are compiled, each by itself.
    """
    if not part.equation.written():
        return report
    from pc2cad.csg.arithmetic import written_findings

    if progress is not None:
        progress("arithmetic")
    found = written_findings(part.body, lambda equation: compile_solid(equation, options).body)
    sentences = tuple(finding.sentence for finding in found)
    return replace(report, arithmetic=(*report.arithmetic, *sentences))


# -- the volume ------------------------------------------------------------------------------------


def spline_equation(
    equation: PointEquation,
    options: CompileOptions = DEFAULTS,
    progress: Progress | None = None,
) -> tuple[VolumeModel, CheckedMap]:
    """Return M as trivariate splines, and what is known of the equation itself.

    The options bound the distance from the equation where no exact form is known. Raises
    NotASolidError, ToleranceNotReachedError.
    """
    from pc2cad.representation.volume import represent_volume

    stages = Stages(progress)
    checked = check_map(equation, options, stages)
    return stages("represent", lambda: represent_volume(checked, options)), checked


def spline_part(
    equation: Equation,
    domain: Domain | None = None,
    tolerance: float | None = None,
    *,
    name: str = "part",
    units: str = "mm",
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
) -> VolumeModel:
    """Return a Python point equation over a box as trivariate splines.

    `tolerance`, `degree`, `max_degree` and `profile` are those of `compile_equation`. Raises
    InputError, NotASolidError, ToleranceNotReachedError.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    return spline_equation(point_equation(equation, domain, name=name, units=units), options)[0]


def mesh_equation(
    equation: PointEquation | Bodies,
    mesh: MeshOptions | None = None,
    progress: Progress | None = None,
    options: CompileOptions = DEFAULTS,
) -> tuple[VolumeMesh, MeshReport]:
    """Return the mesh of a point equation, or of several bodies, and the report on it.

    `options` are those of the part that tetrahedra are made of. Raises InputError for any with
    hexahedra, NotASolidError where the image is no solid or an element of the mesh is inverted, and
    UnsuitableGridError where the cells do not fit the solid.
    """
    from pc2cad.mesh.meshing import MeshOptions, mesh_volume

    wanted, stages = mesh or MeshOptions(), Stages(progress)
    if isinstance(equation, Bodies):
        return compile_solid(equation, options, progress).meshed(wanted, stages)
    if options != DEFAULTS and wanted.shape != "tetrahedra":
        raise InputError(
            "tolerance, degree, max_degree and profile are for the B-rep that tetrahedra are made "
            "of; hexahedra are of the equation itself"
        )
    if wanted.shape == "tetrahedra":
        require("gmsh", "tetrahedra")
        from pc2cad.validation import check_thickness

        checked = check_map(equation, options, stages, check_thickness, faces=True)
        return compile_checked(checked, options, stages).meshed(wanted, stages)
    return mesh_volume(check_map(equation, stages=stages), wanted, stages)


def mesh_part(
    equation: Equation,
    domain: Domain | None = None,
    *,
    name: str = "part",
    units: str = "mm",
    cells: tuple[int, int, int] | None = None,
    size: float | None = None,
    order: Literal[1, 2] = 1,
    shape: Literal["hexahedra", "tetrahedra"] = "hexahedra",
    core: Literal["grid", "ogrid"] = "grid",
    grading: Mapping[str, Growth] | None = None,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
) -> VolumeMesh:
    """Mesh a Python point equation over a box, as `Part.mesh` does a part.

    `tolerance`, `degree`, `max_degree` and `profile` are those of `compile_equation`, for the solid
    that tetrahedra are made of; hexahedra are of the equation itself. Raises InputError, and what
    `mesh_equation` raises.
    """
    from pc2cad.mesh.grid import gradings
    from pc2cad.mesh.meshing import MeshOptions

    options = CompileOptions(tolerance, degree, max_degree, profile)
    wanted = MeshOptions(cells, size, order, shape, gradings(grading or {}), core)
    bound = point_equation(equation, domain, name=name, units=units)
    return mesh_equation(bound, wanted, options=options)[0]
