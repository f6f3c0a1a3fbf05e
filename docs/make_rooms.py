"""Write the rooms into docs/: the table of docs/design.md and its figure.

Usage: ``python docs/make_rooms.py``.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from rooms import FREE, LAYERS, OUTSIDE, floors, table  # noqa: E402

PAGE = HERE / "design.md"
FIGURE = HERE / "pictures" / "rooms.svg"
#: the data's way, from an equation to files
WAY = (
    ("equation", "domain"), ("domain", "solidity"), ("solidity", "integrals"),
    ("integrals", "checked"), ("checked", "representation"), ("representation", "brep"),
    ("brep", "validation"), ("validation", "part"), ("part", "export"),
    ("checked", "mesh"), ("checked", "sampling"), ("mesh", "export"), ("part", "csg"),
    ("templates", "equation"), ("api", "equation"),
)  # fmt: skip
WIDTH, HEIGHT, GAP = 128, 34, 22


def figure() -> str:
    """Return the figure: rooms by floor, a room above all that it imports, and the data's way."""
    rows: dict[int, list[str]] = {}
    for room, floor in floors().items():
        if room in (*LAYERS, *OUTSIDE) and room not in FREE:
            rows.setdefault(floor, []).append(room)
    width = max(len(rooms) for rooms in rows.values()) * (WIDTH + GAP) + GAP
    top = max(rows)
    place = {}
    for floor, rooms in rows.items():
        start = (width - len(rooms) * (WIDTH + GAP) + GAP) / 2
        for i, room in enumerate(sorted(rooms)):
            place[room] = (start + i * (WIDTH + GAP), GAP + (top - floor) * (HEIGHT + GAP))
    height = GAP + (top - min(rows) + 1) * (HEIGHT + GAP)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        'font-family="sans-serif" font-size="13">',
        '<defs><marker id="end" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="#c2410c"/></marker>'
        "</defs>",
        f'<rect width="{width:g}" height="{height:g}" fill="white"/>',
    ]
    for x, y in place.values():
        lines.append(
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5" '
            'fill="#eef2f7" stroke="#64748b"/>'
        )
    lines += [_arrow(place[a], place[b]) for a, b in WAY]
    for room, (x, y) in place.items():
        lines.append(
            f'<text x="{x + WIDTH / 2:g}" y="{y + HEIGHT / 2 + 5:g}" text-anchor="middle">'
            f"{room}</text>"
        )
    return "\n".join([*lines, "</svg>"]) + "\n"


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    """Return an arrow between the edges of two boxes that face each other."""
    (ax, ay), (bx, by) = start, end
    if ay == by:
        right = bx > ax
        a = (ax + (WIDTH if right else 0), ay + HEIGHT / 2)
        b = (bx + (0 if right else WIDTH), by + HEIGHT / 2)
    else:
        up = by < ay
        a = (ax + WIDTH / 2, ay + (0 if up else HEIGHT))
        b = (bx + WIDTH / 2, by + (HEIGHT if up else 0))
    return (
        f'<path d="M{a[0]:g},{a[1]:g} L{b[0]:g},{b[1]:g}" fill="none" stroke="#c2410c" '
        'stroke-width="1.6" opacity="0.8" marker-end="url(#end)"/>'
    )


def page(text: str) -> str:
    """Return the page with the table made anew; ValueError where it has none."""
    written, count = re.subn(
        r"^\| room \|.*?(?=\n\n)", lambda _: table(), text, count=1, flags=re.M | re.S
    )
    if not count:
        raise ValueError("docs/design.md has no table that begins with '| room |'")
    return written


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    FIGURE.write_text(figure(), encoding="utf-8")
