"""Numbers of a text made as short as they can be without becoming other doubles.

Nearly all are 17 digits as printf rounds them. The double and how far it lies from those digits
follow by arithmetic on all numbers at once (products of two doubles as sums of two: Dekker, "A
floating-point technique for extending the available precision", 1971), and with them whether
fewer digits read as the same double. What is not told that way beyond doubt, and all other forms,
Python reads and prints.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pc2cad.arrays import Array

Whole = NDArray[np.int64]

#: digits of the numbers that are told by arithmetic, and decimals that make a text a number
DIGITS, DECIMALS = 17, 6
#: all but the last two digits are kept
LEAST = DIGITS - 2
#: exact, up to 10^22
_POWERS = np.array([float(10**power) for power in range(23)])
_HALVES = float(2**27 + 1)
#: in units of the last of 17 digits, of which two doubles are at least 1.1 apart
_DOUBT = 1e-6
#: points in a text below which its numbers are sooner printed anew than looked at all at once
FEW = 400
#: bytes of a text in which a word is sooner looked for by Python
SHORT = 1 << 15
_LONG = re.compile(rb"(\.(?<=[0-9]\.)[0-9]{6,}+(?:E[-+]?[0-9]++)?)")
_POINT, _ZERO, _NINE, _EXPONENT, _MINUS = b".09E-"
#: what ends a zero: a delimiter, or digits that were cut
_ENDS = np.isin(np.arange(256), list(b",)\0"))


def shortest(texts: Iterable[bytes]) -> dict[bytes, bytes]:
    """Return for each number the shortest text that reads as the same double.

    A list is printed much faster than its numbers one by one.
    """
    different = list(dict.fromkeys(texts))
    printed = repr(list(map(float, different))).replace("]", ",").replace(".0,", ".,").encode()
    found = printed[1:-1].split(b", ")
    if b"e" in printed:
        found = [_with_exponent(text) if b"e" in text else text for text in found]
    return dict(zip(different, found, strict=False))


def _with_exponent(text: bytes) -> bytes:
    mantissa, exponent = text.split(b"e")
    return mantissa + (b"E" if b"." in mantissa else b".E") + exponent


def shorten(data: bytes) -> bytes:
    """Return a text with each number of six or more decimals as short as it can be.

    Zeros lose their sign.
    """
    if data.count(b".") < FEW:
        return _printed_anew(data)
    whole = bytearray(data)
    text = np.frombuffer(whole, np.uint8)
    breaks = np.flatnonzero(text - np.uint8(_ZERO) > 9)
    at = np.flatnonzero(text[breaks] == _POINT)
    at = at[(at > 0) & (at < len(breaks) - 3)]
    points = breaks[at]
    starts, ends = breaks[at - 1] + 1, breaks[at + 1]
    number = (points > starts) & (ends - points > DECIMALS)
    at, points, starts, ends = (column[number] for column in (at, points, starts, ends))
    scaled = text[ends] == _EXPONENT
    signs = ends[scaled] + 1
    # the sign of an exponent is a break between E and its digits
    others = ~_cut(text, starts, points, ends, scaled)
    ends[scaled] = np.where(breaks[at[scaled] + 2] == signs, breaks[at[scaled] + 3], signs - 1)
    spans = list(zip(starts[others].tolist(), ends[others].tolist(), strict=True))
    known = shortest(data[start:end] for start, end in spans)
    for start, end in spans:
        whole[start:end] = known[data[start:end]].ljust(end - start, b"\0")
    minus = _places(text, b"-0.", 0)
    minus = minus[minus < len(text) - 3]
    text[minus[_ENDS[text[minus + 3]]]] = 0
    return bytes(whole.translate(None, b"\0"))


def _printed_anew(data: bytes) -> bytes:
    """Return what `shorten` does, by Python alone."""
    # what is before a number, with what it has before the point, and the rest of the number
    before, numbers = (parts := _LONG.split(data))[:-1:2], parts[1::2]
    heads = [text.rstrip(b"0123456789") for text in before]
    numbers = [t[len(h) :] + rest for t, h, rest in zip(before, heads, numbers, strict=True)]
    known = shortest(numbers)
    parts[:-1:2], parts[1::2] = heads, [known[number] for number in numbers]
    return b"".join(parts).replace(b"-0.,", b"0.,").replace(b"-0.)", b"0.)")


def holds(data: bytes, word: bytes, rare: int) -> bool:
    """Return whether a text holds a short word, sooner than `in` where a letter of it is rare.

    `rare` is the place of that letter in the word.
    """
    if len(data) < SHORT:
        return word in data
    return bool(_places(np.frombuffer(data, np.uint8), word, rare).size)


def _places(text: Any, word: bytes, rare: int) -> Whole:
    """Return where a text has a word of which one letter is rare in it."""
    found = np.flatnonzero(text == np.uint8(word[rare])) - rare
    found = found[(found >= 0) & (found <= len(text) - len(word))]
    for place, letter in enumerate(word):
        found = found[text[found + place] == letter]
    return found


def _cut(text: Any, starts: Whole, points: Whole, ends: Whole, scaled: NDArray[np.bool_]) -> Any:
    """Put NUL in place of digits that are not needed; return which numbers are as they must be."""
    decimals = ends - points - 1
    below_one = text[starts] == _ZERO
    first = np.where(below_one, ends - DIGITS, starts)
    known = ~scaled & (ends - first - (first < points) == DIGITS) & (decimals < len(_POWERS))
    known &= np.where(below_one, (points == starts + 1) & (first > points), True)
    known &= text[first] != _ZERO
    rows = np.flatnonzero(known)
    if not len(rows):
        return known
    last = ends[rows] - 1
    digits = _digits(text, starts[rows], points[rows], last)
    kept, up = _needed(digits, _POWERS[decimals[rows]])
    # after the point: there are more decimals than digits to be cut
    final = last - DIGITS + kept
    # no nine that becomes ten, and no zero at the end: those are printed anew
    lowest = text[final]
    fine = (kept > 0) & np.where(up, lowest < _NINE, (lowest > _ZERO) | (kept == DIGITS))
    text[final[fine & up]] += np.uint8(1)
    for count in range(LEAST, DIGITS):
        text[last[fine & (kept <= count)] - (DIGITS - 1 - count)] = 0
    known[rows] = fine
    return known


def _digits(text: Any, starts: Whole, points: Whole, last: Whole) -> Whole:
    """Return the `DIGITS` digits before and after a point, up to `last`, as whole numbers."""
    joined = text.copy()
    # what is before a point goes over it
    longest = int((points - starts).max(initial=0))
    for count in range(1, longest + 1):
        there = points[points - starts >= count] - count
        joined[there + 1] = text[there]
    eights = np.ndarray(len(text) - 7, "<u8", joined.data, strides=(1,))
    low, high = _eight(eights[last - 7]), _eight(eights[last - 15])
    first = (joined[last - 16] - np.uint8(_ZERO)).astype(np.uint64)
    whole = (first * np.uint64(10**8) + high) * np.uint64(10**8) + low
    return np.asarray(whole, np.int64)


def _eight(words: Any) -> Any:
    """Return the numbers of eight digits each, from the bytes of their text in words of eight.

    Tens and ones side by side make two digits, those hundreds and ones four, and so on.
    """
    words = words - np.uint64(0x3030303030303030)
    for bits, mask in ((8, 0x00FF00FF00FF00FF), (16, 0x0000FFFF0000FFFF), (32, 0xFFFFFFFF)):
        tens = np.uint64(10 ** (bits // 8))
        words = (words * tens + (words >> np.uint64(bits))) & np.uint64(mask)
    return words


def _needed(digits: Whole, powers: Array) -> tuple[Whole, NDArray[np.bool_]]:
    """Return how many digits each number needs, and whether the last of them is one more.

    Args:
        digits: (n,) the digits as whole numbers.
        powers: (n,) the powers of ten that they are to be divided by.

    No digits where that is not beyond doubt. A decimal reads as a double where it is nearer to it
    than half the way to the next one.

    """
    value = digits / powers
    value += _beyond(digits, value, powers) / powers
    off = _beyond(digits, value, powers)
    reach = np.spacing(value) / 2 * powers
    share = np.frexp(value)[0]
    # digits that are no double's nearest, and powers of two, which have two different neighbours
    sure = (np.abs(off) < 0.5 + _DOUBT) & (share > 0.5)
    kept, up = np.full(len(digits), DIGITS), np.zeros(len(digits), bool)
    for dropped in range(1, DIGITS - LEAST + 1):
        unit = 10**dropped
        rest = digits % unit - off
        above = 2 * rest > unit
        distance = np.where(above, unit - rest, np.abs(rest))
        sure &= (np.abs(distance - reach) > _DOUBT) & (np.abs(distance - unit / 2) > _DOUBT)
        enough = distance < reach
        kept[enough], up[enough] = DIGITS - dropped, above[enough]
    return np.where(sure, kept, 0), up


def _beyond(digits: Whole, value: Array, powers: Array) -> Array:
    """Return digits - value * powers, to 1e-15 of its size where it is small."""
    product = value * powers
    (a, b), (c, d) = _halves(value), _halves(powers)
    rest = ((a * c - product) + a * d + b * c) + b * d
    return np.asarray((digits - product.astype(np.int64)) - rest)


def _halves(value: Array) -> tuple[Array, Array]:
    """Return two doubles of half as many digits with the sum `value`."""
    wide = value * _HALVES
    high = wide - (wide - value)
    return high, value - high
