"""Numbers of any kind as exact fractions, whatever is given in their place."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any, Final

from pc2cad.errors import InputError

#: texts that stand for a number: short, and without exponents, which would be written out
_TEXT: Final = re.compile(
    r"[+-]?[0-9]{1,60}(?:\.[0-9]{0,60}|/0{0,60}[1-9][0-9]{0,60})?\Z", re.ASCII
)


class ValueDomainError(InputError):
    """A constant expression has no finite real value, or is out of the supported range."""


class NotANumberError(ValueDomainError):
    """What is given in the place of a number is none, or not a finite one."""


def exact(value: Any) -> Fraction:
    """Return the exact value of a number; a float means the decimal it prints as.

    Texts such as ``1/3`` and ``0.5``, NumPy's numbers and short decimals are taken as well. Raises
    NotANumberError for everything else.
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            raise NotANumberError(f"{value} is not a finite number")
        return Fraction(repr(float(value)))
    if isinstance(value, str) and not _TEXT.match(value):
        raise NotANumberError(
            f"'{value[:40]}' is not a number; an expression is written with u, v, w and functions "
            "of pc2cad, not as text"
        )
    if isinstance(value, Decimal) and not (value.is_finite() and abs(value.adjusted()) < 100):
        raise NotANumberError(f"{value} is outside the range 1e-60 to 1e60")
    try:
        return Fraction(value)
    except (TypeError, ValueError, OverflowError):
        found = type(value).__name__
        raise NotANumberError(f"a number is needed, and a {found} was given") from None
