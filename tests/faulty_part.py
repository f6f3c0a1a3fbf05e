"""A stand-in for what makes a page's payload; in a module of its own, which loads fast."""

from __future__ import annotations

import ctypes
import os
import time

from pc2cad.errors import NotASolidError


def work(values: dict[str, str]) -> bytes:
    """Return the number of this process, or do what goes wrong."""
    match values.get("do"):
        case "hang":
            ctypes.PyDLL(None).sleep(60)
        case "crash":
            os.abort()
        case "grow":
            hog = bytearray(os.urandom(1)) * 2**29
            time.sleep(60 + len(hog) * 0)
        case "refuse":
            raise NotASolidError("the map folds")
        case "fail":
            raise ZeroDivisionError("by nothing")
    return str(os.getpid()).encode()
