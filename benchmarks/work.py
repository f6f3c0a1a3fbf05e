"""Count work that does not depend on the machine, and say what grew since the table was kept.

    python -m benchmarks.work           compare with work.json: 1 where something grew by a tenth
    python -m benchmarks.work --keep    write the table anew

Of ten templates: calls of Python functions under a deterministic profiler, calls of the equation,
cells of the proof that nothing is covered twice, poles of all faces, bytes of the STEP file. One
process with one hash seed, after a part that loads what all need.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import sys
import tempfile
from math import prod
from pathlib import Path

TABLE = Path(__file__).with_name("work.json")
TEMPLATES = (
    "pyramid_cut", "bilinear_top", "hollow_ball", "turned_ring", "helical_channel",
    "channel_ellipse", "channel_contour", "dished_end", "naca_wing", "simplex_torus",
)  # fmt: skip
#: growth that is told
MOST = 0.10
#: counts below which a tenth is nothing
SMALL = {"calls": 1000, "equation": 20, "cells": 20, "poles": 4, "bytes": 500}


def work(name: str, folder: Path) -> dict[str, int]:
    """Return what one template takes, from its text to its STEP file."""
    import pc2cad as pc
    from pc2cad.templates.shipped import template_paths

    path = folder / f"{name}.step"
    profile = cProfile.Profile(builtins=False)
    profile.enable()
    part = pc.compile_equation(pc.read_template(template_paths()[name]).bind())
    part.write(path)
    profile.disable()
    entries = [entry for entry in profile.getstats() if not isinstance(entry.code, str)]
    return {
        "calls": sum(entry.callcount for entry in entries),
        "equation": sum(
            entry.callcount
            for entry in entries
            if entry.code.co_filename.endswith("expression/evaluation.py")
            and entry.code.co_name == "__call__"
        ),
        "cells": part.report.one.overlap_cells,
        "poles": sum(prod(face.poles) for face in part.report.faces if face.poles),
        "bytes": path.stat().st_size,
    }


def grown(kept: dict[str, dict[str, int]], found: dict[str, dict[str, int]]) -> list[str]:
    """Return a line for every count that grew by more than a tenth, or that is not kept."""
    lines = []
    for name, counts in found.items():
        for what, count in counts.items():
            before = kept.get(name, {}).get(what)
            if before is None:
                lines.append(f"{name}: {what} {count}, and none is kept")
            elif count > before * (1 + MOST) and count - before > SMALL[what]:
                lines.append(f"{name}: {what} {before} -> {count} ({count / before - 1:+.0%})")
    return lines


def main() -> int:
    """Count, and compare or keep."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--keep", action="store_true", help="write the table anew")
    options = parser.parse_args()
    if os.environ.get("PYTHONHASHSEED") != "0":
        os.environ["PYTHONHASHSEED"] = "0"
        os.execv(sys.executable, [sys.executable, "-m", "benchmarks.work", *sys.argv[1:]])
    with tempfile.TemporaryDirectory() as folder:
        work("pyramid", Path(folder))
        found = {name: work(name, Path(folder)) for name in TEMPLATES}
    if options.keep:
        TABLE.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    lines = grown(json.loads(TABLE.read_text()), found)
    print("\n".join(lines or ["no count grew by a tenth"]))
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
