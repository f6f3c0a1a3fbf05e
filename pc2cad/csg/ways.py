"""Ways to join bodies, in the order in which they are tried, until one gives a solid that holds.

    Bodies  ─compile→  a Body per equation
            ─reduce→   one equation for each difference that is proved to be one
            ─join→     as they are; then with what closes cut in halves
            ─hold→     sums of volumes, edges on both faces, no contact, and a STEP file that reads
                       back with the same volume

The kernel's Booleans, and readers of its files, go wrong where a curve crosses the seam of a face
that comes round to itself. Cut in halves such a face has no seam; the surfaces are the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from pc2cad.csg.arithmetic import Reduced, reduced
from pc2cad.csg.bodies import InvalidResultError, join_bodies
from pc2cad.errors import KernelError, ToleranceNotReachedError, named
from pc2cad.part import Body, Part, part_of
from pc2cad.templates.bodies import Bodies
from pc2cad.validation import check_expectations

#: what another way may mend; what the bodies' places are to blame for is refused at once
_MENDED = (KernelError, ToleranceNotReachedError, InvalidResultError)
HALVED = "with the faces that close cut in halves"


def compile_bodies(
    bodies: Bodies,
    compile_body: Callable[..., Body],
    halve: Callable[[Body], Body],
    progress: Callable[[str], None] | None = None,
) -> Part:
    """Compile every body and join them; see `compiler.compile_equation` for what is raised.

    `compile_body` turns an equation, and a progress to tell, into a body; `halve` returns it with
    what closes cut in halves, or as it is. Raises EmptyResultError and SeveralPiecesError besides.
    """
    tell = progress or (lambda stage: None)
    start, parts = time.perf_counter(), {}
    for name, equation in bodies.equations.items():
        with named(f"body {name}"):
            parts[name] = compile_body(equation, lambda stage, name=name: tell(f"{name}: {stage}"))
    times = {"bodies": time.perf_counter() - start}
    start = time.perf_counter()
    made = reduced(bodies, parts, lambda equation: compile_body(equation, tell))
    times["arithmetic"] = time.perf_counter() - start
    taken: dict[str, float] = {}
    if isinstance(made.result, str):
        (step,) = made.steps[-1:]
        part = part_of(made.parts[made.result])
        part = replace(part, report=replace(part.report, arithmetic=(step.sentence,)))
    else:
        try:
            part, taken = join_bodies(bodies, made, tell)
        except _MENDED as error:
            part, taken = _in_halves(bodies, made, halve, tell, error)
    part = replace(part, report=replace(part.report, times=times | taken))
    check_expectations(bodies.expectations, part.report)
    return part


def _in_halves(
    bodies: Bodies,
    made: Reduced,
    halve: Callable[[Body], Body],
    tell: Callable[[str], None],
    why: KernelError | ToleranceNotReachedError | InvalidResultError,
) -> tuple[Part, dict[str, float]]:
    """Join the bodies with what closes cut in halves; raise `why`, with both reasons."""
    start = time.perf_counter()
    tell("cut in halves")
    try:
        halves = {name: halve(body) for name, body in made.parts.items()}
        if all(halves[name] is body for name, body in made.parts.items()):
            raise why
        cut = time.perf_counter() - start
        part, times = join_bodies(bodies, replace(made, parts=halves), tell)
    except _MENDED as error:
        if error is why:
            raise
        raise type(why)(f"{why}; {HALVED}: {error}") from error
    warnings = (*part.report.warnings, f"the bodies are joined {HALVED}; as they are: {why}")
    times["combine"] += cut
    return replace(part, report=replace(part.report, warnings=warnings)), times
