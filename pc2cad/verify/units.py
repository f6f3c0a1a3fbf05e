"""Units, uncertainty, and the geometric validation properties that a STEP file states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.exchange import Ref
from pc2cad.verify.records import DEEPEST, Record, Records, number, sequence

_PREFIXES = {
    "EXA": 1e18, "PETA": 1e15, "TERA": 1e12, "GIGA": 1e9, "MEGA": 1e6, "KILO": 1e3, "HECTO": 1e2,
    "DECA": 1e1, "DECI": 1e-1, "CENTI": 1e-2, "MILLI": 1e-3, "MICRO": 1e-6, "NANO": 1e-9,
    "PICO": 1e-12, "FEMTO": 1e-15, "ATTO": 1e-18,
}  # fmt: skip


@dataclass(frozen=True)
class Units:
    """The units of a shape's context, and the uncertainty that it states (in its own unit)."""

    metres: float
    radian: float
    uncertainty: float | None


@dataclass(frozen=True)
class Stated:
    """What the file itself says of its solids, in the file's own length unit."""

    volume: float | None = None
    area: float | None = None
    centroid: tuple[float, float, float] | None = None


def read_units(records: Records, context: Any) -> Units:
    """Return the units of a representation's context."""
    record = records.get(context, "GLOBAL_UNIT_ASSIGNED_CONTEXT")
    refs = record.part("GLOBAL_UNIT_ASSIGNED_CONTEXT")
    if len(refs) != 1:
        raise StepDefectError(f"the context {context} has {len(refs)} lists of units, and not one")
    sizes = {}
    for ref in sequence(refs[0]):
        unit = records.get(ref)
        for kind in ("LENGTH_UNIT", "PLANE_ANGLE_UNIT"):
            if kind in unit.parts:
                sizes[kind] = _scale(records, unit)
    if "LENGTH_UNIT" not in sizes:
        raise StepDefectError(f"the context {context} of the shape has no unit of length")
    metres = sizes["LENGTH_UNIT"]
    uncertainty = _uncertainty(records, record, metres)
    return Units(metres, sizes.get("PLANE_ANGLE_UNIT", 1.0), uncertainty)


def _uncertainty(records: Records, context: Record, metres: float) -> float | None:
    found = None
    keyword = "GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT"
    for ref in sequence(context.part(keyword, 1)[0]) if keyword in context.parts else ():
        measure = records.get(ref, "UNCERTAINTY_MEASURE_WITH_UNIT")
        values = measure.part("UNCERTAINTY_MEASURE_WITH_UNIT", 2)
        unit = records.get(values[1])
        if "LENGTH_UNIT" in unit.parts:
            value = number(values[0]) * _scale(records, unit) / metres
            found = value if found is None else min(found, value)
    if found is not None and not found >= 0.0:
        raise StepDefectError(f"the file states an uncertainty of {found:.3g}")
    return found


def _scale(records: Records, record: Record, depth: int = 0) -> float:
    if depth > DEEPEST:
        raise StepDefectError(f"the unit {record.ref} is made of itself")
    if "SI_UNIT" in record.parts:
        prefix = record.part("SI_UNIT", 2)[0]
        if prefix is not None and str(prefix) not in _PREFIXES:
            raise StepDefectError(f"the unit {record.ref} has the prefix {prefix}")
        return _PREFIXES[str(prefix)] if prefix is not None else 1.0
    if "CONVERSION_BASED_UNIT" in record.parts:
        measure = records.get(record.part("CONVERSION_BASED_UNIT", 2)[-1])
        found = [values for values in measure.parts.values() if len(values) == 2]
        if len(found) != 1 or not number(found[0][0]) > 0.0:
            raise StepDefectError(f"the unit {record.ref} is converted by {measure.keyword}")
        ((value, unit),) = found
        return number(value) * _scale(records, records.get(unit), depth + 1)
    raise StepUnknownError(f"the unit {record.ref} is neither an SI unit nor converted from one")


def _derived_scale(records: Records, ref: Any) -> float:
    scale = 1.0
    for element in sequence(records.get(ref, "DERIVED_UNIT").values(1)[0]):
        unit, exponent = records.get(element, "DERIVED_UNIT_ELEMENT").values(2)[:2]
        power = number(exponent)
        if not abs(power) <= 6.0:
            raise StepDefectError(f"the unit {ref} has the exponent {power:.6g}")
        scale *= _scale(records, records.get(unit)) ** power
    return scale


def stated_properties(records: Records, metres: float) -> Stated:
    """Return the geometric validation properties of the file's shape (the first of each kind)."""
    figures: dict[str, float] = {}
    centre: Array | None = None
    for link in records.all_of("PROPERTY_DEFINITION_REPRESENTATION"):
        definition, representation = (records.get(ref) for ref in link.values(2)[:2])
        own = definition.parts.get("PROPERTY_DEFINITION")
        if not own or own[0] != "geometric validation property":
            continue
        items = next(iter(representation.parts.values()))
        for item in sequence(items[1] if len(items) > 1 else None):
            record = records.get(item)
            if "MEASURE_REPRESENTATION_ITEM" in record.parts and len(record.parts) == 1:
                name, value, unit = record.values(3)[:3]
                scale = _derived_scale(records, unit) if isinstance(unit, Ref) else 1.0
                figures.setdefault(str(name), number(value) * scale)
            elif "CARTESIAN_POINT" in record.parts and centre is None:
                centre = records.point(item)
    volume, area = figures.get("volume measure"), figures.get("surface area measure")
    place = None if centre is None else tuple(np.asarray(centre).tolist())
    return Stated(
        None if volume is None else volume / metres**3,
        None if area is None else area / metres**2,
        None if place is None else (place[0], place[1], place[2]),
    )
