"""Whether faces are one closed, oriented shell: what ``BRepCheck_Shell`` asks of one of a solid."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def is_closed(count: int, uses: Iterable[Sequence[tuple[int, int]]]) -> bool:
    """Return whether so many faces hang together, and each edge is used twice, once either way.

    `uses` has for each edge the numbers of the faces that it bounds, and 1 or -1: how it is walked.
    """
    group = list(range(count))
    for sides in uses:
        if sorted([way for _, way in sides]) != [-1, 1]:
            return False
        one, other = (_first(group, face) for face, _ in sides)
        group[max(one, other)] = min(one, other)
    return all(_first(group, face) == 0 for face in range(count))


def _first(group: list[int], face: int) -> int:
    """Return the first of the faces that a face hangs together with, as far as it is known."""
    while group[face] != face:
        group[face] = face = group[group[face]]
    return face
