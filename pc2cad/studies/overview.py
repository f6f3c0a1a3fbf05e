"""Pictures of a study: any column against any parameter, and a contact sheet of the parts."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from pc2cad.errors import InputError
from pc2cad.studies.store import Store
from pc2cad.studies.table import Row
from pc2cad.studies.variant import BUILT

#: pictures on a contact sheet
MOST_PICTURES = 60


def plot(table: Sequence[Row], column: str, against: str) -> bytes:
    """Return a PNG that shows a column of a results table against another one.

    Variants that were refused are marks at the bottom, so that the edge of what is valid is seen.
    Raises InputError for a column that is not there or holds no numbers.
    """
    for name in (column, against):
        _check_column(table, name)
    good = [row for row in table if row["status"] == BUILT and row[column] is not None]
    bad = [row for row in table if row["status"] not in (BUILT, "waiting")]
    pyplot = _pyplot()
    figure, axes = pyplot.subplots(figsize=(7, 4.5), dpi=130)
    try:
        axes.scatter([r[against] for r in good], [r[column] for r in good], s=14, label=BUILT)
        if bad:
            axes.scatter(
                [r[against] for r in bad], [0.02] * len(bad), s=22, marker="x", color="#d55e00",
                transform=axes.get_xaxis_transform(), label="refused or failed",
            )  # fmt: skip
            axes.legend()
        axes.set_xlabel(against)
        axes.set_ylabel(column)
        axes.grid(alpha=0.3)
        return _png(figure)
    finally:
        pyplot.close(figure)


def contact_sheet(
    table: Sequence[Row], parameters: Sequence[str], files: Sequence[str], store: Store
) -> bytes:
    """Return a PNG of the parts' pictures with their parameters, evenly chosen.

    `files` are the names of the rows' pictures in the store. `MOST_PICTURES` are shown at most;
    where nothing was built, the status stands in the place.
    """
    chosen = list(zip(table, files, strict=True))[:: -(-len(table) // MOST_PICTURES)]
    columns = min(6, len(chosen))
    lines = -(-len(chosen) // columns)
    pyplot = _pyplot()
    figure, grid = pyplot.subplots(
        lines, columns, figsize=(2.4 * columns, 2.2 * lines), dpi=100, squeeze=False
    )
    try:
        for axes in grid.flat:
            axes.axis("off")
        for (row, file), axes in zip(chosen, grid.flat, strict=False):
            values = ", ".join(f"{name}={row[name]:.4g}" for name in parameters)
            axes.set_title(values, fontsize=7)
            if row.get("thumbnail"):
                axes.imshow(pyplot.imread(io.BytesIO(store.read(file)), format="png"))
            else:
                axes.text(0.5, 0.5, row["status"], ha="center", va="center", fontsize=8)
        return _png(figure)
    finally:
        pyplot.close(figure)


def _check_column(table: Sequence[Row], name: str) -> None:
    numbers = [n for n in table[0] if any(isinstance(row[n], (int, float)) for row in table)]
    if name not in numbers:
        raise InputError(
            f"the results have no column of numbers '{name[:80]}' (they have: {', '.join(numbers)})"
        )


def _png(figure: Any) -> bytes:
    sink = io.BytesIO()
    # no date in the file: the same study gives the same bytes
    figure.savefig(sink, format="png", metadata={"Software": None}, bbox_inches="tight")
    return sink.getvalue()


def _pyplot() -> Any:
    try:
        import matplotlib
    except ImportError as error:
        raise InputError("plots need matplotlib: pip install 'pc2cad[study]'") from error
    matplotlib.use("Agg")
    import matplotlib.pyplot

    return matplotlib.pyplot
