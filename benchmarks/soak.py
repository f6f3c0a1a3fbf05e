"""Random valid variants of all templates in one process (``benchmarks/soak.py --count 2000``).

Memory must stay flat (under 5 % growth after the first tenth) and every result must be that of a
fresh process, bit for bit in the figures; a sample of them is built again to see.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
from pathlib import Path

from pc2cad.compiler import compile_equation
from pc2cad.equation.scalar import evaluate
from pc2cad.equation.template import Template
from pc2cad.equation.template_file import read_template
from pc2cad.errors import PointCadError
from pc2cad.export.model import ExportOptions
from pc2cad.export.step import encode
from pc2cad.library import template_paths
from pc2cad.studies.variant import figures_of


def values(template: Template, dice: random.Random) -> dict[str, float]:
    """Return parameter values near the defaults, within their ranges; whole ones stay whole."""
    chosen = {}
    for parameter in template.parameters:
        default = evaluate(parameter.default, {})
        if default == round(default):
            continue
        value = default * dice.uniform(0.9, 1.1)
        low = evaluate(parameter.minimum, {}) if parameter.minimum is not None else value
        high = evaluate(parameter.maximum, {}) if parameter.maximum is not None else value
        chosen[parameter.name] = min(max(value, low), high)
    return chosen


def build(name: str, given: dict[str, float]) -> dict[str, object]:
    """Return the figures of one variant, written to STEP in memory."""
    part = compile_equation(read_template(template_paths()[name]).bind(given))
    size = len(encode(part.exportable(), ExportOptions()))
    return {**figures_of(part.report), "bytes": size}


def memory() -> float:
    """Return the resident memory in MiB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Run the soak, or with --one a single variant whose figures are printed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--again", type=int, default=10, help="variants built in fresh processes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--one", nargs=2, metavar=("NAME", "VALUES"))
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(build(arguments.one[0], json.loads(arguments.one[1]))))
        return
    dice = random.Random(arguments.seed)
    names = list(template_paths())
    templates = {name: read_template(path) for name, path in template_paths().items()}
    early, refused, sample = 0.0, 0, []
    for i in range(arguments.count):
        name = names[i % len(names)]
        given = values(templates[name], dice)
        try:
            figures = build(name, given)
        except PointCadError as error:
            refused += 1
            print(f"{name} {given}: {error}")
            continue
        sample.append((name, given, figures))
        if i == arguments.count // 10:
            early = memory()
            print(f"{i} built, {early:.0f} MiB")
    late = memory()
    print(f"{arguments.count - refused} built, {refused} refused, {late:.0f} MiB "
          f"({100 * (late / early - 1):+.1f} %)")  # fmt: skip
    for name, given, figures in dice.sample(sample, min(arguments.again, len(sample))):
        fresh = subprocess.run(
            [sys.executable, __file__, "--one", name, json.dumps(given)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        same = json.loads(fresh.stdout) == json.loads(json.dumps(figures))
        print(f"{name}: {'the same as' if same else 'NOT the same as'} in a fresh process")


if __name__ == "__main__":
    main()
