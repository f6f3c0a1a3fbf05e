"""Part 21 text as a graph of records; neither geometry nor topology is judged here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from steputils import p21

Vector = NDArray[np.float64]


class StepDefect(ValueError):  # noqa: N818
    """The file does not describe one sound solid; the sentence says where."""


class StepUnsupported(StepDefect):
    """The file may be sound, but uses a form this check cannot judge."""


@dataclass(frozen=True)
class Record:
    """One instance: its reference and the parameters of each of its partial entities."""

    ref: str
    parts: dict[str, tuple[Any, ...]]

    @property
    def keyword(self) -> str:
        """The entity's keyword; a complex instance joins its partial keywords."""
        return "+".join(self.parts)

    @property
    def values(self) -> tuple[Any, ...]:
        """The parameters of a simple instance."""
        if len(self.parts) != 1:
            raise StepUnsupported(f"{self.ref} is a complex instance where a simple one is read.")
        return next(iter(self.parts.values()))


class StepGraph:
    """All records of a file, by reference and by keyword."""

    def __init__(self, records: dict[str, Record]) -> None:
        self._records = records
        self._by_keyword: dict[str, list[Record]] = {}
        for record in records.values():
            for keyword in record.parts:
                self._by_keyword.setdefault(keyword, []).append(record)

    def all_of(self, keyword: str) -> list[Record]:
        """The records that carry this keyword, in file order."""
        return self._by_keyword.get(keyword, [])

    def get(self, ref: Any, *keywords: str) -> Record:
        """The record behind a reference, of one of the given keywords if any are given."""
        record = self._records.get(ref)
        if record is None:
            raise StepDefect(f"The file refers to {ref}, which it does not contain.")
        if keywords and not any(keyword in record.parts for keyword in keywords):
            wanted = " or ".join(keywords)
            raise StepDefect(f"{ref} is {record.keyword} where {wanted} is needed.")
        return record

    def point(self, ref: Any) -> Vector:
        """The coordinates of a CARTESIAN_POINT."""
        return np.array(self.get(ref, "CARTESIAN_POINT").values[1], dtype=float)

    def points(self, refs: Sequence[Any]) -> Vector:
        """The coordinates of a list of CARTESIAN_POINTs, one per row."""
        rows = [self.get(ref, "CARTESIAN_POINT").values[1] for ref in refs]
        return np.array(rows, dtype=float).reshape(len(rows), -1)

    def direction(self, ref: Any) -> Vector:
        """A DIRECTION as a unit vector."""
        ratios = np.array(self.get(ref, "DIRECTION").values[1], dtype=float)
        length = float(np.linalg.norm(ratios))
        if length == 0.0:
            raise StepDefect(f"Direction {ref} has no length.")
        return ratios / length

    def vector(self, ref: Any) -> Vector:
        """A VECTOR: its direction times its magnitude."""
        _, direction, magnitude = self.get(ref, "VECTOR").values
        return self.direction(direction) * float(magnitude)

    def frame(self, ref: Any) -> tuple[Vector, Vector]:
        """An AXIS2_PLACEMENT_3D as origin and the rows x, y, z of a right-handed frame."""
        _, location, axis, reference = self.get(ref, "AXIS2_PLACEMENT_3D").values
        z = self.direction(axis) if is_reference(axis) else np.array([0.0, 0.0, 1.0])
        x = self.direction(reference) if is_reference(reference) else np.array([1.0, 0.0, 0.0])
        x = x - (x @ z) * z
        if np.linalg.norm(x) < 1e-9:
            raise StepDefect(f"The axes of placement {ref} are parallel.")
        x /= np.linalg.norm(x)
        return self.point(location), np.array([x, np.cross(z, x), z])

    def axis(self, ref: Any) -> tuple[Vector, Vector]:
        """An AXIS1_PLACEMENT as origin and unit direction."""
        _, location, axis = self.get(ref, "AXIS1_PLACEMENT").values
        z = self.direction(axis) if is_reference(axis) else np.array([0.0, 0.0, 1.0])
        return self.point(location), z


def is_reference(value: Any) -> bool:
    """Whether a parameter is a reference to another record (not $ or *)."""
    return isinstance(value, p21.Reference)


def is_true(value: Any) -> bool:
    """A BOOLEAN parameter."""
    if value not in (".T.", ".F."):
        raise StepDefect(f"{value} is read where .T. or .F. is needed.")
    return bool(value == ".T.")


def number(value: Any) -> float:
    """A number, bare or wrapped in the name of its measure."""
    return float(value.param if isinstance(value, p21.TypedParameter) else value)


def read_graph(path: str | Path) -> StepGraph:
    """Parse a Part 21 file."""
    try:
        file = p21.loads(Path(path).read_text(encoding="utf-8"))
    except (p21.ParseError, AssertionError, IndexError, TypeError, UnicodeDecodeError) as error:
        raise StepDefect(f"The file is not Part 21 text: {error}.") from error
    return StepGraph({record.ref: record for record in _records(file)})


def _records(file: p21.StepFile) -> Iterator[Record]:
    for instance in file:
        simple = p21.is_simple_entity_instance(instance)
        entities = [instance.entity] if simple else instance.entities
        yield Record(instance.ref, {entity.name: entity.params for entity in entities})
