"""The command ``pc2cad`` from its first moment on, also as ``python -m pc2cad``.

Until `cli.main` is loaded, which takes a tenth of a second, an interruption has nobody who would
make a sentence of it.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType

#: allocations between two looks for cycles: the kernel's library makes tens of thousands of objects
#: that stay, at which Python would look a hundred times while it loads (a tenth of the time)
_ALLOCATIONS = 100_000

_SENTENCE = b"pc2cad: interrupted; files that were being written are as they were before\n"


def _leave(number: int, _: FrameType | None) -> None:
    os.write(2, _SENTENCE)
    os._exit(128 + number)


def start() -> int:
    """Run the command and return its exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    gc.set_threshold(_ALLOCATIONS)
    from pc2cad.cli.main import main

    return main()


if __name__ == "__main__":
    sys.exit(start())
