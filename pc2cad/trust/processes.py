"""What a process asks the system about another one, for those who watch over kernel work."""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

from pc2cad.errors import KernelError

#: number of Linux' prctl option that sends a signal when the parent ends
_PR_SET_PDEATHSIG = 1


class LimitReachedError(KernelError):
    """The work took more time or memory than it was given."""


class CrashedError(KernelError):
    """The process that did the work was ended by the system or by a fault of the kernel."""


def start_of(process: int) -> str | None:
    """Return when a process began, '' where the system does not tell, None where there is none.

    The text is the same for as long as the process lives, and another one for a later process that
    has got its number. One that has ended and is only not yet buried is none.
    """
    if sys.platform == "linux":
        try:
            stat = Path(f"/proc/{process}/stat").read_bytes()
        except FileNotFoundError:
            return None
        except OSError:
            return ""
        fields = stat.rpartition(b")")[2].split()
        return None if fields[0] in (b"Z", b"X") else fields[19].decode()
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return None
    except OSError:
        return ""
    return ""


def resident_memory(process: int) -> int:
    """Return the resident memory of a process in bytes, 0 where the system does not tell."""
    try:
        pages = Path(f"/proc/{process}/statm").read_text().split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def broken_limit(process: int, begun: float, seconds: float, memory: float) -> str:
    """Return which limit a process broke, with the option that sets it; '' for none.

    `begun` is a `time.monotonic`; `seconds` and `memory` (bytes) are 0 where there is no limit.
    """
    if seconds and time.monotonic() >= begun + seconds:
        return f"stopped at the time limit of {seconds:g} s (--time-limit)"
    if memory and resident_memory(process) > memory:
        return f"stopped at the memory limit of {memory / 1024**3:g} GiB (--memory-limit)"
    return ""


def how_it_ended(code: int) -> str:
    """Return the words for an exit code as `subprocess` gives it: negative for a signal."""
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def end_with_parent() -> None:
    """Let this process be killed when its parent ends (Linux)."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
