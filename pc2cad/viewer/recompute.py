"""Payloads made in a process of their own, watched: a part that hangs does not take the page along.

The process is spawned, never forked, and kept from one part to the next; one that broke a limit or
crashed is replaced by the next request.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from pc2cad.errors import KernelError, PointCadError
from pc2cad.processes import (
    CrashedError,
    LimitReachedError,
    broken_limit,
    end_with_parent,
    how_it_ended,
)

#: seconds between two looks at the time and the memory
WATCH = 0.2
Make = Callable[[Mapping[str, str]], bytes]


class Recompute:
    """Calls `make`, which must pickle, in another process, which `close` ends.

    `seconds` and `memory` (bytes, watched on Linux) are what one call may take, 0 for any. One call
    at a time. Raises LimitReachedError, CrashedError, and the PointCadErrors of `make`.
    """

    def __init__(self, make: Make, seconds: float, memory: float) -> None:
        self._make, self._seconds, self._memory = make, seconds, memory
        self._worker: tuple[BaseProcess, Connection] | None = None

    def __call__(self, values: Mapping[str, str]) -> bytes:
        """Return the payload at these values."""
        process, pipe = self._worker = self._worker or _start(self._make)
        assert process.pid is not None
        begun = time.monotonic()
        try:
            pipe.send(dict(values))
            while not pipe.poll(WATCH):
                reason = broken_limit(process.pid, begun, self._seconds, self._memory)
                if reason:
                    self.close()
                    raise LimitReachedError(reason)
            answer = pipe.recv()
        except (EOFError, ConnectionError) as error:
            process.join()
            self.close()
            raise CrashedError(
                f"the process that did the work ended by {how_it_ended(process.exitcode or 0)}"
            ) from error
        if isinstance(answer, PointCadError):
            raise answer
        assert isinstance(answer, bytes)
        return answer

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._worker is not None:
            process, pipe = self._worker
            self._worker = None
            process.kill()
            process.join()
            pipe.close()


def _start(make: Make) -> tuple[BaseProcess, Connection]:
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(make, theirs), daemon=True)
    process.start()
    theirs.close()  # so that ours ends when the process does
    return process, ours


def _work(make: Make, pipe: Connection) -> None:
    """Answer requests until nobody asks any more; runs in the other process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    end_with_parent()
    answer: bytes | PointCadError
    while True:
        try:
            values = pipe.recv()
        except EOFError:
            return
        try:
            answer = make(values)
        except PointCadError as error:
            answer = error
        except MemoryError:
            answer = KernelError("there is not enough memory for this solid")
        except Exception as error:  # one part must not end the page
            answer = KernelError(f"an unexpected error: {type(error).__name__}: {error}")
        pipe.send(answer)
