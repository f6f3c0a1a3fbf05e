"""What a report says beside the solid's shape, where it is asked: its mass and its fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from pc2cad.equation.fields import DENSITY
from pc2cad.errors import InputError

if TYPE_CHECKING:
    from pc2cad.part import Part
    from pc2cad.report import Report


def with_figures(
    part: Part,
    report: Report,
    density: float | Mapping[str, float] | None,
    progress: Callable[[str], None],
) -> Report:
    """Return the report with the mass, where a density is known, and with the figures of fields."""
    fields = part.equation.fields if report.own is not None else ()
    known = [body.equation.fields for body in part.bodies.values()]
    if density is not None or any(field.name == DENSITY for own in known for field in own):
        progress("weigh")
        try:
            report = replace(report, mass=part.mass_properties(density))
        except InputError as error:
            # who has not asked for the mass gets the part without it
            if density is not None or report.own is not None:
                raise
            report = replace(report, warnings=(*report.warnings, f"no mass is stated: {error}"))
    if fields:
        progress("fields")
        found = {field.name: part.field_figures(field.name).to_dict() for field in fields}
        report = replace(report, fields=found)
    return report
