"""The same jobs on a Dask cluster.

A Dask worker hands each job to a guarded process of its own (`LocalEngine` with one worker), so
that a crash of the kernel ends that process and never the Dask worker, whose other tasks would be
blamed for it.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from types import TracebackType
from typing import Any

from pc2cad.errors import InputError, KernelError
from pc2cad.studies.local import Limits, LocalEngine
from pc2cad.studies.variant import STATUS, Job, Outcome, Task

#: jobs under way for each thread of the cluster: none waits for the scheduler
AHEAD = 3


class ClusterLostError(KernelError):
    """The Dask cluster cannot be reached, or has ended."""


_engines = threading.local()


def _guarded(job: Job, task: Task, limits: Limits) -> Outcome:
    """Run one job in this thread's guarded process; runs on a Dask worker."""
    kept: tuple[Task, Limits, LocalEngine] | None = getattr(_engines, "engine", None)
    if kept is None or kept[:2] != (task, limits):
        if kept is not None:
            kept[2].__exit__(None, None, None)
        kept = (task, limits, LocalEngine(task, 1, limits))
        _engines.engine = kept
        atexit.register(kept[2].__exit__, None, None, None)
    ((outcome,),) = kept[2].run([job])
    return outcome


class DaskEngine:
    """Runs jobs on a Dask cluster: an address, or a cluster object such as `LocalCluster`."""

    def __init__(self, task: Task, cluster: Any, limits: Limits | None = None) -> None:
        try:
            import distributed
        except ImportError as error:
            raise InputError("Dask is not installed: pip install 'pc2cad[study]'") from error
        self._distributed = distributed
        self._task = task
        self._limits = limits or Limits()
        try:
            self._client = distributed.Client(cluster, timeout="10s")
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterLostError(f"the Dask cluster {cluster} cannot be reached: {error}") from (
                error
            )

    def run(self, jobs: Iterable[Job]) -> Iterator[Sequence[Outcome]]:
        """Yield the outcomes of all jobs, those together that ended together."""
        source = iter(jobs)
        waiting: dict[Any, Job] = {}

        def submit(count: int) -> list[Any]:
            """Send the next jobs in one message, which costs the scheduler far less than many."""
            jobs = list(islice(source, count))
            futures = self._client.map(
                # with each job, a few kB: data that is spread over the workers beforehand is lost
                # with them, and a worker that comes later has none
                _guarded, jobs, task=self._task, limits=self._limits, pure=False, retries=2,
            )  # fmt: skip
            waiting.update(zip(futures, jobs, strict=True))
            return list(futures)

        threads = max(1, sum(self._client.nthreads().values()))
        ended = self._distributed.as_completed(submit(AHEAD * threads))
        for futures in ended.batches():
            # an outcome that was lost with its worker is being worked out again
            lost = [future for future in futures if future.status == "lost"]
            here = [future for future in futures if future not in lost]
            # the next jobs go out before anybody looks at these outcomes
            ended.update([*lost, *submit(len(here))])
            yield [self._result(future, waiting.pop(future)) for future in here]

    def _result(self, future: Any, job: Job) -> Outcome:
        try:
            outcome: Outcome = future.result()
        except Exception as error:  # what the cluster raises is the fate of this variant
            if isinstance(error, self._distributed.client.FutureCancelledError):
                raise ClusterLostError("the Dask cluster has ended; go on with --resume") from error
            return Outcome(job.key, STATUS[5], f"the cluster gave it up: {error}")
        return outcome

    def __enter__(self) -> DaskEngine:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with suppress(OSError, TimeoutError):
            self._client.close()
