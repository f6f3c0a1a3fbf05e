"""The results table: one row per variant in the order of the plan, as CSV and Parquet.

A table is always written whole, from the outcomes so far; variants that are not finished have the
status ``waiting``. It is right at every moment, and at most a few seconds old.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pc2cad.errors import InputError
from pc2cad.export.files import write_atomically
from pc2cad.studies.plan import Plan
from pc2cad.studies.variant import Outcome
from pc2cad.trust.names import cell

WAITING = "waiting"
#: files that a table is written to
CSV, PARQUET = "results.csv", "results.parquet"
#: columns after the parameters, and what their cells are
COLUMNS: tuple[tuple[str, type], ...] = (
    ("status", str), ("reason", str), ("units", str), ("volume", float), ("area", float),
    ("centroid_x", float), ("centroid_y", float), ("centroid_z", float), ("deviation", float),
    ("evidence", str), ("injectivity", str), ("faces", int), ("shells", int), ("seconds", float),
    ("seconds_represent", float), ("seconds_build", float), ("seconds_validate", float),
    ("seconds_write", float),
)  # fmt: skip
Row = dict[str, Any]


def rows(
    plan: Plan, keys: Sequence[str], outcomes: Mapping[str, Outcome], formats: Sequence[str]
) -> list[Row]:
    """Return the rows of a table, in the order of the plan."""
    return [
        _row(number, plan.values(number), outcomes.get(key), formats)
        for number, key in enumerate(keys)
    ]


def _row(
    number: int, values: dict[str, float], outcome: Outcome | None, formats: Sequence[str]
) -> Row:
    row: Row = {"variant": number, **values}
    for name, _ in COLUMNS:
        row[name] = None
    row.update(dict.fromkeys(formats))
    if outcome is None:
        row["status"] = WAITING
        return row
    row.update(outcome.figures)
    row["status"], row["reason"] = outcome.status, outcome.reason
    row["seconds"] = outcome.times.get("total")
    for part in ("represent", "build", "validate", "write"):
        row[f"seconds_{part}"] = outcome.times.get(part)
    row.update({name: f"files/{file}" for name, file in outcome.files.items()})
    return row


def to_csv(table: Sequence[Row]) -> bytes:
    """Return a table as CSV; numbers come back as the same doubles.

    A text that a spreadsheet would take for a formula has an apostrophe before it.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_cell(name) for name in table[0]])
    writer.writerows([_cell(row[name]) for name in table[0]] for row in table)
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return cell(value)
    return repr(value) if isinstance(value, float) else value


def to_parquet(table: Sequence[Row], plan: Plan, formats: Sequence[str]) -> bytes:
    """Return a table as Parquet (needs pyarrow)."""
    arrow, writer = parquet()
    kinds = {str: arrow.string(), float: arrow.float64(), int: arrow.int64()}
    schema = arrow.schema(
        [("variant", arrow.int64())]
        + [(name, arrow.float64()) for name in plan.names]
        + [(name, kinds[kind]) for name, kind in COLUMNS]
        + [(name, arrow.string()) for name in formats]
    )
    sink = arrow.BufferOutputStream()
    writer.write_table(arrow.Table.from_pylist(list(table), schema=schema), sink)
    return bytes(sink.getvalue())


def parquet() -> tuple[Any, Any]:
    """Return pyarrow and its Parquet module; raise InputError where they are missing."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise InputError("Parquet tables need pyarrow: pip install 'pc2cad[study]'") from error
    return pyarrow, pyarrow.parquet


class TableWriter:
    """Writes the tables of a study again and again, but never spends much of its time on it."""

    def __init__(
        self, folder: Path, plan: Plan, keys: Sequence[str], formats: Sequence[str]
    ) -> None:
        self._folder = folder
        self._plan = plan
        self._keys = keys
        self._formats = formats
        self._next = 0.0
        try:
            parquet()
        except InputError:
            self.with_parquet = False
        else:
            self.with_parquet = True

    def offer(self, outcomes: Mapping[str, Outcome]) -> None:
        """Write the tables if they have not been written for a while."""
        if time.monotonic() >= self._next:
            self.write(outcomes)

    def write(self, outcomes: Mapping[str, Outcome]) -> list[Row]:
        """Write the tables now and return their rows."""
        start = time.monotonic()
        table = rows(self._plan, self._keys, outcomes, self._formats)
        write_atomically(self._folder / CSV, to_csv(table), owned=True)
        if self.with_parquet:
            data = to_parquet(table, self._plan, self._formats)
            write_atomically(self._folder / PARQUET, data, owned=True)
        spent = time.monotonic() - start
        # at most 2 % of the time goes into tables
        self._next = time.monotonic() + max(1.0, 50 * spent)
        return table
