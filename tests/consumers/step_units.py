"""Units and geometric validation properties of a STEP file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .step_parse import Record, StepDefect, StepGraph, StepUnsupported, Vector, is_reference, number

_PREFIXES = {
    ".KILO.": 1e3,
    ".HECTO.": 1e2,
    ".DECA.": 1e1,
    ".DECI.": 1e-1,
    ".CENTI.": 1e-2,
    ".MILLI.": 1e-3,
    ".MICRO.": 1e-6,
    ".NANO.": 1e-9,
}


@dataclass(frozen=True)
class ValidationProperties:
    """What the file itself says of its solid, in the file's own length unit."""

    volume: float | None
    area: float | None
    centroid: tuple[float, float, float] | None


def unit_scale(graph: StepGraph, context: Any, kind: str) -> float:
    """The size of the context's LENGTH_UNIT in metres, or PLANE_ANGLE_UNIT in radians."""
    parts = graph.get(context, "GLOBAL_UNIT_ASSIGNED_CONTEXT").parts
    for ref in parts["GLOBAL_UNIT_ASSIGNED_CONTEXT"][0]:
        record = graph.get(ref)
        if kind in record.parts:
            return _scale(graph, record)
    raise StepDefect(f"The shape's context {context} has no {kind}.")


def _scale(graph: StepGraph, record: Record) -> float:
    if "SI_UNIT" in record.parts:
        prefix, _ = record.parts["SI_UNIT"]
        return _PREFIXES.get(str(prefix), 1.0)
    if "CONVERSION_BASED_UNIT" in record.parts:
        measure = graph.get(record.parts["CONVERSION_BASED_UNIT"][1])
        value, unit = next(values for values in measure.parts.values() if len(values) == 2)
        return number(value) * _scale(graph, graph.get(unit))
    raise StepUnsupported(f"Unit {record.ref} is neither an SI unit nor converted from one.")


def _derived_scale(graph: StepGraph, ref: Any) -> float:
    scale = 1.0
    for element in graph.get(ref, "DERIVED_UNIT").values[0]:
        unit, exponent = graph.get(element, "DERIVED_UNIT_ELEMENT").values
        scale *= _scale(graph, graph.get(unit)) ** float(exponent)
    return scale


def validation_properties(graph: StepGraph, metres: float) -> ValidationProperties:
    """The geometric validation properties found in the file (of its one solid)."""
    numbers: dict[str, float] = {}
    centre: Vector | None = None
    for link in graph.all_of("PROPERTY_DEFINITION_REPRESENTATION"):
        definition, representation = (graph.get(ref) for ref in link.values)
        if "PROPERTY_DEFINITION" not in definition.parts:
            continue
        if definition.parts["PROPERTY_DEFINITION"][0] != "geometric validation property":
            continue
        for item in graph.get(representation.ref, "REPRESENTATION").values[1]:
            record = graph.get(item)
            if "MEASURE_REPRESENTATION_ITEM" in record.parts:
                name, value, unit = record.values
                scale = _derived_scale(graph, unit) if is_reference(unit) else 1.0
                numbers[str(name)] = number(value) * scale
            elif "CARTESIAN_POINT" in record.parts:
                centre = graph.point(item)
    volume, area = numbers.get("volume measure"), numbers.get("surface area measure")
    return ValidationProperties(
        None if volume is None else volume / metres**3,
        None if area is None else area / metres**2,
        None if centre is None else tuple(np.asarray(centre).tolist()),
    )
