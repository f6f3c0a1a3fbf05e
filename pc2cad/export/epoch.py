"""SOURCE_DATE_EPOCH: the time that files are to state instead of the present one."""

from __future__ import annotations

import os
from datetime import UTC, datetime

from pc2cad.errors import InputError

NAME = "SOURCE_DATE_EPOCH"


def stated_time() -> datetime | None:
    """Return the time that the environment states; None where it states none (also when empty).

    Raises InputError for anything but a whole number of seconds up to the year 9999.
    """
    given = os.environ.get(NAME, "")
    if not given:
        return None
    try:
        if not (given.isascii() and given.isdigit()):
            raise ValueError(given)
        return datetime.fromtimestamp(int(given), UTC)
    except (ValueError, OverflowError, OSError):
        raise InputError(
            f"{NAME} is {given[:40]!r}; it must be a whole number of seconds since 1970"
        ) from None
