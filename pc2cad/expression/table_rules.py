"""What tables may be: kinds, sizes, and the error where values make none."""

from __future__ import annotations

from typing import Final

from pc2cad.errors import InputError

KINDS: Final = ("linear", "pchip", "akima", "cubic")
#: numbers of one table
MOST_VALUES: Final = 20_000


class TableError(InputError):
    """The places or the values of a table are not as a table needs them."""
