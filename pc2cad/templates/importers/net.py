"""Nets of points (.csv) to templates: a solid through given points, or a plate on a surface."""

from __future__ import annotations

import os
from collections.abc import Iterator
from fractions import Fraction
from itertools import product
from typing import Final

from pc2cad.templates.importers.lines import (
    Source,
    named_after,
    quoted,
    read_lines,
    written,
)

#: points of a net, and places along one of its indices
MOST_POINTS: Final = 4000
MOST_PLACES: Final = 1000

Index = tuple[int, ...]
Point = tuple[Fraction, ...]


def import_points(file: str | os.PathLike[str]) -> str:
    """Return the text of a template of the solid through a net of points.

    Lines are ``i, j, k, x, y, z``: the indices are whole numbers, from 0 or 1 on, and u, v and w
    run along them. With ``i, j, x, y, z`` it is a plate on the surface through the points. Raises
    InputError, with the line where the file is no whole net.
    """
    source = read_lines(file)
    net = _read(source)
    first = next(iter(net))
    counts = [1 + max(index[d] for index in net) for d in range(len(first))]
    name = named_after(file)
    solid = len(counts) == 3
    size = max(float(max(p[d] for p in net.values()) - min(p[d] for p in net.values()))
               for d in range(3))  # fmt: skip
    lines = [
        f"title = {quoted(f'Solid through the points in {name}')}",
        f"source = {quoted(name)}",
        "",
    ]
    if not solid:
        lines += [
            "[parameters]",
            f'thickness = {{ default = {written(size / 50)}, about = "of the plate" }}',
            "",
        ]
    places = [", ".join(written(round(i / (n - 1), 15)) for i in range(n)) for n in counts]
    lines += [
        "[tables.net]",
        'kind = "cubic"',
        "at = [" + ", ".join(f"[{row}]" for row in places) + "]",
        f"points = {_nested(net, counts)}",
        "",
    ]
    if solid:
        lines += ["[solid]", 'M = "net(u, v, w)"', ""]
    else:
        lines += [
            "[let]",
            'S = "net(u, v)"',
            'N = "unit(cross(diff(S, u), diff(S, v)))"',
            "",
            "[solid]",
            'M = "S + N*thickness*w"',
            "",
        ]
    return "\n".join(lines)


def _read(source: Source) -> dict[Index, Point]:
    """Return points by their indices from 0; raise FileNotReadableError where the net has holes."""
    found: dict[Index, tuple[int, Point]] = {}
    width = 0
    for line, words in _rows(source):
        if not width:
            width = len(words)
            if width not in (5, 6):
                source.fail(line, "a line is i, j, x, y, z or i, j, k, x, y, z")
        if len(words) != width:
            source.fail(line, f"here are {len(words)} columns, and {width} before")
        numbers = source.numbers(line, words)
        index = numbers[: width - 3]
        if any(x.denominator != 1 or not 0 <= x <= MOST_PLACES for x in index):
            source.fail(line, f"an index is a whole number from 0 to {MOST_PLACES}")
        key = tuple(int(x) for x in index)
        if key in found:
            source.fail(line, f"the point {key} is given in line {found[key][0]} too")
        found[key] = line, tuple(numbers[width - 3 :])
        if len(found) > MOST_POINTS:
            source.fail(line, f"a net has at most {MOST_POINTS} points")
    if not found:
        source.fail(0, "no points: a line is i, j, x, y, z or i, j, k, x, y, z")
    lows = [min(key[d] for key in found) for d in range(width - 3)]
    highs = [max(key[d] for key in found) for d in range(width - 3)]
    if any(low > 1 or high - low < 1 for low, high in zip(lows, highs, strict=True)):
        source.fail(0, "indices begin at 0 or 1, and have two places at least")
    for key in product(*(range(a, b + 1) for a, b in zip(lows, highs, strict=True))):
        if key not in found:
            source.fail(0, f"the net has no point {key}")
    return {tuple(i - a for i, a in zip(key, lows, strict=True)): found[key][1] for key in found}


def _rows(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Yield line and columns of what is neither empty, a comment nor the heading."""
    headed = False
    for line, text in enumerate(source.lines, 1):
        words = [word.strip() for word in text.replace(";", ",").split(",")]
        if not any(words) or words[0].startswith("#"):
            continue
        if not headed and words[0].lower() in ("i", "u", '"i"'):
            headed = True
            continue
        headed = True
        yield line, words


def _nested(net: dict[Index, Point], counts: list[int], index: Index = ()) -> str:
    if len(index) == len(counts):
        return "[" + ", ".join(written(x) for x in net[index]) + "]"
    rows = (_nested(net, counts, (*index, i)) for i in range(counts[len(index)]))
    return "[" + (",\n" if len(index) + 1 < len(counts) else ", ").join(rows) + "]"
