"""Workers on this machine: processes that are started afresh, watched, and replaced.

A worker has one job at a time. When it crashes, outgrows its memory or its time, that one variant
gets an outcome that says so, and a new worker takes its place; a crash is tried once more in a
fresh process first, since an earlier job may have been its cause. Threads and signals are no time
limit (the kernel holds the interpreter's lock); only ending a process is.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field

from pc2cad.errors import KernelError
from pc2cad.studies.variant import STATUS, Job, Outcome, Task
from pc2cad.trust.isolation import environment, interpreter, running
from pc2cad.trust.processes import Watch, how_it_ended

#: seconds that a worker may take to load the kernel
START_LIMIT = 120.0
#: seconds between two looks at the workers' time and memory
LOOK = 0.2


@dataclass(frozen=True)
class Limits:
    """What one variant may take; a worker that exceeds it is ended."""

    #: seconds of wall time
    seconds: float = 300.0
    #: resident memory of the worker in bytes (watched on Linux)
    memory: int = 4 * 1024**3
    #: a worker is replaced after so many jobs, in case something leaks (docs/faults.md: none did)
    jobs: int = 2000
    #: seconds that a Dask cluster may be without any worker
    wait: float = 8.0


class WorkerNotStartedError(KernelError):
    """A worker process ended or hung before it was ready."""


@dataclass(eq=False)
class _Worker:
    """One process and the job that it works on."""

    process: subprocess.Popen[bytes]
    started: float = field(default_factory=time.monotonic)
    ready: bool = False
    has_task: bool = False
    done: int = 0
    job: Job | None = None
    retried: bool = False
    begun: float = 0.0
    buffer: bytes = b""

    def give(self, task: Task, job: Job, retried: bool) -> None:
        order: dict[str, object] = {"job": asdict(job)}
        if not self.has_task:
            order["task"] = asdict(task)
        self.job, self.retried, self.begun, self.has_task = job, retried, time.monotonic(), True
        assert self.process.stdin is not None
        with suppress(OSError):  # a worker that has died is noticed when its output ends
            self.process.stdin.write(json.dumps(order).encode() + b"\n")
            self.process.stdin.flush()

    def end(self) -> None:
        """Kill the process and whatever it has started."""
        with suppress(OSError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()


class LocalEngine:
    """Runs jobs in worker processes of this machine; a context manager that ends them all.

    `command` is what the interpreter is started with, by default a worker that imports nothing
    from the current folder (see `isolation`).
    """

    def __init__(
        self,
        task: Task,
        workers: int = 0,
        limits: Limits | None = None,
        command: Sequence[str] = (),
    ) -> None:
        self._task = task
        self._command = [*interpreter(), *(command or running("pc2cad.studies.worker"))]
        self._count = workers or os.cpu_count() or 1
        self._limits = limits or Limits()
        self._workers: list[_Worker] = []
        self._selector = selectors.DefaultSelector()
        self._watched = 0.0

    def run(self, jobs: Sequence[Job]) -> Iterator[Sequence[Outcome]]:
        """Yield the outcomes of all jobs, those together that ended together."""
        try:
            yield from self._outcomes(jobs)
        finally:
            # whoever leaves early, or fails, does not want these answers any more
            for worker in [worker for worker in self._workers if worker.job is not None]:
                self._drop(worker)

    def _outcomes(self, jobs: Sequence[Job]) -> Iterator[Sequence[Outcome]]:
        waiting: deque[tuple[Job, bool]] = deque()
        source = iter(jobs)

        def take() -> tuple[Job, bool] | None:
            if waiting:
                return waiting.popleft()
            job = next(source, None)
            return None if job is None else (job, False)

        upcoming = take()
        while upcoming is not None or any(worker.job for worker in self._workers):
            while upcoming is not None and (worker := self._idle()) is not None:
                worker.give(self._task, *upcoming)
                upcoming = take()
            ended = []
            for worker in self._answering():
                outcome = self._read(worker)
                if outcome is not None:
                    ended.append(outcome)
                    # the next job goes out before anybody looks at this outcome
                    if upcoming is not None and worker in self._workers:
                        worker.give(self._task, *upcoming)
                        upcoming = take()
            for outcome, again in self._overdue():
                if again is not None:
                    waiting.append((again, True))
                else:
                    ended.append(outcome)
            if ended:
                yield ended
            upcoming = upcoming or take()

    def _idle(self) -> _Worker | None:
        """Return a worker without a job, a new one while there are too few, or None."""
        for worker in self._workers:
            if worker.job is None:
                return worker
        return self._start() if len(self._workers) < self._count else None

    def _start(self) -> _Worker:
        variables = {**environment(), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        # Dask's nannies set it: pages would go back to the system, and come again, all the time
        variables.pop("MALLOC_TRIM_THRESHOLD_", None)
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            start_new_session=True, env=variables,
        )  # fmt: skip
        worker = _Worker(process)
        self._workers.append(worker)
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        self._selector.register(process.stdout, selectors.EVENT_READ, worker)
        return worker

    def _drop(self, worker: _Worker) -> None:
        assert worker.process.stdout is not None
        self._selector.unregister(worker.process.stdout)
        self._workers.remove(worker)
        worker.end()

    def _answering(self) -> list[_Worker]:
        return [key.data for key, _ in self._selector.select(timeout=LOOK)]

    def _read(self, worker: _Worker) -> Outcome | None:
        """Take what a worker has written; return its outcome when it is whole."""
        assert worker.process.stdout is not None
        data = worker.process.stdout.read()
        if data == b"":
            self._watched = 0.0  # it has ended: _overdue finds it at once
            return None
        worker.buffer += data or b""
        line, end, rest = worker.buffer.partition(b"\n")
        if not end:
            return None
        worker.buffer = rest
        answer = json.loads(line)
        if "ready" in answer:
            worker.ready, worker.begun = True, time.monotonic()
            return self._read(worker) if rest else None
        worker.job, worker.done = None, worker.done + 1
        if worker.done >= self._limits.jobs:
            self._drop(worker)
        return Outcome.from_dict(answer)

    def _overdue(self) -> list[tuple[Outcome, Job | None]]:
        """End workers that broke a limit or died; return outcomes, or jobs to try once more."""
        results: list[tuple[Outcome, Job | None]] = []
        now = time.monotonic()
        if now < self._watched:
            return results
        self._watched = now + LOOK
        for worker in list(self._workers):
            reason, again = self._complaint(worker, now)
            if not reason:
                continue
            job, retried, seconds = worker.job, worker.retried, now - worker.begun
            self._drop(worker)
            if job is not None:
                outcome = Outcome(job.key, STATUS[5], reason, times={"total": seconds})
                results.append((outcome, job if again and not retried else None))
        return results

    def _complaint(self, worker: _Worker, now: float) -> tuple[str, bool]:
        """Return what is wrong with a worker ('' for nothing), and whether to try its job again."""
        code = worker.process.poll()
        if code is not None:
            if not worker.ready:
                raise WorkerNotStartedError(
                    "a worker process ended before it was ready; does 'pc2cad check pyramid' work?"
                )
            return how_it_ended(code), True
        if not worker.ready:
            if now - worker.started > START_LIMIT:
                raise WorkerNotStartedError(f"no worker was ready within {START_LIMIT:g} s")
            return "", False
        if worker.job is None:
            return "", False
        limits = self._limits
        watch = Watch(worker.process.pid, limits.seconds, limits.memory, worker.begun)
        return watch.broken_limit(), False

    def __enter__(self) -> LocalEngine:
        return self

    def __exit__(self, *error: object) -> None:
        for worker in list(self._workers):
            self._drop(worker)
        self._selector.close()
