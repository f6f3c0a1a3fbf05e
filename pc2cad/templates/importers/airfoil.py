"""Coordinates of airfoils (.dat, Selig's and Lednicer's order) to templates: a wing of one section.

The closed cubic spline through the points, over their chord length, is cut at the point farthest
ahead; the section lies between its two halves.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import hypot
from typing import Final

from pc2cad.templates.importers.lines import (
    Source,
    named_after,
    quoted,
    read_lines,
    table,
    written,
)

#: points of one section
FEWEST, MOST = 6, 2000
#: in Lednicer's order two counts stand before the points; no coordinate, in chords, is so large
COUNTS: Final = 2

Point = tuple[Fraction, Fraction]


def import_airfoil(file: str | os.PathLike[str], span: float | str = 5) -> str:
    """Return the text of a template of a wing with the section in a file of coordinates.

    The order is Selig's (once round from the trailing edge) or Lednicer's (two sides from the
    leading edge, after their counts). `span` is the wing's length, in chords. Raises InputError,
    with the line where the file is not of its format.
    """
    points = read_airfoil(file)
    length = read_lines_span(span)
    places = _places(points)
    ahead = min(range(len(points)), key=lambda i: points[i][0])
    name = named_after(file)
    rows = [
        f"title = {quoted(f'Wing of the section in {name}')}",
        'about = "u runs from the leading edge to the trailing one, v from the lower side up."',
        f"source = {quoted(name)}",
        'units = "mm"',
        "",
        "[parameters]",
        "chord = { default = 100, min = 0.001, max = 100_000 }",
        f"span = {{ default = {written(100 * length)}, min = 0.001, max = 1_000_000 }}",
        "",
        "[tables.profile]",
        'kind = "cubic"',
        "at = [",
        *_numbers(places),
        "]",
        "points = [",
        *table([(x, y, Fraction(0)) for x, y in points], 3),
        "]",
        "",
        "[let]",
        f'lower = "profile({written(places[ahead])} + {written(1 - places[ahead])}*u)"',
        f'upper = "profile({written(places[ahead])}*(1 - u))"',
        'S = "lower*(1 - v) + upper*v"',
        "",
        "[solid]",
        'x = "chord*S.x"',
        'y = "chord*S.y"',
        'z = "span*w"',
        "",
    ]
    return "\n".join(rows)


def read_lines_span(span: float | str) -> float:
    """Return the length of a wing in chords; raise FileNotReadableError for what is none."""
    source = Source("--span", ())
    length = float(source.number(0, str(span).strip(), "a length"))
    if not 0 < length <= 1e6:
        source.fail(0, "the length of a wing, in chords, is above 0")
    return length


def read_airfoil(file: str | os.PathLike[str]) -> list[Point]:
    """Return the points once round the section, from the trailing edge; FileNotReadableError."""
    source = read_lines(file)
    rows = list(_rows(source))
    if rows and min(rows[0][1]) >= COUNTS:
        rows = _lednicer(source, rows)
    if len(rows) < FEWEST:
        source.fail(0, f"a section has at least {FEWEST} points, and here are {len(rows)}")
    if len(rows) > MOST:
        source.fail(rows[MOST][0], f"a section has at most {MOST} points")
    for (_, before), (line, point) in pairwise(rows):
        if before == point:
            source.fail(line, "the point is the one before it")
    return [point for _, point in rows]


def _rows(source: Source) -> Iterator[tuple[int, Point]]:
    """Yield line and coordinates of what the file holds behind its title."""
    titled = False
    for line, text in enumerate(source.lines, 1):
        words = text.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        if not titled and not _is_point(words):
            titled = True
            continue
        titled = True
        if len(words) != 2:
            source.fail(line, "a point is two numbers, x and y")
        x, y = source.numbers(line, words)
        yield line, (x, y)


def _is_point(words: Sequence[str]) -> bool:
    from pc2cad.templates.importers.lines import NUMBER

    return len(words) == 2 and all(NUMBER.match(word) for word in words)


def _lednicer(source: Source, rows: list[tuple[int, Point]]) -> list[tuple[int, Point]]:
    """Return points of two sides, each from the leading edge, once round from the trailing one."""
    line, counts = rows[0]
    if any(count.denominator != 1 for count in counts):
        source.fail(line, "counts of points are whole numbers")
    upper, lower = (int(count) for count in counts)
    if upper + lower != len(rows) - 1:
        source.fail(
            line, f"{upper} and {lower} points are announced, and {len(rows) - 1} are there"
        )
    first, second = rows[1 : 1 + upper], rows[1 + upper :]
    if first[0][1] == second[0][1]:
        second = second[1:]  # the leading edge stands on both sides
    return [*first[::-1], *second]


def _places(points: Sequence[Point]) -> list[float]:
    """Return the chord length up to each point as a share of the whole, ascending."""
    total, lengths = 0.0, [0.0]
    for (x, y), (p, q) in pairwise(points):
        total += hypot(float(p - x), float(q - y))
        lengths.append(total)
    return [round(length / total, 12) for length in lengths]


def _numbers(values: Sequence[float]) -> Iterator[str]:
    for start in range(0, len(values), 8):
        yield "    " + ", ".join(written(x) for x in values[start : start + 8]) + ","
