"""The pipeline: one point equation in, one part out.

    PointEquation  ─limits→     Limits         of a channel: what is near to break it
                   ─analyse→    Analysis       which sides collapse, coincide, bound
                   ─integrate→  Properties     volume, area, centroid of the equation
                   ─solidity→   Solidity       proof or samples: det J keeps its sign, no overlap
                   ─represent→  BoundaryModel  a carrier for every face and edge
                   ─build→      BuiltSolid     the kernel's solid
                   ─validate→   Report         held against the equation, or refused

Each stage takes the results before it and returns one frozen value.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar, overload

from pc2cad.analysis import analyse
from pc2cad.bodies import BodiesPart, compile_bodies
from pc2cad.boundary import check_tolerance, represent
from pc2cad.brep.build import build
from pc2cad.equation.point_equation import Domain, Equation, PointEquation, point_equation
from pc2cad.equation.template_bodies import Bodies
from pc2cad.errors import NotASolidError
from pc2cad.geometry.profile import SplineProfile, spline_profile
from pc2cad.limits import Limit, check_limits, describe, find_limits
from pc2cad.part import Part
from pc2cad.properties import integrate
from pc2cad.report import LimitReport
from pc2cad.solidity import check_solidity
from pc2cad.validation import check_thickness, validate

#: told the name of each stage as it begins
Progress = Callable[[str], None]
Result = TypeVar("Result")


@overload
def compile_equation(
    equation: PointEquation,
    tolerance: float | None = None,
    degree: int | None = None,
    progress: Progress | None = None,
    *,
    max_degree: int | None = None,
    profile: str = "compact",
) -> Part: ...
@overload
def compile_equation(
    equation: Bodies,
    tolerance: float | None = None,
    degree: int | None = None,
    progress: Progress | None = None,
    *,
    max_degree: int | None = None,
    profile: str = "compact",
) -> BodiesPart: ...
def compile_equation(
    equation: PointEquation | Bodies,
    tolerance: float | None = None,
    degree: int | None = None,
    progress: Progress | None = None,
    *,
    max_degree: int | None = None,
    profile: str = "compact",
) -> Part | BodiesPart:
    """Compile a point equation, or several with their Booleans, into a validated part.

    `tolerance` is the largest distance, in model units, that a face may have from the equation;
    None means 1e-7 of the part's size, or 1e-6 of its thickness 2V/A where that is less. Where a
    spline is fitted, its degree in each direction is 3, 5 or 7, whichever needs the fewest poles;
    `degree` fixes it, `max_degree` lets fits choose from 3 up to it (at most 13). The profile
    "cubic" keeps every spline at degree 3 and not rational. Raises InputError, NotASolidError,
    ToleranceNotReachedError or KernelError; nothing doubtful is returned.
    """
    splines = spline_profile(degree, max_degree, profile)
    if isinstance(equation, Bodies):
        return compile_bodies(
            equation, lambda body, tell: _compile(body, tolerance, splines, tell), progress
        )
    return _compile(equation, tolerance, splines, progress)


def _compile(
    equation: PointEquation,
    tolerance: float | None,
    splines: SplineProfile,
    progress: Progress | None,
) -> Part:
    times: dict[str, float] = {}

    limits: tuple[Limit, ...] = ()

    def stage(name: str, run: Callable[[], Result]) -> Result:
        if progress is not None:
            progress(name)
        start = time.perf_counter()
        try:
            result = run()
        except NotASolidError as error:
            if limits:
                error.args = (f"{error} (limits of the channel: {describe(limits)})",)
            raise
        times[name] = time.perf_counter() - start
        return result

    limits = stage("limits", lambda: find_limits(equation))
    check_limits(limits)
    analysis = stage("analyse", lambda: analyse(equation))
    check_tolerance(analysis, tolerance)
    properties = stage("integrate", lambda: integrate(analysis))
    tolerance = check_tolerance(analysis, tolerance, 2 * properties.volume / properties.area)
    check_thickness(properties)
    solidity = stage("solidity", lambda: check_solidity(analysis))
    model = stage(
        "represent",
        lambda: represent(analysis, solidity.outer_shell, tolerance, splines),
    )
    built = stage("build", lambda: build(model))
    report = stage("validate", lambda: validate(analysis, properties, solidity, model, built))
    known = tuple(LimitReport(x.name, x.value, x.breaks_at, x.sentence) for x in limits)
    return Part(equation, model, built, replace(report, limits=known, times=times))


def compile_part(
    equation: Equation,
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

    `domain` maps ``u``, ``v``, ``w`` to ``(lower, upper)``; what is missing runs from 0 to 1. See
    `compile_equation` for the rest.
    """
    return compile_equation(
        point_equation(equation, domain, name=name, units=units),
        tolerance,
        degree,
        max_degree=max_degree,
        profile=profile,
    )
