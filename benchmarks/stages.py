"""Time of analysis and validation against the time of building and writing, per template.

    python benchmarks/stages.py [TEMPLATE …] [--repeat N]

Prints CPU milliseconds, the best of N runs after one that warms up (each finds again what the one
before worked out of the same equation), and the quotient of what checks
(sample, orient, analyse, integrate, solidity, embed, validate) to what makes (represent, build,
write as STEP).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from pc2cad.compiler import compile_equation
from pc2cad.equation.point_equation import PointEquation
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths

CHECKS = ("sample", "orient", "analyse", "integrate", "solidity", "embed", "validate")
MAKES = ("represent", "build", "write")


def stages(equation: PointEquation, path: Path) -> dict[str, float]:
    """Return CPU seconds per stage of one compilation and one STEP file."""
    marks: list[tuple[str, float]] = []

    def mark(name: str) -> None:
        marks.append((name, time.process_time()))

    part = compile_equation(equation, progress=mark)
    mark("write")
    part.write(path)
    mark("")
    return {name: end - start for (name, start), (_, end) in pairwise(marks)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("templates", nargs="*")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    names = options.templates or sorted(template_paths())
    print(f"{'CPU ms':20}", *(f"{name:>10}" for name in (*CHECKS, *MAKES)), "    checks/makes")
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            equation = read_template(template_paths()[name]).bind()
            path = Path(folder) / "part.step"
            stages(equation, path)
            runs = [stages(equation, path) for _ in range(options.repeat)]
            best = {stage: min(run[stage] for run in runs) for stage in runs[0]}
            shown = (f"{1e3 * best[stage]:10.1f}" for stage in (*CHECKS, *MAKES))
            quotient = sum(best[s] for s in CHECKS) / sum(best[s] for s in MAKES)
            print(f"{name:20}", *shown, f"{quotient:16.2f}", flush=True)


if __name__ == "__main__":
    main()
