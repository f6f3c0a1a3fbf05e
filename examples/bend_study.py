"""A study: how tight a pipe may be bent, and what its elbow weighs.

    python examples/bend_study.py

Variants are built in processes of their own, and what goes wrong in one harms no other. An elbow
whose bend is not wider than the pipe is no solid, and its row in the table says why. The others
have the volume that Pappus knows: the section's area times the way of its centre.
"""

from __future__ import annotations

import math
import tempfile

import pc2cad as pc

RADIUS, WALL, TURN = 0.5, 0.25, 0.25
BENDS = (0.25, 0.5, 0.7, 0.8, 1.0, 2.0, 4.0)


def main():
    with tempfile.TemporaryDirectory() as folder:
        result = pc.study(
            "elbow_pipe", folder, formats=(), workers=1,
            vary={"R": BENDS}, fixed={"r": RADIUS, "wall": WALL, "turn": TURN},
        )  # fmt: skip
    built = {row["R"]: row for row in result.rows if row["status"] == "built"}
    refused = {row["R"]: row["reason"] for row in result.rows if row["R"] not in built}
    assert all(refused.values())
    section = math.pi * WALL * (2 * RADIUS + WALL)
    return {
        "variants that are no solid": (len(refused), sum(R <= RADIUS + WALL for R in BENDS)),
        "tightest bend": (min(built), 0.8),
        **{
            f"volume for R = {R}": (row["volume"], section * 2 * math.pi * TURN * R)
            for R, row in built.items()
        },
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
