"""Which variants a study consists of: a grid, a list, a table of values, or a sample.

A variant is a mapping of parameter names to numbers. Everything is checked against the template
before the first one is built, and counted before it is laid out.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Final

from pc2cad.equation.language import nearest, read_expression
from pc2cad.equation.scalar import evaluate
from pc2cad.equation.template import Template
from pc2cad.equation.template_bodies import BodiesTemplate
from pc2cad.equation.tree import Expr
from pc2cad.errors import InputError

#: more variants than this are taken for a slip of the pen
MOST_VARIANTS: Final = 1_000_000
LARGEST_TABLE: Final = 64 * 1024 * 1024
_SAMPLE: Final = re.compile(r"(lhs|sobol):([0-9]{1,9})\Z")

Variant = Mapping[str, float]


class PlanError(InputError):
    """The variants of a study are not well described."""


@dataclass(frozen=True)
class Axis:
    """One parameter that varies: its values in order, or a range that a sample is drawn from."""

    name: str
    values: tuple[float, ...] = ()
    range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plan:
    """The variants of a study, in order; every one sets the same parameters."""

    names: tuple[str, ...]
    variants: tuple[tuple[float, ...], ...]

    def __len__(self) -> int:
        return len(self.variants)

    def values(self, index: int) -> dict[str, float]:
        """Return the parameters that a variant sets."""
        return dict(zip(self.names, self.variants[index], strict=True))


def read_axis(name: str, given: str | Sequence[float]) -> Axis:
    """Return the axis of a parameter: its values, or a text that describes them.

    ``0.1:0.9:17`` stands for 17 values, ends included; ``0.2,0.5`` for these; ``0.1:0.9`` for a
    range that a sample is drawn from. Each number may be a constant expression such as ``1/3``.
    Raises PlanError.
    """
    where = f"values of {name[:80]}"
    if not isinstance(given, str):
        return Axis(name, tuple(dict.fromkeys(read_number(where, repr(float(v))) for v in given)))
    parts = given.split(":")
    if len(parts) == 1:
        values = tuple(read_number(where, part) for part in given.split(","))
        return Axis(name, tuple(dict.fromkeys(values)))
    if len(parts) > 3:
        raise PlanError(f"{where}: '{given[:80]}' has more than FROM:TO:COUNT")
    low, high = (read_number(where, part) for part in parts[:2])
    if len(parts) == 2:
        if not low < high:
            raise PlanError(f"{where}: the range {low:g}:{high:g} is empty")
        return Axis(name, range=(low, high))
    count = parts[2].strip()
    if not re.fullmatch(r"[0-9]{1,15}", count) or int(count) < 1:
        raise PlanError(
            f"{where}: the third part of '{given[:80]}' is the count of values, a whole "
            "number from 1 on"
        )
    return Axis(name, _spread(name, low, high, int(count)))


def _spread(name: str, low: float, high: float, count: int) -> tuple[float, ...]:
    if count > MOST_VARIANTS:
        raise PlanError(f"values of {name}: {count} are more than {MOST_VARIANTS}")
    if (count == 1) != (low == high):
        raise PlanError(
            f"values of {name}: {count} from {low:g} to {high:g}; one value needs equal ends, "
            "several need different ones"
        )
    if count == 1:
        return (low,)
    # exact steps rounded once, so that 0.1:0.9:17 holds 0.5 and not its neighbour
    first, last = Fraction(repr(low)), Fraction(repr(high))
    return tuple(float(first + (last - first) * i / (count - 1)) for i in range(count))


def read_number(where: str, text: str) -> float:
    """Return the finite number that a constant expression stands for; raise PlanError."""
    try:
        tree = read_expression(text.strip(), {})
        value = evaluate(tree, {}) if isinstance(tree, Expr) else math.nan
    except InputError as error:
        raise PlanError(f"{where}: '{text.strip()[:80]}': {error}") from error
    if not math.isfinite(value):
        raise PlanError(f"{where}: '{text.strip()[:80]}' is no finite number")
    return value


def grid(axes: Sequence[Axis]) -> Plan:
    """Return every combination of the axes' values, the last axis running fastest."""
    for axis in axes:
        if axis.range is not None:
            low, high = axis.range
            raise PlanError(
                f"{axis.name}={low:g}:{high:g} is a range; a grid needs a count, "
                f"{axis.name}={low:g}:{high:g}:5, or a sample with --sample"
            )
    _check_axes(axes)
    _check_count(math.prod(len(axis.values) for axis in axes))
    return Plan(tuple(axis.name for axis in axes), tuple(product(*(axis.values for axis in axes))))


