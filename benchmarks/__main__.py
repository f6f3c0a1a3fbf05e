"""Measure pc2cad against what users would take instead, and print tables (Markdown).

    python -m benchmarks                      everything, about ten minutes
    python -m benchmarks --quick              fewer settings, smaller sizes: about two minutes
    python -m benchmarks --only solids        one part: faces, solids, poles, tolerances, turns,
                                              triangles
    python -m benchmarks --build123d PYTHON   the interpreter of an environment with build123d
    python -m benchmarks --output FILE        the tables into a file as well

All routes run in this one process, on one core, after imports; only build123d, whose kernel
bindings exclude CadQuery's, runs in its own, and only it is timed there.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

PARTS = ("faces", "solids", "poles", "tolerances", "turns", "triangles")


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", choices=PARTS, action="append")
    parser.add_argument("--build123d", metavar="PYTHON")
    parser.add_argument("--output", metavar="FILE", type=Path)
    options = parser.parse_args()
    wanted = options.only or PARTS
    lines: list[str] = []

    def put(text: str) -> None:
        print(text, flush=True)
        lines.append(text)

    def table(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
        put(f"\n### {title}\n")
        put(f"| {' | '.join(head)} |")
        put("|" + "---|" * len(head))
        for row in rows:
            put(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |")

    from benchmarks import compare, growth, triangles
    from benchmarks.channels import CHANNELS

    _silence()
    for channel in CHANNELS:
        channel.check()
    put(f"Machine: {machine()}")
    if "faces" in wanted:
        table("The outer wall", compare.FACE_HEAD,
              compare.faces(CHANNELS, options.build123d, options.quick))  # fmt: skip
    if "solids" in wanted:
        chosen = CHANNELS[2:] if options.quick else CHANNELS
        table("Whole solids at equal deviation", compare.SOLID_HEAD,
              compare.solids(chosen, options.quick))  # fmt: skip
    if "turns" in wanted:
        table("Growth with the turns of a helix", growth.TURNS_HEAD,
              growth.turns(10 if options.quick else 100))  # fmt: skip
    if "tolerances" in wanted:
        table("Growth with the tolerance", growth.TOLERANCE_HEAD,
              growth.tolerances(8 if options.quick else 10))  # fmt: skip
    if "poles" in wanted:
        table("Growth with poles", growth.POLES_HEAD,
              growth.poles(1e4 if options.quick else 1e6))  # fmt: skip
    if "triangles" in wanted:
        table("Triangles of one channel", triangles.HEAD, triangles.triangles(options.quick))
    if options.output is not None:
        options.output.write_text("\n".join(lines) + "\n")


def machine() -> str:
    """Return what the figures depend on, without names."""
    packages = ("cadquery", "cadquery-ocp", "numpy", "scipy")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    return (
        f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}, "
        f"Python {platform.python_version()}, {versions}; CPU seconds on one core"
    )


def _silence() -> None:
    """Keep the kernel's statistics of STEP files off the tables."""
    from OCP.Message import Message

    Message.DefaultMessenger_s().ChangePrinters().Clear()


if __name__ == "__main__":
    main()
