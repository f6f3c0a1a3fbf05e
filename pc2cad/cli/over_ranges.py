"""``pc2cad check --over``: for which values of parameters a solid keeps orientation and sides."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from pc2cad.cli.inputs import load_one, read_settings
from pc2cad.cli.output import Progress, one_line, say, table
from pc2cad.errors import InputError, named

if TYPE_CHECKING:
    from pc2cad.solidity.jacobian_proof.factors import Spans
    from pc2cad.solidity.over_ranges.boxes import RangeProof
    from pc2cad.topology.complex import BoundaryComplex

#: boxes that are listed
MOST_ROWS = 40


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--over``."""
    parser.add_argument(
        "--over", metavar="NAME=LOW:HIGH", action="append", default=[],
        help="tell instead for which values in these ranges the solid is proved to keep its "
        "orientation and its sides (repeatable; no solid is built)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Prove what can be proved over the ranges, and print it; exit code 0 whatever is open."""
    if arguments.triangles or arguments.densities:
        raise InputError("--over is answered without a solid: leave out --triangles and --density")
    template, _ = load_one(arguments)
    with Progress() as progress, named(arguments.template):
        progress.first("proving")
        from pc2cad.studies.over_ranges import prove_over

        proof = prove_over(template, _ranges(arguments.over), read_settings(arguments.settings))
    if arguments.json:
        say(json.dumps(proof.to_dict(), indent=2, allow_nan=False))
        return 0
    say(one_line(f"{template.name}: {template.title}"))
    for paragraph in _paragraphs(proof):
        say(paragraph)
    return 0


def _ranges(texts: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, sign, given = (part.strip() for part in text.partition("="))
        if not (name and sign and given):
            raise InputError(f"--over '{text[:80]}': write NAME=LOW:HIGH, for example p=0.2:0.8")
        if name in found:
            raise InputError(f"--over {name[:80]}: the parameter has two ranges")
        found[name] = given
    return found


def _paragraphs(proof: RangeProof) -> Iterator[str]:
    yield f"  {proof.sentence}"
    if proof.proved:
        yield "\nProved, for all values from … to …"
        yield _listed(
            [(*proof.names, "det J", "sides")],
            [
                (*_limits(box.spans), "> 0" if box.sign > 0 else "< 0", _sides(box.boundary))
                for box in proof.proved
            ],
        )
    if proof.open:
        yield "\nOpen: not proved, and not refuted"
        yield _listed([proof.names], [_limits(spans) for spans in proof.open])


def _listed(head: list[tuple[str, ...]], rows: list[tuple[str, ...]]) -> str:
    more = f"\n  and {len(rows) - MOST_ROWS} more" if len(rows) > MOST_ROWS else ""
    return table([*head, *rows[:MOST_ROWS]]) + more


def _limits(spans: Spans) -> tuple[str, ...]:
    """Return limits, as many digits as tell them, of each parameter."""
    from pc2cad.solidity.over_ranges.boxes import within

    rows = within(spans).values()
    return tuple(" … ".join(repr(x).removesuffix(".0") for x in row) for row in rows)


def _sides(boundary: BoundaryComplex | None) -> str:
    """Return what becomes of the six sides in words, where it is the same for all values."""
    if boundary is None:
        return "open"
    fates = [side.fate for side in boundary.sides]
    words = {"face": "bound", "interface": "coincide", "curve": "collapse", "point": "collapse"}
    counts = {word: sum(words[fate] == word for fate in fates) for word in words.values()}
    return ", ".join(f"{n} {word}" for word, n in counts.items() if n)
