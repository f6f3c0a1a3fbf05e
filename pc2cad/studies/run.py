"""Running a study: what is left to do goes to an engine, what is finished is kept at once."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from pc2cad.errors import NotASolidError
from pc2cad.export.files import sweep
from pc2cad.studies.entries import described
from pc2cad.studies.journal import Journal, Present
from pc2cad.studies.plan import Plan
from pc2cad.studies.store import Store, open_store
from pc2cad.studies.table import CSV, PARQUET, Row, TableWriter
from pc2cad.studies.variant import BUILT, Job, Outcome, Task, file_name
from pc2cad.trust.names import check_file_name

if TYPE_CHECKING:
    from pc2cad.solidity.over_ranges.boxes import RangeProof

#: by this the journal notes that the names of all files in the store are the study's own
FILES = "files/"


class Engine(Protocol):
    """Something that runs jobs: processes of this machine, or a cluster."""

    def run(self, jobs: Sequence[Job]) -> Iterator[Sequence[Outcome]]:
        """Yield the outcomes of all jobs in any order, those together that ended together."""


class NothingBuiltError(NotASolidError):
    """The first variants of a study were all refused."""


@dataclass(frozen=True)
class Progress:
    """How far a study is."""

    finished: int
    total: int
    #: variants built by this run, and seconds since it began
    built: int
    seconds: float

    @property
    def remaining(self) -> float | None:
        """Estimate of the seconds that are left; None before anything has been built."""
        if not self.built:
            return None
        return (self.total - self.finished) * self.seconds / self.built


@dataclass(frozen=True)
class StudyResult:
    """The finished study: its rows in the order of the plan."""

    folder: Path
    rows: Sequence[Row]
    #: variants that this run built, as against those found in the journal or listed twice
    built: int
    with_parquet: bool
    #: what a resumed study found otherwise than its journal says, in sentences
    notes: Sequence[str] = ()
    #: what is proved over the ranges of the parameters; None where there are too few variants
    proof: RangeProof | None = None

    @property
    def counts(self) -> dict[str, int]:
        """Return how many variants have each status."""
        return dict(Counter(str(row["status"]) for row in self.rows))


def run_study(
    plan: Plan,
    task: Task,
    folder: Path,
    engine: Callable[[Task], AbstractContextManager[Engine]],
    *,
    resume: bool = False,
    stop_after: int | None = 100,
    progress: Callable[[Progress], None] | None = None,
    also: Sequence[str] = (),
) -> StudyResult:
    """Run what is left of a study and return its table.

    `folder` gets ``journal.jsonl`` (every finished variant, at once), ``results.csv`` and
    ``results.parquet``; the task's store gets the files; `also` are names of further files that
    the caller will put into the folder. None of them takes the place of a file that is there and
    that the journal does not name. Variants with equal content are built once. What a resumed
    study's journal holds stands where the files are as they were written; others are built again,
    and a file that somebody has changed is set aside before. When the first `stop_after` variants
    all fail, the study ends with NothingBuiltError.
    Raises StudyDiffersError, JournalInUseError, NotOursError or FileNotWrittenError.
    """
    keys = [task.key(plan.values(i)) for i in range(len(plan))]
    first: dict[str, int] = {}
    for i, key in enumerate(keys):
        first.setdefault(key, i)
    kinds = (*task.formats, *(("thumbnail",) if task.thumbnails else ()))
    store = open_store(task.store)
    own = _own(folder, store, [file_name(key, kind) for key in first for kind in kinds], also)
    with Journal(folder, described(task, plan), resume, own) as journal:
        sweep(folder)
        store.sweep()
        kept, notes = _checked(journal, store, first, kinds)
        left = [Job(key, plan.values(i)) for key, i in first.items() if key not in kept]
        table = TableWriter(folder, plan, keys, kinds)
        table.write(journal.outcomes)
        total = len(first)
        try:
            if left:
                with engine(task) as running:
                    for built, seconds in _work(running, left, journal, table, stop_after):
                        if progress is not None:
                            progress(Progress(total - len(left) + built, total, built, seconds))
        finally:
            rows = table.write(journal.outcomes)
            store.sweep()
    return StudyResult(folder, rows, len(left), table.with_parquet, notes)


def _work(
    engine: Engine,
    jobs: Sequence[Job],
    journal: Journal,
    table: TableWriter,
    stop_after: int | None,
) -> Iterator[tuple[int, float]]:
    """Do the jobs, each into the journal at once; yield how many are done after how many seconds.

    Raises NothingBuiltError when the first `stop_after` all fail.
    """
    begun, built, failures = time.monotonic(), 0, 0
    for outcomes in engine.run(jobs):
        journal.add(outcomes)
        table.offer(journal.outcomes)
        built += len(outcomes)
        failures += sum(outcome.status != BUILT for outcome in outcomes)
        if stop_after is not None and failures == built >= stop_after < len(jobs):
            raise NothingBuiltError(
                f"the first {built} variants all failed, the last one: "
                f"{outcomes[-1].reason}; --stop-after 0 goes on all the same"
            )
        yield built, time.monotonic() - begun


def _own(
    folder: Path, store: Store, files: Sequence[str], also: Sequence[str]
) -> dict[str, Present]:
    """Return the names that the study writes to, and how to see what is there of each."""

    def present(name: str) -> Present:
        return lambda: [name] if os.path.lexists(folder / name) else []

    def in_store() -> list[str]:
        there = store.names()
        return [name for name in files if name in there]

    names = (CSV, PARQUET, *map(check_file_name, also))
    return {name: present(name) for name in names} | {FILES: in_store}


def _checked(
    journal: Journal, store: Store, keys: Iterable[str], kinds: Sequence[str]
) -> tuple[set[str], list[str]]:
    """Return the keys whose outcomes stand, and what was found otherwise.

    A variant that was built needs all its files, with the hashes that the journal has of them.
    """
    kept, missing, aside = set(), [], []
    for key in keys:
        outcome = journal.outcomes.get(key)
        if outcome is None:
            continue
        wrong = [] if outcome.status != BUILT else [
            (name, found) for name, hashed, found in _found(outcome, store, kinds)
            if not hashed or found != hashed
        ]  # fmt: skip
        if not wrong:
            kept.add(key)
        for name, found in wrong:
            if found is None:
                missing.append(name)
            else:
                aside.append(store.set_aside(name))
    notes = []
    if journal.unread:
        notes.append(f"{journal.unread} lines of the journal hold no outcome and are passed over")
    if missing:
        notes.append(f"files that are gone are built again: {_listed(missing)}")
    if aside:
        notes.append(f"files that were changed are set aside and built again: {_listed(aside)}")
    return kept, notes


def _found(
    outcome: Outcome, store: Store, kinds: Sequence[str]
) -> Iterator[tuple[str, str | None, str | None]]:
    """Give name, hash by the journal and hash of every file that a built variant has."""
    for kind in kinds:
        name = file_name(outcome.key, kind)
        yield name, outcome.hashes.get(kind), store.digest(name)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more}"
