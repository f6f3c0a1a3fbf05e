"""What CalculiX has found at the nodes of a mesh: its .frd files, read as data.

Format: G. Dhondt, CalculiX CrunchiX user's manual, "Format of the .frd file" (ASCII; fields of
fixed width, twelve characters to a number).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.errors import InputError

#: keys of lines: a node's values, more of them, a field's head, a component, the end of a block
_NODE, _MORE, _FIELD, _COMPONENT, _END = " -1", " -2", " -4", " -5", " -3"


@dataclass(frozen=True)
class Step:
    """What was found for one load, time or frequency."""

    #: time, or the frequency in cycles per time
    value: float
    #: name of a field (DISP, STRESS, NDTEMP, FLUX …) -> its components, (nodes, n); NaN where a
    #: node has none
    fields: Mapping[str, Array]
    #: name of a field -> names of its components (D1, SXX …)
    components: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Results:
    """A file of results."""

    #: the nodes as the file has them, with six digits, (n, 3)
    points: Array
    steps: tuple[Step, ...]
    #: u, v, w of the nodes, (n, 3), where the part is known
    parameters: Array | None = None


@dataclass
class _Block:
    name: str
    components: list[str] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)


def read_results(path: str | os.PathLike[str]) -> Results:
    """Read a file .frd that CalculiX has written.

    Raises InputError, with the line, where it is none.
    """
    points, numbers, steps = None, np.zeros(0, dtype=np.int64), list[tuple[float, _Block]]()
    try:
        with open(path, encoding="ascii", errors="replace") as stream:
            for kind, value, block in _blocks(stream):
                if kind == "nodes":
                    numbers, points = np.array(block.numbers), np.array(block.rows)
                else:
                    steps.append((value, block))
    except OSError as error:
        raise InputError(f"cannot read {os.fspath(path)}: {error.strerror}") from None
    if points is None or points.shape != (len(numbers), 3):
        raise InputError(f"{os.fspath(path)} has no nodes: it is no file .frd of CalculiX")
    order = np.argsort(numbers)
    return Results(points[order], _steps(steps, numbers[order]))


def _blocks(lines: Iterator[str]) -> Iterator[tuple[str, float, _Block]]:
    """Give the nodes, then every field with the time or frequency that it belongs to."""
    kind, value, block = "", 0.0, _Block("")
    for number, line in enumerate(lines, start=1):
        key = line[:3]
        try:
            if line.startswith("    2C"):
                kind, block = "nodes", _Block("nodes")
            elif line.startswith("  100C"):
                kind, value = "field", float(line[12:24])
            elif key == _FIELD:
                block = _Block(line[5:13].strip())
            elif key == _COMPONENT and line[5:13].strip() != "ALL":
                block.components.append(line[5:13].strip())
            elif key == _NODE and kind:
                block.numbers.append(int(line[3:13]))
                block.rows.append(_values(line))
            elif key == _MORE and kind:
                block.rows[-1] += _values(line)
            elif key == _END and kind:
                yield kind, value, block
                kind, block = ("field" if kind == "field" else ""), _Block("")
            elif line.startswith("    3C"):  # elements: the mesh has them
                kind = ""
        except (ValueError, IndexError):
            raise InputError(
                f"line {number} is none of a file .frd: {line[:40].rstrip()!r}"
            ) from None


def _values(line: str) -> list[float]:
    return [float(line[at : at + 12]) for at in range(13, len(line.rstrip()), 12)]


def _steps(found: list[tuple[float, _Block]], numbers: Integers) -> tuple[Step, ...]:
    steps: list[Step] = []
    for value, block in found:
        width = max(map(len, block.rows), default=0)
        if not width or {len(row) for row in block.rows} != {width}:
            raise InputError(f"the field {block.name[:20]} has rows of several lengths, or none")
        at = np.searchsorted(numbers, block.numbers)
        if at.max() >= len(numbers) or (numbers[at] != block.numbers).any():
            raise InputError(f"the field {block.name[:20]} is of nodes that the file has not")
        values = np.full((len(numbers), width), np.nan)
        values[at] = block.rows
        if not steps or steps[-1].value != value or block.name in steps[-1].fields:
            steps.append(Step(value, {}, {}))
        last = steps[-1]
        steps[-1] = Step(
            value, {**last.fields, block.name: values},
            {**last.components, block.name: tuple(block.components[:width])},
        )  # fmt: skip
    return tuple(steps)
