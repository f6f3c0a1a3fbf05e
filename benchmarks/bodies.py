"""Templates of several bodies beside the kernel's own Booleans: ``python -m benchmarks.bodies``.

Each shipped template is compiled, then the same solids are joined by plain CadQuery (``fuse``,
``cut``, ``intersect``; copies of a pattern in one operation). Times are CPU seconds of one run.
Volumes are by one rule, pc2cad's own, so that plain CadQuery's shape is measured and not its rule.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import cadquery as cq

import pc2cad as pc
from pc2cad.brep.booleans import NamedShape, moved
from pc2cad.brep.integrals import solid_integrals
from pc2cad.compiler import compile_solid
from pc2cad.csg.arithmetic import Reduced
from pc2cad.csg.bodies import join_bodies
from pc2cad.errors import KernelError
from pc2cad.part import Body
from pc2cad.templates.bodies import Bodies, Pattern, Tree
from pc2cad.templates.shipped import bodies_paths


@dataclass(frozen=True)
class Row:
    """What one template took (CPU seconds), and by how much plain CadQuery's volume is off."""

    name: str
    bodies: int
    faces: int
    compiled: float
    joined: float
    plain: float
    off: float | None

    @property
    def text(self) -> str:
        """A line of the table."""
        off = "edges too far off to integrate" if self.off is None else f"{self.off:.0e}"
        return (
            f"| `{self.name}` | {self.bodies} | {self.faces} | {self.compiled:.1f} | "
            f"{self.joined:.1f} | {self.plain:.2f} | {self.joined / self.plain:.0f} | {off} |"
        )


def plain(tree: Tree, bodies: Mapping[str, Body]) -> cq.Shape:
    """Return what CadQuery makes of the bodies' solids."""
    if isinstance(tree, str):
        return cq.Shape.cast(bodies[tree].shape)
    if isinstance(tree, Pattern):
        one = NamedShape(plain(tree.operand, bodies).wrapped, ())
        copies = [cq.Shape.cast(moved(one, p.turn, p.offset, "").shape) for p in tree.copies]
        return copies[0].fuse(*copies[1:]) if len(copies) > 1 else copies[0]
    first, *others = (plain(operand, bodies) for operand in tree.operands)
    joined = {"union": first.fuse, "intersect": first.intersect}.get(tree.kind, first.cut)
    return joined(*others)


def measured(name: str) -> Row:
    """Compile a template, and join its bodies both ways."""
    template = pc.read_template(bodies_paths()[name]).bind()
    assert isinstance(template, Bodies)
    marks = [time.process_time()]
    bodies = {key: compile_solid(equation).body for key, equation in template.equations.items()}
    marks.append(time.process_time())
    part, _ = join_bodies(template, Reduced(template.result, bodies), lambda stage: None)
    marks.append(time.process_time())
    shape = plain(template.result, bodies)
    marks.append(time.process_time())
    off: float | None = None
    with suppress(KernelError):
        off = abs(solid_integrals(shape.wrapped).volume / part.volume - 1)
    compiled, joined, taken = (b - a for a, b in pairwise(marks))
    return Row(name, len(bodies), len(part.report.faces), compiled, joined, taken, off)


def main() -> None:
    """Print a table."""
    argparse.ArgumentParser(prog="benchmarks.bodies", description=__doc__).parse_args()
    print(
        "| template | bodies | faces | bodies compiled (s) | joined, checked, written and read back"
        " (s) | CadQuery joins (s) | ratio | CadQuery's volume off by |"
    )
    print("|---|---|---|---|---|---|---|---|")
    compile_solid(pc.read_template("ball").bind())  # imports are nobody's
    for name in bodies_paths():
        print(measured(name).text, flush=True)


if __name__ == "__main__":
    main()