def sample(axes: Sequence[Axis], method: str, seed: int = 1) -> Plan:
    """Return a sample of the axes' ranges: ``lhs:500`` (Latin hypercube) or ``sobol:512``.

    An axis with values takes each of them about equally often. The same seed gives the same sample
    (scipy.stats.qmc).
    """
    import numpy as np
    from scipy.stats import qmc

    match = _SAMPLE.match(method)
    if match is None:
        raise PlanError(f"the sample '{method[:80]}': write lhs:COUNT or sobol:COUNT")
    kind, count = match[1], int(match[2])
    _check_axes(axes)
    _check_count(count)
    if kind == "sobol" and count & (count - 1):
        below = 1 << (count.bit_length() - 1)
        raise PlanError(
            f"{method}: a Sobol sequence is balanced for powers of two only; take "
            f"sobol:{below} or sobol:{2 * below}"
        )
    generator = (qmc.LatinHypercube if kind == "lhs" else qmc.Sobol)(len(axes), rng=seed)
    unit = generator.random(count)
    columns = []
    for axis, share in zip(axes, unit.T, strict=True):
        if axis.range is not None:
            low, high = axis.range
            columns.append(low + (high - low) * share)
        else:
            places = np.minimum((share * len(axis.values)).astype(int), len(axis.values) - 1)
            columns.append(np.array(axis.values)[places])
    rows = np.column_stack(columns)
    return Plan(tuple(axis.name for axis in axes), tuple(map(tuple, rows.tolist())))


def _check_axes(axes: Sequence[Axis]) -> None:
    if not axes:
        raise PlanError("a study varies at least one parameter, for example p=0.1:0.9:17")
    names = [axis.name for axis in axes]
    for name in names:
        if names.count(name) > 1:
            raise PlanError(f"the parameter {name} is varied twice")


def _check_count(count: int) -> None:
    if not 1 <= count <= MOST_VARIANTS:
        raise PlanError(f"the study would have {count} variants; it may have 1 to {MOST_VARIANTS}")


def read_table(path: Path) -> Plan:
    """Read variants from a CSV or Parquet table: a column per parameter, a row per variant."""
    if path.suffix.lower() == ".parquet":
        return _table(str(path), *_read_parquet(path))
    return _table(str(path), *_read_csv(path))


def _read_csv(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        if path.is_file() and path.stat().st_size > LARGEST_TABLE:
            raise PlanError(f"{path}: the table is larger than {LARGEST_TABLE} bytes")
        text = path.read_text(encoding="utf-8-sig") if path.is_file() else None
    except (OSError, ValueError) as error:
        raise PlanError(f"{path}: the table cannot be read: {error}") from error
    if text is None:
        raise PlanError(f"{path}: there is no such file")
    try:
        rows = [row for row in csv.reader(io.StringIO(text), strict=True) if any(row)]
    except csv.Error as error:
        raise PlanError(f"{path}: not a table of comma-separated values: {error}") from error
    if not rows:
        raise PlanError(f"{path}: the table is empty; its first row names the parameters")
    if len(rows[0]) == 1 and ";" in rows[0][0]:
        raise PlanError(f"{path}: its columns are separated by semicolons; use commas")
    return [name.strip() for name in rows[0]], rows[1:]


def _read_parquet(path: Path) -> tuple[list[str], list[list[str]]]:
    from pc2cad.studies.table import parquet

    arrow, reader = parquet()
    try:
        table = reader.read_table(path)
    except (OSError, arrow.ArrowException) as error:
        raise PlanError(f"{path}: not a Parquet table: {error}") from error
    return table.column_names, [
        ["" if value is None else repr(value) for value in row.values()]
        for row in table.to_pylist()
    ]


def _table(where: str, names: list[str], rows: list[list[str]]) -> Plan:
    for name in names:
        if not name or names.count(name) > 1:
            raise PlanError(f"{where}: the column '{name[:80]}' has no name or is there twice")
    _check_count(len(rows))
    variants = []
    for i, row in enumerate(rows, start=2):
        if len(row) != len(names):
            raise PlanError(f"{where}: row {i} has {len(row)} values for {len(names)} columns")
        variants.append(
            tuple(
                read_number(f"{where}, row {i}, {name}", value)
                for name, value in zip(names, row, strict=True)
            )
        )
    return Plan(tuple(names), tuple(variants))


def check_plan(plan: Plan, template: Template | BodiesTemplate) -> None:
    """Raise PlanError for a parameter that the template does not have."""
    known = [parameter.name for parameter in template.parameters]
    for name in plan.names:
        if name not in known:
            listed = ", ".join(known) or "none"
            raise PlanError(
                f"{template.name} has no parameter '{name[:80]}' (it has: {listed})"
                f"{nearest(name, known)}"
            )
