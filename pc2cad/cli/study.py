"""``pc2cad study``: many variants of a template, with a table of what became of each."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from pc2cad.cli.guard import check_limits
from pc2cad.cli.inputs import (
    add_options,
    add_template,
    read_options,
    read_settings,
)
from pc2cad.cli.output import Progress, say, shown, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.studies.local import Limits
    from pc2cad.studies.run import Progress as State


#: worker processes of one machine
MOST_WORKERS = 1024
#: seconds, or GiB, that a variant has at least
LEAST_LIMIT = 1e-3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the variants, the engine and its limits."""
    add_template(parser, body=False)
    _add_variants(parser)
    add_options(parser)
    _add_outputs(parser)
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted study")
    _add_workers(parser)
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def _add_variants(parser: argparse.ArgumentParser) -> None:
    what = parser.add_argument_group("variants")
    what.add_argument(
        "--vary", metavar="NAME=VALUES", action="append", default=[],
        help="values of a parameter: LOW:HIGH:COUNT, a list A,B,C, or LOW:HIGH for a sample "
        "(repeatable: every combination)",
    )  # fmt: skip
    what.add_argument("--table", metavar="FILE", help="variants from a CSV or Parquet table")
    what.add_argument(
        "--sample", metavar="METHOD:COUNT",
        help="draw a sample of the ranges: lhs:500 (Latin hypercube) or sobol:512",
    )  # fmt: skip
    what.add_argument("--seed", type=int, default=1, help="of the sample (default: %(default)s)")


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", required=True,
        help="folder for the journal, the results table and the files",
    )  # fmt: skip
    parser.add_argument(
        "--formats", metavar="A,B", default="step",
        help="files of every variant, by their endings (default: %(default)s; 'none' for none)",
    )  # fmt: skip
    parser.add_argument(
        "--store", metavar="ADDRESS",
        help="where files go: a folder or an address for fsspec (default: FOLDER/files)",
    )  # fmt: skip
    parser.add_argument(
        "--thumbnails", action="store_true",
        help="draw every part, and contact-sheet.png of them all",
    )  # fmt: skip
    parser.add_argument(
        "--verify", action="store_true",
        help="hold every STEP file against the equation before it is stored, without the kernel",
    )  # fmt: skip
    parser.add_argument(
        "--plot", metavar="COLUMN:PARAMETER", action="append", default=[],
        help="draw a column of the results against a parameter, as a PNG (repeatable)",
    )  # fmt: skip


def _add_workers(parser: argparse.ArgumentParser) -> None:
    how = parser.add_argument_group("workers")
    how.add_argument(
        "--workers", type=int, default=0, metavar="N",
        help="worker processes (default: as many as processors)",
    )  # fmt: skip
    how.add_argument("--dask", metavar="ADDRESS", help="use a Dask cluster, for example tcp://…")
    how.add_argument(
        "--wait", type=float, default=8.0, metavar="SECONDS",
        help="give up when the Dask cluster has had no worker for this time (default: %(default)s)",
    )  # fmt: skip
    how.add_argument(
        "--time-limit", type=float, default=300.0, metavar="SECONDS",
        help="end a variant that takes longer (default: %(default)s)",
    )  # fmt: skip
    how.add_argument(
        "--memory-limit", type=float, default=4.0, metavar="GIB",
        help="end a variant that takes more memory (default: %(default)s)",
    )  # fmt: skip
    how.add_argument(
        "--stop-after", type=int, default=100, metavar="N",
        help="give up when the first N variants all fail, 0 for never (default: %(default)s)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Run the study; exit code 0 even where variants were refused: the table says which."""
    from pc2cad.studies.study import study

    begun = time.monotonic()
    with Progress(arguments.quiet) as progress, named(arguments.template):

        def show(state: State) -> None:
            left = state.remaining
            rest = "" if left is None else f", about {_duration(left)} left"
            words = f"{state.finished} of {state.total} variants{rest}"
            progress.update(words, state.finished, state.total)

        result = study(
            arguments.template,
            arguments.output,
            vary=_vary(arguments.vary),
            table=arguments.table,
            sampling=arguments.sample,
            seed=arguments.seed,
            fixed=read_settings(arguments.settings),
            formats=_formats(arguments.formats),
            thumbnails=arguments.thumbnails,
            verify=arguments.verify,
            **asdict(read_options(arguments)),
            workers=arguments.workers,
            cluster=arguments.dask,
            limits=_limits(arguments),
            store=arguments.store,
            resume=arguments.resume,
            stop_after=arguments.stop_after or None,
            progress=show,
            plots=_plots(arguments.plot),
        )
    if not arguments.quiet:
        spent = _duration(time.monotonic() - begun)
        say(f"{shown(arguments.output)}: {len(result.rows)} variants, {result.built} worked out "
            f"now in {spent}")  # fmt: skip
        say(table([(status, str(count)) for status, count in sorted(result.counts.items())]))
        if result.proof is not None:
            say(f"  {result.proof.sentence}")
        for note in result.notes:
            say(f"  {note}")
        if not result.with_parquet:
            say("  results.csv only: Parquet needs pip install 'pc2cad[study]'")
    return 0


def _plots(texts: Sequence[str]) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        column, sign, against = (part.strip() for part in text.partition(":"))
        if not (column and sign and against):
            raise InputError(f"--plot '{text[:80]}': write COLUMN:PARAMETER, such as volume:p")
        pairs.append((column, against))
    return pairs


def _vary(texts: Sequence[str]) -> dict[str, str | Sequence[float]]:
    from pc2cad.templates.ranges import split_setting

    axes: dict[str, str | Sequence[float]] = {}
    for text in texts:
        name, given = split_setting("--vary", text)
        if name in axes:
            raise InputError(f"--vary {name[:80]}: the parameter is varied twice")
        axes[name] = given
    return axes


def _formats(text: str) -> list[str]:
    formats = [ending.strip().lstrip(".").lower() for ending in text.split(",")]
    return [] if formats == ["none"] else formats


def _limits(arguments: argparse.Namespace) -> Limits:
    from pc2cad.studies.local import Limits

    if not 0 <= arguments.workers <= MOST_WORKERS:
        raise InputError(
            f"--workers {arguments.workers}: takes a positive number up to {MOST_WORKERS}"
        )
    if arguments.stop_after < 0:
        raise InputError(f"--stop-after {arguments.stop_after}: takes a positive number, or 0")
    if not 0 <= arguments.wait < float("inf"):
        raise InputError("--wait takes a positive number of seconds, or 0")
    check_limits(arguments.time_limit, arguments.memory_limit, LEAST_LIMIT)
    memory = int(arguments.memory_limit * 1024**3)
    return Limits(arguments.time_limit, memory, wait=arguments.wait)


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
