"""Ctrl-C that cannot get lost.

Python raises KeyboardInterrupt wherever it happens to be: also where an extension module clears
errors, or where a callback has nobody to raise to. There the interruption is forgotten, and the
command runs on.
"""

from __future__ import annotations

import signal
import sys
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

#: seconds after which an interruption that nobody carries any more is raised again
AGAIN = 0.5


class Interruption(KeyboardInterrupt):
    """An interruption that can be asked whether it is still on its way."""


@contextmanager
def insistent() -> Iterator[None]:
    """Raise an interruption again for as long as it has ended nothing; once while it is under way.

    Only for the main thread of a process that is ours and ends after the block, where it is too
    late for interruptions. Does nothing where there are no timers, or where interruptions are
    ignored or already somebody else's.
    """
    if not hasattr(signal, "setitimer") or (
        signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    raised: weakref.ref[Interruption] | None = None

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal raised
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        if raised is None or raised() is None:
            error = Interruption()
            raised = weakref.ref(error)
            try:
                raise error
            finally:
                del error  # or this frame, which the traceback holds, would keep it alive

    def ignored(event: sys.UnraisableHookArgs) -> None:
        if not isinstance(event.exc_value, Interruption):
            sys.__unraisablehook__(event)

    sys.unraisablehook = ignored
    signal.signal(signal.SIGALRM, interrupt)
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        ignore_interruptions()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = sys.__unraisablehook__


def expect_interruptions() -> None:
    """Let Ctrl-C raise KeyboardInterrupt from here on, where it was waiting for somebody to do so.

    Where interruptions are ignored (``nohup``) they stay so.
    """
    with suppress(ValueError):  # not in the main thread
        if callable(signal.getsignal(signal.SIGINT)):
            signal.signal(signal.SIGINT, signal.default_int_handler)


def ignore_interruptions() -> None:
    """Let nothing disturb a process that is ending anyway."""
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)
