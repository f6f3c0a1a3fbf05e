"""Random valid variants of all templates in one process: ``benchmarks/soak.py --count 2000``.

Memory must stay flat: under 5 % growth after the first tenth, of the resident pages and of what is
allocated (a handle of the kernel that nobody releases stays allocated). Every result must be that
of a fresh process, bit for bit in the figures and in the STEP file; a sample of them is built
again. Ends early, and says so, when ``--minutes`` are over.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import hashlib
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from pc2cad.compiler import compile_equation
from pc2cad.errors import PointCadError
from pc2cad.export.model import ExportOptions
from pc2cad.export.step import encode
from pc2cad.expression.scalar import evaluate
from pc2cad.studies.variant import figures_of
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths
from pc2cad.templates.template import Template


class _Allocated(ctypes.Structure):
    """What glibc's ``mallinfo2`` returns."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks",
                     "uordblks", "fordblks", "keepcost")
    )  # fmt: skip


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
    """Return the figures of one variant and the hash of its STEP file."""
    part = compile_equation(read_template(template_paths()[name]).bind(given))
    step = encode(part.exportable(), ExportOptions())
    return {**figures_of(part.report), "step": hashlib.sha256(step).hexdigest()}


def memory() -> tuple[float, float]:
    """Return the resident and the allocated memory in MiB (Linux with glibc)."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = _Allocated
    told = ask()
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20, (told.uordblks + told.hblkhd) / 2**20


def variants(dice: random.Random) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield variants of all templates in turn, without end."""
    templates = {name: read_template(path) for name, path in template_paths().items()}
    while True:
        for name, template in templates.items():
            yield name, values(template, dice)


def main() -> None:
    """Run the soak, or with --one a single variant whose figures are printed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--again", type=int, default=10, help="variants built in fresh processes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--one", nargs=2, metavar=("NAME", "VALUES"))
    arguments = parser.parse_args()
    os.environ.setdefault("SOURCE_DATE_EPOCH", "1700000000")
    if arguments.one:
        print(json.dumps(build(arguments.one[0], json.loads(arguments.one[1]))))
        return
    dice = random.Random(arguments.seed)
    end = time.monotonic() + 60 * arguments.minutes
    again = set(dice.sample(range(arguments.count), min(arguments.again, arguments.count)))
    sample: list[tuple[str, dict[str, float], dict[str, object]]] = []
    built, refused = 0, 0
    early: tuple[float, float] | None = None
    print("| built | resident | allocated | growth |\n|---|---|---|---|", flush=True)
    for name, given in variants(dice):
        if built == arguments.count or time.monotonic() > end:
            break
        try:
            figures = build(name, given)
        except PointCadError as error:
            refused += 1
            print(f"{name} {given}: {error}", file=sys.stderr, flush=True)
            continue
        if built in again:
            sample.append((name, given, figures))
        built += 1
        if built % max(1, arguments.count // 10) == 0:
            now = memory()
            early = early or now
            growth = ", ".join(
                f"{100 * (b / a - 1):+.1f} %" for a, b in zip(early, now, strict=True)
            )
            print(f"| {built} | {now[0]:.1f} MiB | {now[1]:.1f} MiB | {growth} |", flush=True)
    print(f"\nbuilt {built} of {arguments.count}, {refused} draws refused")
    same = 0
    for name, given, figures in sample:
        fresh = subprocess.run(
            [sys.executable, __file__, "--one", name, json.dumps(given)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        equal = json.loads(fresh.stdout) == json.loads(json.dumps(figures))
        same += equal
        if not equal:
            print(f"{name} {given}: differs in a fresh process")
    print(
        f"{same} of {len(sample)} built again in fresh processes: the same figures, the same STEP"
    )


if __name__ == "__main__":
    main()
