"""Payloads made in a process of their own, watched: a part that hangs does not take the page along.

The process is started afresh, never forked, imports nothing from the current folder, and is kept
from one part to the next; one that broke a limit, crashed or worked for nobody is replaced by the
next request.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, BinaryIO

from pc2cad.errors import KernelError, PointCadError
from pc2cad.trust.isolation import environment, interpreter, running
from pc2cad.trust.processes import CrashedError, LimitReachedError, Watch, how_it_ended
from pc2cad.viewer.worker import Question, receive, send

#: seconds between two looks at the time and the memory
LOOK = 0.2
#: seconds that a part which nobody waits for any more has to be ended by itself: a new process has
#: to load the kernel first
GRACE = 2.0
Make = Callable[[Any], bytes]
Stale = Callable[[], bool]


class SupersededError(KernelError):
    """A newer request took the place of this one."""


class Recompute:
    """Calls `make`, which must pickle, in another process, which `close` ends.

    `seconds` and `memory` (bytes, watched on Linux) are what one call may take, 0 for any. One call
    at a time. Raises LimitReachedError, CrashedError, SupersededError, and the PointCadErrors of
    `make`.
    """

    def __init__(self, make: Make, seconds: float, memory: float) -> None:
        self._make, self._seconds, self._memory = make, seconds, memory
        self._worker: _Worker | None = None

    def __call__(self, question: Question, stale: Stale = lambda: False) -> bytes:
        """Return the answer to a question; give it up some time after it has become `stale`."""
        worker = self._worker = self._worker or _Worker(self._make)
        watch = Watch(worker.process.pid, self._seconds, self._memory)
        unwanted = float("inf")
        worker.ask(question)
        while (answer := worker.answer(LOOK)) is None:
            if reason := watch.broken_limit():
                self.close()
                raise LimitReachedError(reason)
            if stale():
                unwanted = min(unwanted, time.monotonic())
            if time.monotonic() >= unwanted + GRACE:
                self.close()
                raise SupersededError("a newer request took the place of this one")
        if isinstance(answer, EOFError):
            code = worker.process.wait()
            self.close()
            raise CrashedError(how_it_ended(code))
        if isinstance(answer, PointCadError):
            raise answer
        assert isinstance(answer, bytes)
        return answer

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._worker is not None:
            worker, self._worker = self._worker, None
            worker.end()


class _Worker:
    """The process, and a thread that waits for its answers."""

    def __init__(self, make: Make) -> None:
        self.process = subprocess.Popen(
            [*interpreter(), *running("pc2cad.viewer.worker")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env=environment(),
        )  # fmt: skip
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._questions, self._answers = self.process.stdin, SimpleQueue[Any]()
        self.ask(make)
        self._reader = Thread(
            target=_read, args=(self.process.stdout, self._answers.put), daemon=True
        )
        self._reader.start()

    def ask(self, thing: Any) -> None:
        """Send a question; `answer` tells when there is nobody to answer it."""
        with suppress(OSError):
            send(self._questions, thing)  # type: ignore[arg-type]

    def answer(self, seconds: float) -> Any:
        """Return the next answer, EOFError when there will be none, None when it takes longer."""
        try:
            return self._answers.get(timeout=seconds)
        except Empty:
            return None

    def end(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()


def _read(stream: BinaryIO, put: Callable[[Any], None]) -> None:
    try:
        while True:
            put(receive(stream))
    except (EOFError, OSError, ValueError):  # the last: the pipe was closed
        put(EOFError())
    except Exception as error:  # nobody would wait for a thread that ended
        put(KernelError(f"an unexpected error: {type(error).__name__}: {error}"))
        put(EOFError())
