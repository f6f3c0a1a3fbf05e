"""Numbers of any kind as exact fractions, whatever is given in their place."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any, Final

from pc2cad.errors import InputError

#: Constants must stay where floating point has room on both sides.
LARGEST_CONSTANT: Final = Fraction(10) ** 60
_SAFE_BITS: Final = LARGEST_CONSTANT.numerator.bit_length() - 1
#: Exact numbers are no longer than this: sums and products of sums double their length each time.
LARGEST_BITS: Final = 4096
#: Powers of numbers are folded exactly only while they stay this small.
LARGEST_FOLDED_BITS: Final = 512
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
        return decimal(repr(float(value)))
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


def decimal(text: str) -> Fraction:
    """Return a number as Python writes it; its own search for the form takes thrice as long."""
    whole, _, decimals = text.partition(".")
    if not (whole.removeprefix("-") + decimals).isdecimal():
        return Fraction(text)  # with an exponent
    return Fraction(int(whole + decimals), 10 ** len(decimals))


def held(value: Fraction | int) -> Fraction:
    """Return a number as a fraction; raise ValueDomainError where it is too large, or too long."""
    numerator, denominator = value.as_integer_ratio()
    bits = max(numerator.bit_length(), denominator.bit_length())
    if bits >= _SAFE_BITS:  # nearly all numbers are short, and comparing fractions is slow
        size = abs(Fraction(value))
        if size > LARGEST_CONSTANT or (size and size < 1 / LARGEST_CONSTANT):
            raise ValueDomainError("a constant is outside the range 1e-60 to 1e60")
        if bits > LARGEST_BITS:
            raise ValueDomainError(
                f"an exact constant has over {LARGEST_BITS * 3 // 10} digits; round it to a decimal"
            )
    return value if isinstance(value, Fraction) else Fraction(value)


def exact_power(base: Fraction, exponent: Fraction) -> Fraction | None:
    """Return a power, None where it is not rational or long; raise ValueDomainError for no real."""
    if base == 0:
        if exponent < 0:
            raise ValueDomainError("division by zero")
        return Fraction(0)
    if base < 0 and exponent.denominator != 1:
        raise ValueDomainError(f"({base})**({exponent}) is not a real number")
    bits = max(abs(base.numerator).bit_length(), base.denominator.bit_length())
    if exponent.denominator == 1 and bits * abs(exponent.numerator) <= LARGEST_FOLDED_BITS:
        return base**exponent.numerator
    return None
