"""The instances of a STEP file by number and by keyword, and what all geometry is made of.

Numbers, points, directions and placements are checked here: a record that does not have what its
keyword asks for is a StepDefectError that names it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from pc2cad.arrays import Array
from pc2cad.verify.defects import StepDefectError, StepUnknownError
from pc2cad.verify.exchange import Enumeration, Exchange, Parts, Ref, Typed

#: references that may be followed through curves and surfaces
DEEPEST = 12
_NUMBERS = {int, float}


@dataclass(frozen=True)
class Record:
    """One instance: its number and the parameters of each of its partial entities."""

    ref: Ref
    parts: Parts

    @property
    def keyword(self) -> str:
        """The entity's keyword; a complex instance joins its partial keywords."""
        return "+".join(self.parts)

    def values(self, least: int = 0) -> tuple[Any, ...]:
        """Return the parameters of a simple instance, of which there are at least so many."""
        if len(self.parts) != 1:
            raise StepUnknownError(f"{self.ref} is a complex instance where a simple one is read")
        return self.part(self.keyword, least)

    def part(self, keyword: str, least: int = 0) -> tuple[Any, ...]:
        """Return the parameters of a partial entity, of which there are at least so many."""
        values = self.parts.get(keyword, ())
        if len(values) < least:
            raise StepDefectError(
                f"{keyword} {self.ref} has {len(values)} parameters, {least} are needed"
            )
        return values


