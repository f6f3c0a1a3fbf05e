"""The same jobs on a Dask cluster.

A Dask worker hands its jobs to a guarded process of its own (`LocalEngine` with one worker), so
that a crash of the kernel ends that process and never the Dask worker, whose other tasks would be
blamed for it. What a task costs the cluster is paid once for a bundle of jobs. What became of each
job is told at once, as an event: the process of the study may be killed before the bundle ends.
"""

from __future__ import annotations

import atexit
import json
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from queue import Empty, SimpleQueue
from typing import Any

from pc2cad.errors import InputError, KernelError
from pc2cad.export.version import __version__
from pc2cad.studies.local import Limits, LocalEngine
from pc2cad.studies.scheduler import (
    SILENCE,
    ClusterLostError,
    close,
    connect,
    threads,
    versions,
)
from pc2cad.studies.variant import STATUS, Job, Outcome, Task

#: bundles under way for each thread of the cluster: none waits for the scheduler
AHEAD = 2
#: seconds that a bundle should take
BUNDLE = 2.5
#: of the events that tell what became of a job, of any study: the scheduler keeps ten thousand of
#: every topic for good
TOPIC = "pc2cad"
#: seconds between two looks at how many threads the cluster has
LOOK = 2.0
_ENDED = "the Dask cluster has ended, or does not answer any more; go on with --resume"


class NoWorkersError(KernelError):
    """The Dask cluster has no workers."""


class ClusterDiffersError(InputError):
    """A worker of the cluster has another pc2cad than the study, or none."""


_engines = threading.local()


def _guarded(task: Task, limits: Limits) -> LocalEngine:
    """Return the guarded process of this thread of a Dask worker."""
    kept: tuple[Task, Limits, LocalEngine] | None = getattr(_engines, "engine", None)
    if kept is None or kept[:2] != (task, limits):
        if kept is not None:
            kept[2].__exit__(None, None, None)
        kept = (task, limits, LocalEngine(task, 1, limits))
        _engines.engine = kept
        atexit.register(kept[2].__exit__, None, None, None)
    return kept[2]


def _run_bundle(bundle: Sequence[Job], task: Task, limits: Limits, client: str) -> list[Outcome]:
    """Run jobs one after another, tell of each when it ends; runs on a Dask worker."""
    from distributed import get_worker

    worker = get_worker()
    own = worker.state.tasks[worker.get_current_task()]
    outcomes: list[Outcome] = []
    for ended in _guarded(task, limits).run(bundle):
        for outcome in ended:
            worker.log_event(TOPIC, (client, json.dumps(asdict(outcome))))
        outcomes += ended
        if own.state == "cancelled":  # the study has ended, or was killed
            break
    return outcomes


