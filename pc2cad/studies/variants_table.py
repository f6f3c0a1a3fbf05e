"""Variants from a table: CSV or Parquet, a column per parameter and a row per variant.

A small file may hold millions of rows and columns. What it says of itself is looked at first, rows
are counted while they are read, and only numbers are kept.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pc2cad.studies.plan import (
    MOST_VARIANTS,
    Plan,
    PlanError,
    check_count,
    check_names,
)
from pc2cad.templates.ranges import read_number

#: bytes of a file, and of what its pages unfold to
LARGEST_TABLE: Final = 64 * 1024 * 1024
LARGEST_PAGES: Final = 128 * 1024 * 1024
#: rows of a Parquet table that are unfolded at once
BATCH: Final = 10_000
_NUMBERS: Final = ("BOOLEAN", "INT32", "INT64", "FLOAT", "DOUBLE")


def read_table(path: Path) -> Plan:
    """Read the variants of a table; raise PlanError where it is none, or larger than a study.

    Raises RangeError for what is no number.
    """
    try:
        size = path.stat().st_size if path.is_file() else None
    except (OSError, ValueError) as error:  # a name that no file can have
        told = getattr(error, "strerror", None) or str(error)
        raise PlanError(f"{str(path)[-80:]}: the table cannot be read: {told}") from error
    if size is None:
        raise PlanError(f"{path}: there is no such file")
    if size > LARGEST_TABLE:
        raise PlanError(f"{path}: the table is larger than {LARGEST_TABLE} bytes")
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path)
    return _read_csv(path)


def _read_csv(path: Path) -> Plan:
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            # all rows are counted before one number is made of them
            counted = (len(row) for row in csv.reader(stream, strict=True) if any(row))
            columns, count = next(counted, 0), 0
            if columns:
                check_names(columns)
            for count, _ in enumerate(counted, start=1):
                if count > MOST_VARIANTS:
                    raise PlanError(f"{path}: there are more than {MOST_VARIANTS} variants")
            if count:
                check_count(count, columns)
            stream.seek(0)
            rows = (row for row in csv.reader(stream, strict=True) if any(row))
            names = [name.strip() for name in next(rows, ())]
            if not names:
                raise PlanError(f"{path}: the table is empty; its first row names the parameters")
            if len(names) == 1 and ";" in names[0]:
                raise PlanError(f"{path}: its columns are separated by semicolons; use commas")
            return _plan(path, names, rows)
    except (OSError, UnicodeError) as error:
        raise PlanError(f"{path}: the table cannot be read: {error}") from error
    except csv.Error as error:
        raise PlanError(f"{path}: not a table of comma-separated values: {error}") from error


def _read_parquet(path: Path) -> Plan:
    from pc2cad.studies.table import parquet

    arrow, reader = parquet()
    with _named(path, arrow), reader.ParquetFile(path, memory_map=True) as file:
        _check_pages(path, file.metadata)
        names = list(file.schema_arrow.names)
        batches = file.iter_batches(batch_size=BATCH, use_threads=False)
        rows = (
            ["" if value is None else repr(value) for value in row]
            for batch in batches
            for row in zip(*(column.to_pylist() for column in batch.columns), strict=True)
        )
        return _plan(path, names, rows)


@contextmanager
def _named(path: Path, arrow: Any) -> Iterator[None]:
    try:
        yield
    except (OSError, arrow.ArrowException) as error:
        raise PlanError(f"{path}: not a Parquet table: {error}") from error


def _check_pages(path: Path, data: Any) -> None:
    """Look at what the file says of itself, before anything of it is unfolded."""
    check_names(data.num_columns)
    check_count(data.num_rows, data.num_columns)
    for k in range(data.num_columns):
        column = data.schema.column(k)
        if column.physical_type not in _NUMBERS or column.max_repetition_level:
            raise PlanError(f"{path}: the column '{column.name[:80]}' holds no numbers")
    groups = (data.row_group(i) for i in range(data.num_row_groups))
    if sum(group.total_byte_size for group in groups) > LARGEST_PAGES:
        raise PlanError(f"{path}: the table unfolds to more than {LARGEST_PAGES} bytes")


def _plan(path: Path, names: Sequence[str], rows: Iterable[Sequence[str]]) -> Plan:
    check_names(len(names))
    for name in names:
        if not name or names.count(name) > 1:
            raise PlanError(f"{path}: the column '{name[:80]}' has no name or is there twice")
    variants: list[tuple[float, ...]] = []
    for i, row in enumerate(rows, start=2):
        if len(row) != len(names):
            raise PlanError(f"{path}: row {i} has {len(row)} values for {len(names)} columns")
        if len(variants) == MOST_VARIANTS:
            raise PlanError(f"{path}: there are more than {MOST_VARIANTS} variants")
        variants.append(
            tuple(
                read_number(f"{path}, row {i}, {name}", value)
                for name, value in zip(names, row, strict=True)
            )
        )
        if not len(variants) % BATCH:
            check_count(len(variants), len(names))
    check_count(len(variants), len(names))
    return Plan(tuple(names), tuple(variants))
