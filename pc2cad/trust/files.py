"""Files that somebody names: regular ones, of a bounded size, and no other."""

from __future__ import annotations

import stat
from pathlib import Path

from pc2cad.errors import InputError


class FileNotReadError(InputError):
    """A file is not there, is no regular one, or is larger than what is read of its kind."""


def read_regular(path: Path, largest: int) -> bytes:
    """Return the bytes of a regular file of at most so many.

    A pipe or a device, which might never end, is not opened, and one byte more than the largest
    size is read at most. Raises FileNotReadError; its message does not name the path.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise FileNotReadError("not a regular file")
        with path.open("rb") as stream:
            data = stream.read(largest + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileNotReadError(f"cannot be read: {reason}") from error
    if len(data) > largest:
        size = f"{largest >> 20} MB" if largest >> 20 else f"{largest >> 10} kB"
        raise FileNotReadError(f"larger than {size}")
    return data
