"""One wrong thing put into the text of a STEP file."""

from __future__ import annotations

import re
from pathlib import Path


def read_instances(path: Path) -> str:
    """Return the text of a file without line breaks."""
    return re.sub(r"\s*\n\s*", "", path.read_text())


def instance(text: str, keyword: str, number: int = 0) -> re.Match[str]:
    """The given occurrence of an instance: reference, keyword, parameters."""
    return list(re.finditer(rf"(#\d+) = ({keyword})\((.*?)\);", text))[number]


def edit(text: str, found: re.Match[str], old: str, new: str) -> str:
    """Replace the last occurrence of old in one instance."""
    head, middle, tail = found.group(0).rpartition(old)
    assert middle
    return text.replace(found.group(0), head + new + tail, 1)


def move(text: str, ref: str, by: float = 0.01, axis: int = 0) -> str:
    """Move one point along x, y or z."""
    found = re.search(rf"{ref} = CARTESIAN_POINT\('',\((.*?)\)\);", text)
    assert found
    place = found.group(1).split(",")
    place[axis] = f"{float(place[axis]) + by:.13E}"
    start, end = found.span(1)
    return text[:start] + ",".join(place) + text[end:]


def pole(text: str, row: int, column: int) -> str:
    """The reference of a pole of the first B-spline surface, a rational one if it is the first."""
    found = re.search(r"B_SPLINE_SURFACE(?:_WITH_KNOTS)?\((.*?)\);", text)
    assert found
    net = re.findall(r"\((#[#\d,]*)\)", found.group(1))
    return net[row].split(",")[column]


def without_face(text: str) -> str:
    found = instance(text, "CLOSED_SHELL")
    return edit(text, found, "," + found.group(3).rstrip(")").split(",")[-1] + ")", ")")
