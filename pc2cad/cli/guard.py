"""A command in a process of its own, watched by the one that was started.

The kernel is C++ that may crash or never come back, and it holds the interpreter's lock meanwhile:
no thread and no alarm of the same process can end it. So the command forks while it is small (no
kernel, no threads); the child works, and its parent ends it at the limits.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from pc2cad.errors import InputError
from pc2cad.trust.processes import (
    CrashedError,
    LimitReachedError,
    Watch,
    end_with_parent,
    how_it_ended,
)

#: seconds between two looks at the time and the memory
LOOK = 0.2
#: seconds after which a child still at work is told of an interruption: Ctrl-C reaches it by
#: itself, `kill -INT` does not
TOLD = 0.3
#: seconds that an interrupted command has to tidy up
GRACE = 5.0
#: signals that somebody sends to end the command: the child gets them, and its fate is ours
ENDING = ("SIGTERM", "SIGHUP", "SIGQUIT")
INTERRUPTED = "interrupted"
#: seconds, and GiB: nobody means more
LARGEST_LIMIT = 1e9
_KEPT = "what was being written is as it was before"


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add ``--time-limit`` and ``--memory-limit``."""
    limits = parser.add_argument_group("limits")
    limits.add_argument(
        "--time-limit", type=float, default=600.0, metavar="SECONDS",
        help="end the command after this time, 0 for never (default: %(default)g)",
    )  # fmt: skip
    limits.add_argument(
        "--memory-limit", type=float, default=8.0, metavar="GIB",
        help="end the command when it holds more memory, 0 for any (default: %(default)g; Linux)",
    )  # fmt: skip
    parser.set_defaults(guarded=True)


def check_limits(seconds: float, memory: float, least: float) -> None:
    """Raise InputError unless both limits are numbers from `least` (0: no limit) to a billion."""
    for option, value in (("--time-limit", seconds), ("--memory-limit", memory)):
        if not least <= value <= LARGEST_LIMIT:
            kind = ", or 0 for none" if not least else ""
            raise InputError(f"{option} {value:g}: takes a positive number up to 1e9{kind}")


def guard(arguments: argparse.Namespace) -> int | None:
    """Fork; return None in the child, which does the work, and its exit code in the parent.

    Raises LimitReachedError, CrashedError or KeyboardInterrupt in the parent. Returns None at once
    where there is nothing to guard or no fork, and for a server, which guards each part.
    """
    if not getattr(arguments, "guarded", False):
        return None
    seconds, memory = arguments.time_limit, arguments.memory_limit
    check_limits(seconds, memory, 0.0)
    if getattr(arguments, "serve", False) or not hasattr(os, "fork"):
        return None
    reading, writing = os.pipe()
    parent = os.getpid()
    # until each of the two is ready for it, an interruption waits
    free = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_SETMASK, free)
        os.close(reading)  # the other end closes when this process ends, which wakes the parent
        end_with_parent()
        if os.getppid() != parent:
            os._exit(1)
        return None
    os.close(writing)
    try:
        signals = _Signals(child)
        signal.pthread_sigmask(signal.SIG_SETMASK, free)
        reason, code = _watch(Watch(child, seconds, memory * 1024**3), reading, signals)
    finally:
        os.close(reading)
    if code >= 0 and not reason:
        return code
    _sweep(arguments, child)
    if code == -signal.SIGINT or reason is INTERRUPTED:
        raise KeyboardInterrupt
    if reason:
        raise LimitReachedError(f"{arguments.template}: {reason}; {_KEPT}")
    if -code in {getattr(signal, name) for name in ENDING}:
        _die_of(-code)
    raise CrashedError(f"{arguments.template}: {how_it_ended(code)}, {_blame(-code)}; {_KEPT}")


class _Signals:
    """Passes on to the child what ends a command, and notes when it was interrupted.

    Attributes:
        interrupted: the time of the first interruption, infinite before

    """

    def __init__(self, child: int) -> None:
        self.interrupted = float("inf")
        with suppress(ValueError):  # not in the main thread: then signals are not ours to pass on
            if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
                signal.signal(signal.SIGINT, self._note)
            for name in ENDING:
                signal.signal(getattr(signal, name), lambda number, _: os.kill(child, number))

    def _note(self, _: int, __: FrameType | None) -> None:
        self.interrupted = min(self.interrupted, time.monotonic())


def _watch(watch: Watch, reading: int, signals: _Signals) -> tuple[str, int]:
    """Wait for the child; return what it was ended for ('' for nothing) and its exit code."""
    child, reason = watch.process, ""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return reason, os.waitstatus_to_exitcode(status)
        now = time.monotonic()
        reason = INTERRUPTED if now >= signals.interrupted + GRACE else watch.broken_limit()
        if reason:
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            return reason, os.waitstatus_to_exitcode(status)
        if now >= signals.interrupted + TOLD:
            os.kill(child, signal.SIGINT)
        if select.select([reading], [], [], LOOK)[0]:
            _, status = os.waitpid(child, 0)
            return reason, os.waitstatus_to_exitcode(status)


def _sweep(arguments: argparse.Namespace, child: int) -> None:
    """Remove what the child was writing when it ended."""
    from pc2cad.export.files import sweep_after

    given = vars(arguments)
    for path in (given.get("output"), given.get("report"), *given.get("outputs", ())):
        if path is not None:
            sweep_after(Path(os.path.realpath(path)).parent, child)


def _blame(number: int) -> str:
    if number == signal.SIGKILL:
        return "perhaps for lack of memory"
    return "a fault of the CAD kernel: please report the template"


def _die_of(number: int) -> NoReturn:
    """End as the child did, so that who sent the signal sees what it expects."""
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    raise SystemExit(128 + number)
