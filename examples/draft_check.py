"""A check of one's own: can a moulded sleeve be drawn from its mould?

    python examples/draft_check.py

The half-axes of an elliptical sleeve grow by the slope k = tan 2° along its height, and its maker
takes that for the draft of its walls. It is that at the ends of the axes only: where the section
is a × b, the least draft round it is atan(k · 2√(ab)/(a + b)), geometric over arithmetic mean. The
check goes through the faces of a part's report, asks its mesh for their normals, and raises an
error of its own as pc2cad's checks do: what was found, where, and what would work.
"""

from __future__ import annotations

import math

import numpy as np

import pc2cad as pc

A, B, HEIGHT, WALL = 60, 20, 50, 3
SLOPE = math.tan(math.radians(2))

u, v, w = pc.parameters()


class TooLittleDraftError(ValueError):
    """A face is steeper than the mould allows."""


def sleeve():
    angle, outwards = 2 * pc.pi * u, SLOPE * HEIGHT * v + WALL * w
    return (A + outwards) * pc.cos(angle), (B + outwards) * pc.sin(angle), HEIGHT * v


def drafts(part, pull=(0, 0, 1), cells=(120, 60, 1)):
    """Return the least angle (degrees) of each face with the direction of pull, by its facets."""
    mesh = part.mesh(cells=cells)
    found = {}
    for face in part.report.faces:
        a, b, c, d = (mesh.points[row] for row in mesh.facet_nodes(face.name)["quad"].T)
        normals = np.cross(c - a, d - b)
        lift = np.abs(normals @ pull) / np.linalg.norm(normals, axis=1)
        found[face.name] = math.degrees(math.asin(lift.min()))
    return found


def check_draft(found, least):
    """Raise TooLittleDraftError for the steepest face if it has not the least draft (degrees)."""
    name = min(found, key=found.get)
    if found[name] < least:
        raise TooLittleDraftError(
            f"the face {name} has a draft of {found[name]:.3f}° somewhere, less than {least}°; "
            f"a slope of {SLOPE * least / found[name]:.4f} instead of {SLOPE:.4f} is enough"
        )


def main():
    found = drafts(pc.compile_part(sleeve(), tolerance=1e-4, name="sleeve"))
    check_draft(found, 1.5)
    complaint = ""
    try:
        check_draft(found, 2)
    except TooLittleDraftError as error:
        complaint = str(error)
    assert complaint.startswith("the face w=0 has a draft of 1.73"), complaint
    inner, outer = (
        math.degrees(math.atan(SLOPE * 2 * math.sqrt(a * b) / (a + b)))
        for a, b in ((A, B), (A + WALL, B + WALL))
    )
    return {
        "least draft inside": (found["w=0"], inner),
        "least draft outside": (found["w=1"], outer),
        "least draft of the ends": (min(found["v=0"], found["v=1"]), 90.0),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}°, exact {exact:.9g}°")
