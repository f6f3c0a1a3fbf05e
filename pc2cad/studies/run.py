"""Running a study: what is left to do goes to an engine, what is finished is kept at once."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pc2cad.errors import NotASolidError
from pc2cad.export.files import sweep
from pc2cad.studies.journal import Journal
from pc2cad.studies.plan import Plan
from pc2cad.studies.store import open_store
from pc2cad.studies.table import Row, TableWriter
from pc2cad.studies.variant import BUILT, Job, Outcome, Task


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
) -> StudyResult:
    """Run what is left of a study and return its table.

    `folder` gets ``journal.jsonl`` (every finished variant, at once), ``results.csv`` and
    ``results.parquet``; the task's store gets the files. Variants with equal content are built
    once. When the first `stop_after` variants all fail, the study ends with NothingBuiltError.
    Raises StudyDiffersError, JournalInUseError or FileNotWrittenError.
    """
    keys = [task.key(plan.values(i)) for i in range(len(plan))]
    first = {key: i for i, key in reversed(list(enumerate(keys)))}
    with Journal(folder, task.fingerprint, resume) as journal:
        # the journal's lock says that no other process works on this study
        sweep(folder)
        open_store(task.store).sweep()
        left = [
            Job(key, plan.values(i))
            for key, i in sorted(first.items(), key=lambda item: item[1])
            if not _is_kept(journal.outcomes.get(key), task)
        ]
        kinds = (*task.formats, *(("thumbnail",) if task.thumbnails else ()))
        table = TableWriter(folder, plan, keys, kinds)
        table.write(journal.outcomes)
        begun, total, failures = time.monotonic(), len(first), 0
        try:
            if left:
                with engine(task) as running:
                    built = 0
                    for outcomes in running.run(left):
                        journal.add(outcomes)
                        table.offer(journal.outcomes)
                        built += len(outcomes)
                        failures += sum(outcome.status != BUILT for outcome in outcomes)
                        if stop_after is not None and failures == built >= stop_after < len(left):
                            raise NothingBuiltError(
                                f"the first {built} variants all failed, the last one: "
                                f"{outcomes[-1].reason}; --stop-after 0 goes on all the same"
                            )
                        if progress is not None:
                            finished = total - len(left) + built
                            progress(Progress(finished, total, built, time.monotonic() - begun))
        finally:
            rows = table.write(journal.outcomes)
    return StudyResult(folder, rows, len(left), table.with_parquet)


def _is_kept(outcome: Outcome | None, task: Task) -> bool:
    """Say whether an outcome stands: a built variant's files must still be there."""
    if outcome is None:
        return False
    store = open_store(task.store)
    return all(store.has(name) for name in outcome.files.values())