class Supply:
    """The jobs that no worker has yet, in bundles that become shorter towards the end."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self._left = deque(jobs)
        self._alone: deque[Job] = deque()
        self._ended, self._seconds = 0, 0.0

    def note(self, outcomes: Iterable[Outcome]) -> None:
        """Learn how long jobs take."""
        for outcome in outcomes:
            self._ended += 1
            self._seconds += outcome.times.get("total", 0.0)

    def put_back(self, jobs: Iterable[Job]) -> None:
        """Take back what is left of a bundle that failed: each job goes alone."""
        self._alone.extend(jobs)

    def bundle(self, threads: int) -> Sequence[Job]:
        """Return the next jobs, none when all have gone.

        They take as long as pays, but no thread gets more than half its share of what is left
        (guided self-scheduling), so that all threads end together.
        """
        if self._alone:
            return [self._alone.popleft()]
        pays = BUNDLE * self._ended / max(self._seconds, 1e-9)
        share = len(self._left) / (2 * threads)
        count = min(max(1, int(min(pays, share))), len(self._left))
        return [self._left.popleft() for _ in range(count)]


class _Run:
    """What is under way on a cluster."""

    def __init__(
        self, client: Any, news: SimpleQueue[Any], task: Task, limits: Limits, jobs: Sequence[Job]
    ) -> None:
        self._client, self._news, self._task, self._limits = client, news, task, limits
        self._supply = Supply(jobs)
        #: keys of the jobs whose outcomes are not known
        self.waiting = {job.key for job in jobs}
        self._bundles: dict[Any, Sequence[Job]] = {}
        self._threads, self._looked, self._alive = 1, -LOOK, time.monotonic()

    def send(self) -> None:
        """Send the next bundles in one message, which costs the scheduler far less than many.

        Raises OSError or ClosedClientError when there is no cluster, NoWorkersError when it has had
        no worker for too long.
        """
        if time.monotonic() > self._looked + LOOK:
            self._look()
        room = range(AHEAD * self._threads - len(self._bundles))
        bundles = [bundle for _ in room if (bundle := self._supply.bundle(self._threads))]
        if not bundles:
            return
        futures = self._client.map(
            # with each bundle, a few kB: data that is spread over the workers beforehand is lost
            # with them, and a worker that comes later has none
            _run_bundle, bundles, task=self._task, limits=self._limits, client=self._client.id,
            pure=False, retries=2,
        )  # fmt: skip
        self._bundles.update(zip(futures, bundles, strict=True))
        for future in futures:
            future.add_done_callback(self._news.put)

    def _look(self) -> None:
        """Ask the scheduler how many threads there are: a silent one tells nothing by itself."""
        found, now = threads(self._client), time.monotonic()
        self._threads, self._looked = max(1, found), now
        if found:
            self._alive = now
        elif now > self._alive + self._limits.wait:
            raise NoWorkersError(
                f"the Dask cluster has had no worker for {self._limits.wait:g} s; start some, then "
                "go on with --resume, or give them longer with --wait"
            )

    def hear(self) -> tuple[list[Outcome], list[Any]]:
        """Wait a while for news; return outcomes, and the futures of bundles that ended."""
        try:
            news = [self._news.get(timeout=LOOK)]
        except Empty:
            return [], []
        while not self._news.empty():
            news.append(self._news.get())
        told = [Outcome.from_dict(json.loads(item)) for item in news if isinstance(item, str)]
        return self._first(told), [item for item in news if not isinstance(item, str)]

    def end(self, future: Any) -> list[Outcome]:
        """Forget a bundle that ended; return the outcomes that it had not told.

        Raises OSError, ClosedClientError or FutureCancelledError when there is no cluster.
        """
        bundle, outcomes = self._bundles.pop(future), []
        if any(job.key in self.waiting for job in bundle):
            try:
                outcomes = future.result(timeout=SILENCE)
            except Exception as error:
                if future.status != "error":
                    if not isinstance(error, TimeoutError):
                        raise
                    self._look()  # the worker that held it has been lost since: it is run again
                elif len(bundle) == 1:
                    reason = f"the cluster gave it up: {error}"
                    outcomes = [Outcome(bundle[0].key, STATUS[5], reason)]
        outcomes = self._first(outcomes)
        self._supply.put_back(job for job in bundle if job.key in self.waiting)
        return outcomes

    def _first(self, outcomes: Iterable[Outcome]) -> list[Outcome]:
        """Return those that were not known: the bundle of a lost worker is run again."""
        fresh = {outcome.key: outcome for outcome in outcomes if outcome.key in self.waiting}
        self.waiting -= fresh.keys()
        self._supply.note(fresh.values())
        return list(fresh.values())


class DaskEngine:
    """Runs jobs on a Dask cluster: an address, or a cluster object such as `LocalCluster`."""

    def __init__(self, task: Task, cluster: Any, limits: Limits | None = None) -> None:
        if find_spec("distributed") is None:
            raise InputError("Dask is not installed: pip install 'pc2cad[study]'")
        self._task = task
        self._limits = limits or Limits()
        self._client = connect(cluster)
        self._lost = False
        #: outcomes as texts, and futures of bundles that ended
        self._news: SimpleQueue[Any] = SimpleQueue()
        self._client.subscribe_topic(TOPIC, self._listen)

    def _listen(self, event: tuple[float, tuple[str, str]]) -> None:
        client, told = event[1]
        if client == self._client.id:
            self._news.put(told)

    def run(self, jobs: Sequence[Job]) -> Iterator[Sequence[Outcome]]:
        """Yield the outcomes of all jobs, those together that ended together."""
        from distributed.client import ClosedClientError, FutureCancelledError

        try:
            self._check_versions()
        except (OSError, ClosedClientError) as error:
            self._lost = True
            raise ClusterLostError(_ENDED) from error
        run = _Run(self._client, self._news, self._task, self._limits, jobs)
        outcomes: list[Outcome] = []
        futures: list[Any] = []
        while True:
            lost: Exception | None = None
            try:
                for future in futures:
                    outcomes += run.end(future)
                run.send()  # the next jobs go out before anybody looks at these outcomes
            except (OSError, ClosedClientError, FutureCancelledError, NoWorkersError) as error:
                lost = error
            if outcomes:
                yield outcomes
            if isinstance(lost, NoWorkersError):
                raise lost
            if lost:
                self._lost = True
                raise ClusterLostError(_ENDED) from lost
            if not run.waiting:
                return
            outcomes, futures = run.hear()

    def _check_versions(self) -> None:
        """Raise ClusterDiffersError: what a worker cannot unpickle would hang the study."""
        for address, found in versions(self._client, "pc2cad").items():
            if found != __version__:
                raise ClusterDiffersError(
                    f"the Dask worker {address} has {f'pc2cad {found}' if found else 'no pc2cad'}, "
                    f"the study has {__version__}: install the same one on all machines"
                )

    def __enter__(self) -> DaskEngine:
        return self

    def __exit__(self, *error: object) -> None:
        close(self._client, TOPIC, self._lost)
