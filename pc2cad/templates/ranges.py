"""Values of a parameter in words: ``LOW:HIGH:COUNT``, ``A,B,C`` or the range ``LOW:HIGH``.

Studies, and the sliders of a page, vary parameters by the same texts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from pc2cad.equation.language import read_expression
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr

#: more values than this are taken for a slip of the pen
LONGEST: Final = 1_000_000
#: a plain decimal number, which is read without an expression
_DECIMAL: Final = re.compile(r"-?[0-9]{1,20}(?:\.[0-9]{0,20})?(?:[eE][+-]?[0-9]{1,2})?\Z")


class RangeError(InputError):
    """The values of a parameter are not well described."""


@dataclass(frozen=True)
class Axis:
    """One parameter that varies: its values in order, or a range that a sample is drawn from."""

    name: str
    values: tuple[float, ...] = ()
    range: tuple[float, float] | None = None


def split_setting(option: str, text: str) -> tuple[str, str]:
    """Return the name and the values of an option's ``NAME=VALUES``; raise RangeError."""
    name, _, given = (part.strip() for part in text.partition("="))
    if not (name and given):
        raise RangeError(
            f"{option} '{text[:80]}': write NAME=LOW:HIGH:COUNT, NAME=A,B,C or, for a range, "
            "NAME=LOW:HIGH"
        )
    return name, given


def read_axis(name: str, given: str | Sequence[float]) -> Axis:
    """Return the axis of a parameter: its values, or a text that describes them.

    ``0.1:0.9:17`` stands for 17 values, ends included; ``0.2,0.5`` for these; ``0.1:0.9`` for a
    range that a sample is drawn from. Each number may be a constant expression such as ``1/3``.
    Raises RangeError.
    """
    where = f"values of {name[:80]}"
    if not isinstance(given, str):
        try:
            texts = [repr(float(value)) for value in given]
        except (TypeError, ValueError, OverflowError):
            raise RangeError(f"{where}: a text such as 0.2:0.8, or numbers, are needed") from None
        return Axis(name, tuple(dict.fromkeys(read_number(where, text) for text in texts)))
    parts = given.split(":")
    if len(parts) == 1:
        if given.count(",") >= LONGEST:
            raise RangeError(f"{where}: there are more than {LONGEST}")
        values = tuple(read_number(where, part) for part in given.split(","))
        return Axis(name, tuple(dict.fromkeys(values)))
    if len(parts) > 3:
        raise RangeError(f"{where}: '{given[:80]}' has more than LOW:HIGH:COUNT")
    low, high = (read_number(where, part) for part in parts[:2])
    if len(parts) == 2:
        if not low < high:
            raise RangeError(f"{where}: the range {low:g}:{high:g} is empty")
        return Axis(name, range=(low, high))
    count = parts[2].strip()
    if not re.fullmatch(r"[0-9]{1,15}", count) or int(count) < 1:
        raise RangeError(
            f"{where}: the third part of '{given[:80]}' is the count of values, a whole "
            "number from 1 on"
        )
    return Axis(name, _spread(name, low, high, int(count)))


def _spread(name: str, low: float, high: float, count: int) -> tuple[float, ...]:
    if count > LONGEST:
        raise RangeError(f"values of {name}: {count} are more than {LONGEST}")
    if (count == 1) != (low == high):
        raise RangeError(
            f"values of {name}: {count} from {low:g} to {high:g}; one value needs equal ends, "
            "several need different ones"
        )
    if count == 1:
        return (low,)
    # exact steps rounded once, so that 0.1:0.9:17 holds 0.5 and not its neighbour: the values are
    # whole numbers over one denominator, and Python rounds such a quotient right
    first, last = Fraction(repr(low)), Fraction(repr(high))
    step = (last - first) / (count - 1)
    below = math.lcm(first.denominator, step.denominator)
    begin, by = int(first * below), int(step * below)
    return tuple((begin + by * i) / below for i in range(count))


def read_number(where: str, text: str) -> float:
    """Return the finite number that a constant expression stands for; raise RangeError."""
    if _DECIMAL.match(text):
        number = float(text) + 0.0  # no negative zero
        if number == 0.0 or 1e-60 < abs(number) < 1e60:
            return number
    try:
        tree = read_expression(text.strip(), {})
        value = evaluate(tree, {}) if isinstance(tree, Expr) else math.nan
    except InputError as error:
        raise RangeError(f"{where}: '{text.strip()[:80]}': {error}") from error
    if not math.isfinite(value):
        raise RangeError(f"{where}: '{text.strip()[:80]}' is no finite number")
    return value
