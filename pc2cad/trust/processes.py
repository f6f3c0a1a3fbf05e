"""What a process asks the system about another one, for those who watch over kernel work."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from pc2cad.errors import KernelError

#: number of Linux' prctl option that sends a signal when the parent ends
_PR_SET_PDEATHSIG = 1
#: allocations between two looks for cycles, of a process that works for long
_ALLOCATIONS = 100_000
#: `mallopt`: free bytes at the end of the heap that go back (M_TRIM_THRESHOLD), and size from which
#: a block is asked for by itself (M_MMAP_THRESHOLD), the largest that it takes
_KEEP = {-1: 1 << 28, -3: 1 << 25}


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


@dataclass(frozen=True)
class Watch:
    """One piece of work of a process, and what it may take."""

    process: int
    #: of time, and bytes of memory; 0 where there is no limit
    seconds: float
    memory: float
    #: when the work began, a `time.monotonic`
    begun: float = field(default_factory=time.monotonic)

    def broken_limit(self) -> str:
        """Return which limit the work broke, with the option that sets it; '' for none."""
        if self.seconds and time.monotonic() >= self.begun + self.seconds:
            return f"stopped at the time limit of {self.seconds:g} s (--time-limit)"
        if self.memory and resident_memory(self.process) > self.memory:
            limit = self.memory / 1024**3
            return f"stopped at the memory limit of {limit:g} GiB (--memory-limit)"
        return ""


def how_it_ended(code: int) -> str:
    """Return the words for an exit code as `subprocess` gives it: negative for a signal."""
    how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return f"the process that did the work ended by {how}"


def end_with_parent() -> None:
    """Let this process be killed when its parent ends (Linux)."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def keep_freed_memory() -> None:
    """Let arrays that are freed leave their memory to the next ones (the C library of Linux).

    It would give larger ones back, and ask the system for new pages, each of which is filled with
    nought first: a fifth of the time where arrays of a megabyte come and go.
    """
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            for option, size in _KEEP.items():
                ctypes.CDLL(None).mallopt(option, size)


def collect_rarely() -> None:
    """Look for cycles of garbage only once in many allocations, as one piece of work needs it.

    Libraries make hundreds of thousands of objects that stay, and so do solids of many faces: the
    collector would look through all of them again and again, a fifth of the time of 2,000 faces.
    """
    gc.set_threshold(_ALLOCATIONS)


def leave_without_collecting() -> None:
    """Leave all that is there to the system, which takes the memory of a process that ends.

    The interpreter would look for cycles in it several times: a fifth of a small command's time.
    """
    gc.freeze()


def keep_what_is_loaded() -> None:
    """Never again look for cycles among the objects that are there, such as the kernel's library.

    For processes that do one piece of work after another: each would pay for hundreds of thousands
    of objects that stay.
    """
    gc.collect()
    gc.freeze()
    collect_rarely()