class Records:
    """All records of a file, by reference and by keyword."""

    _dimension, _many = 3, "three"

    def __init__(self, exchange: Exchange) -> None:
        self.header = exchange.header
        self._instances = exchange.instances
        self._by_keyword: dict[str, list[int]] = {}
        for key, parts in exchange.instances.items():
            for keyword in parts:
                self._by_keyword.setdefault(keyword, []).append(key)

    def flat(self) -> Records:
        """Return the same records, as read where points have two coordinates; z is 0."""
        found = copy(self)
        found._dimension, found._many = 2, "two"
        return found

    def __len__(self) -> int:
        """Return the number of instances."""
        return len(self._instances)

    def all_of(self, *keywords: str) -> list[Record]:
        """Return the records that carry one of these keywords, in file order."""
        keys = sorted({key for word in keywords for key in self._by_keyword.get(word, ())})
        return [Record(Ref(key), self._instances[key]) for key in keys]

    def without_numbers(self) -> list[Ref]:
        """Return the points and directions whose coordinates are no numbers, used or not."""
        found = []
        for word in ("CARTESIAN_POINT", "DIRECTION"):
            for key in self._by_keyword.get(word, ()):
                values = self._instances[key][word]
                row = values[-1] if values else None
                if not isinstance(row, tuple) or not _NUMBERS.issuperset(map(type, row)):
                    found.append(Ref(key))
        return found

    def get(self, ref: Any, *keywords: str) -> Record:
        """Return the record behind a reference, of one of the given keywords if any are given."""
        if not isinstance(ref, Ref):
            wanted = " or ".join(keywords) or "an instance"
            raise StepDefectError(f"{_shown(ref)} is read where a reference to {wanted} is needed")
        record = Record(ref, self._instances[ref])
        if keywords and not any(keyword in record.parts for keyword in keywords):
            wanted = " or ".join(keywords)
            raise StepDefectError(f"{ref} is {record.keyword} where {wanted} is needed")
        return record

    def point(self, ref: Any) -> Array:
        """Return the coordinates of a CARTESIAN_POINT in space."""
        return np.asarray(self.points([ref])[0])

    def points(self, refs: Sequence[Any]) -> Array:
        """Return the coordinates of CARTESIAN_POINTs, (n, 3)."""
        rows = []
        for ref in sequence(refs):
            parts = self._instances[ref] if isinstance(ref, Ref) else {}
            if "CARTESIAN_POINT" not in parts:
                self.get(ref, "CARTESIAN_POINT")
            values = parts["CARTESIAN_POINT"]
            row = values[-1] if values else None
            if not isinstance(row, tuple) or len(row) != self._dimension:
                raise StepDefectError(f"CARTESIAN_POINT {ref} has no {self._many} coordinates")
            rows.append(row)
        found = numbers(rows, refs).reshape(-1, self._dimension)
        return np.pad(found, ((0, 0), (0, 3 - self._dimension)))

    def direction(self, ref: Any) -> Array:
        """Return a DIRECTION as a unit vector."""
        _, row = self.get(ref, "DIRECTION").values(2)[:2]
        ratios = numbers(row, ref)
        length = float(np.linalg.norm(ratios))
        if ratios.shape != (self._dimension,) or not 1e-50 < length < np.inf:
            raise StepDefectError(f"DIRECTION {ref} has no length, or no {self._many} coordinates")
        return np.pad(ratios / length, (0, 3 - self._dimension))

    def vector(self, ref: Any) -> Array:
        """Return a VECTOR: its direction times its magnitude."""
        _, direction, magnitude = self.get(ref, "VECTOR").values(3)[:3]
        return self.direction(direction) * length(magnitude, ref)

    def frame(self, ref: Any) -> tuple[Array, Array]:
        """Return an AXIS2_PLACEMENT_3D as origin and the rows x, y, z of a right-handed frame."""
        if self._dimension == 2:
            _, location, reference = self.get(ref, "AXIS2_PLACEMENT_2D").values(3)[:3]
            x = np.eye(3)[0] if reference is None else self.direction(reference)
            return self.point(location), np.array([x, [-x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
        _, location, axis, reference = self.get(ref, "AXIS2_PLACEMENT_3D").values(4)[:4]
        z = np.array([0.0, 0.0, 1.0]) if axis is None else self.direction(axis)
        if reference is None:
            x = np.array([1.0, 0.0, 0.0] if abs(z[0]) < 0.999 else [0.0, 0.0, -np.sign(z[0])])
        else:
            x = self.direction(reference)
        x = x - (x @ z) * z
        if np.linalg.norm(x) < 1e-9:
            raise StepDefectError(f"the axes of the placement {ref} are parallel")
        x /= np.linalg.norm(x)
        return self.point(location), np.array([x, np.cross(z, x), z])

    def axis(self, ref: Any) -> tuple[Array, Array]:
        """Return an AXIS1_PLACEMENT as origin and unit direction."""
        _, location, axis = self.get(ref, "AXIS1_PLACEMENT").values(3)[:3]
        z = np.array([0.0, 0.0, 1.0]) if axis is None else self.direction(axis)
        return self.point(location), z


def is_true(value: Any) -> bool:
    """Return a BOOLEAN parameter."""
    if not isinstance(value, Enumeration) or value not in ("T", "F"):
        raise StepDefectError(f"{_shown(value)} is read where .T. or .F. is needed")
    return value == "T"


def number(value: Any) -> float:
    """Return a number, bare or wrapped in the name of its measure."""
    if isinstance(value, Typed) and len(value.values) == 1:
        value = value.values[0]
    if isinstance(value, Ref) or not isinstance(value, int | float):
        raise StepDefectError(f"{_shown(value)} is read where a number is needed")
    return float(value)


def whole(value: Any) -> int:
    """Return a whole number that is not negative."""
    if isinstance(value, Ref) or not isinstance(value, int) or value < 0:
        raise StepDefectError(f"{_shown(value)} is read where a whole number is needed")
    return value


def length(value: Any, ref: Any) -> float:
    """Return a positive number."""
    found = number(value)
    if not found > 0.0:
        raise StepDefectError(f"{ref} has a length of {found:.6g}")
    return found


def numbers(values: Any, where: Any) -> Array:
    """Return nested tuples of numbers as an array."""
    stack = list(sequence(values))
    if len(set(map(type, stack))) == 1 and isinstance(stack[0], tuple):
        stack = list(chain.from_iterable(stack))
    if _NUMBERS.issuperset(map(type, stack)):
        stack.clear()
    while stack:
        value = stack.pop()
        if isinstance(value, tuple | list):
            stack.extend(value)
        elif isinstance(value, Ref) or not isinstance(value, int | float):
            raise StepDefectError(f"{_shown(value)} is read where a number is needed")
    try:
        return np.array(values, dtype=float)
    except ValueError as error:
        raise StepDefectError(f"rows of {_shown(where)} differ in length") from error


def sequence(value: Any) -> Sequence[Any]:
    """Return a list of parameters."""
    if not isinstance(value, tuple | list):
        raise StepDefectError(f"{_shown(value)} is read where a list is needed")
    return value


def _shown(value: Any) -> str:
    return "$" if value is None else str(value)[:60]
