"""``pc.study``: a study from a template's name to its results table."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.export.files import write_atomically
from pc2cad.export.registry import format_for
from pc2cad.options import CompileOptions
from pc2cad.studies.local import Limits, LocalEngine
from pc2cad.studies.over_ranges import packed, proof_of_plan
from pc2cad.studies.overview import contact_sheet, plot
from pc2cad.studies.plan import Plan, check_plan, grid, read_axes, sample
from pc2cad.studies.run import Engine, Progress, StudyResult, run_study
from pc2cad.studies.store import open_store
from pc2cad.studies.table import COLUMNS
from pc2cad.studies.variant import Task, file_name
from pc2cad.studies.variants_table import read_table
from pc2cad.templates.file import parse_template, read_template_text
from pc2cad.templates.shipped import find_template
from pc2cad.trust.names import NameNotAllowedError, is_ending

SHEET = "contact-sheet.png"


def study(
    template: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    vary: Mapping[str, str | Sequence[float]] | None = None,
    table: str | os.PathLike[str] | None = None,
    sampling: str | None = None,
    seed: int = 1,
    fixed: Mapping[str, float | str] | None = None,
    formats: Sequence[str] = ("step",),
    thumbnails: bool = False,
    verify: bool = False,
    tolerance: float | None = None,
    degree: int | None = None,
    max_degree: int | None = None,
    profile: str = "compact",
    workers: int = 0,
    cluster: Any = None,
    limits: Limits | None = None,
    store: str | None = None,
    resume: bool = False,
    stop_after: int | None = 100,
    progress: Callable[[Progress], None] | None = None,
    plots: Sequence[tuple[str, str]] = (),
) -> StudyResult:
    """Build many variants of a template and return the table of what became of each.

    `vary` maps parameters to values, or to texts as ``--vary`` takes them (``"0.1:0.9:17"``);
    every combination is a variant, unless `sampling` (``"lhs:500"``, ``"sobol:512"``) draws from
    their ranges. `table` names a CSV or Parquet file of variants instead. `fixed` sets parameters
    that do not vary, and points, as ``-s`` does. `thumbnails` adds a picture of every part, and
    ``contact-sheet.png`` of them all. With `verify` every STEP file is held against the equation
    before it is stored, and a variant that fails is ``not verified``. Files go to ``folder/files``,
    or to the `store`: a folder or an address for fsspec. `cluster` is a Dask cluster or its
    address; without one, `workers` processes of this machine do the work (0: one for each
    processor), each variant within the `limits`. `plots` are columns of the table to be drawn
    against parameters. `resume` goes on where an interrupted study stopped, if it is the same
    study. See `run_study` for the rest; raises PlanError and TemplateError besides.
    """
    options = CompileOptions(tolerance, degree, max_degree, profile)
    path = find_template(os.fspath(template))
    task = _task(path, folder, store, formats, options, fixed or {})
    task = replace(task, thumbnails=thumbnails, verify=verify)
    work = _Study(path, _plan(vary or {}, table, sampling, seed), task, Path(folder), plots)
    engine = _engine(cluster, workers, limits or Limits())
    return work.run(engine, resume, stop_after, progress)


def _task(
    path: Path,
    folder: str | os.PathLike[str],
    store: str | None,
    formats: Sequence[str],
    options: CompileOptions,
    fixed: Mapping[str, float | str],
) -> Task:
    """Return what every variant has in common; the template's text is read here, once."""
    if not os.fspath(folder):
        raise FileNotWrittenError("the study's folder has no name; give one")
    return Task(
        template=read_template_text(path),
        name=path.stem,
        formats=_formats(formats),
        store=store or os.path.join(os.path.abspath(folder), "files"),
        fixed=dict(fixed),
        **asdict(options),
    )


class _Study:
    """A plan and a task that belong together, and the pictures that are drawn of the results."""

    def __init__(
        self,
        path: Path,
        plan: Plan,
        task: Task,
        folder: Path,
        plots: Sequence[tuple[str, str]],
    ) -> None:
        self._plan, self._task, self._folder = plan, task, folder
        self._plots = {f"{column}-{against}.png": (column, against) for column, against in plots}
        read = parse_template(task.template, task.name, str(path))
        check_plan(plan, read)
        _check_columns(plan, task, self._plots.values())
        read.bind(task.fixed)
        self._template = read
        _ = task.options  # refused before the work begins

    def run(
        self,
        engine: Callable[[Task], AbstractContextManager[Engine]],
        resume: bool,
        stop_after: int | None,
        progress: Callable[[Progress], None] | None,
    ) -> StudyResult:
        """Run the study and draw its pictures."""
        proof = proof_of_plan(self._template, self._plan, self._task.fixed)
        task = replace(self._task, known=packed(proof))
        sheet = (SHEET,) if self._task.thumbnails else ()
        result = run_study(
            self._plan, task, self._folder, engine,
            resume=resume, stop_after=stop_after, progress=progress, also=(*sheet, *self._plots),
        )  # fmt: skip
        pictures = {name: plot(result.rows, *columns) for name, columns in self._plots.items()}
        if self._task.thumbnails:
            keys = (self._task.key(self._plan.values(n)) for n in range(len(self._plan)))
            files = [file_name(key, "thumbnail") for key in keys]
            store = open_store(self._task.store)
            pictures[SHEET] = contact_sheet(result.rows, self._plan.names, files, store)
        for name, image in pictures.items():
            write_atomically(result.folder / name, image, owned=True)
        return replace(result, proof=proof)


def _check_columns(plan: Plan, task: Task, plots: Iterable[tuple[str, str]]) -> None:
    """Raise InputError for a parameter that has a column's name, and for plots without columns."""
    figures = ["variant", *(name for name, kind in COLUMNS if kind is not str)]
    others = {*figures, *(name for name, _ in COLUMNS), *task.formats, "thumbnail"}
    for name in plan.names:
        if name in others:
            raise InputError(
                f"the parameter {name} cannot vary in a study: the results have a column of that "
                "name; call it otherwise"
            )
    for name in (name for columns in plots for name in columns):
        if name not in (*plan.names, *figures):
            raise InputError(f"plots: the results have no column of numbers '{name[:80]}'")


def _formats(endings: Sequence[str]) -> tuple[str, ...]:
    """Return endings as they stand in files' names; raise InputError for one of no format."""
    found = tuple(dict.fromkeys(ending.removeprefix(".").lower() for ending in endings))
    for ending in found:
        if not is_ending(ending):
            raise NameNotAllowedError(f"the format {ending[:80]!r} is no ending of a file's name")
        format_for(f"part.{ending}")
    return found


def _plan(
    vary: Mapping[str, str | Sequence[float]],
    table: str | os.PathLike[str] | None,
    sampling: str | None,
    seed: int,
) -> Plan:
    if table is not None:
        if vary or sampling:
            raise InputError("a table gives the variants; nothing else varies or samples them")
        return read_table(Path(table))
    axes = read_axes(vary)
    return grid(axes) if sampling is None else sample(axes, sampling, seed)


def _engine(
    cluster: Any, workers: int, limits: Limits
) -> Callable[[Task], AbstractContextManager[Engine]]:
    def make(task: Task) -> AbstractContextManager[Engine]:
        if cluster is None:
            return LocalEngine(task, workers, limits)
        from pc2cad.studies.dask import DaskEngine

        return DaskEngine(task, cluster, limits)

    return make
