"""Ways to join bodies, in the order in which they are tried, until one gives a solid that holds.

    Bodies  ─compile→  a Body per equation
            ─reduce→   one equation for each difference that is proved to be one
            ─join→     as they are; then with what closes cut in halves
            ─hold→     sums of volumes, edges on both faces, no contact, and a STEP file that reads
                       back with the same volume
            ─fit→      once more, closer, where an edge is farther off its faces than strict checks
                       of other programs let pass

The kernel's Booleans, and readers of its files, go wrong where a curve crosses the seam of a face
that comes round to itself. Cut in halves such a face has no seam; the surfaces are the same.
An edge along which faces only touch, or at which one ends, is as far off as these are from their
equations.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from pc2cad.brep.build import KERNEL_TOLERANCE
from pc2cad.csg.arithmetic import Reduced, reduced
from pc2cad.csg.bodies import InvalidResultError, join_bodies, known_within
from pc2cad.csg.refusals import with_notes
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
    fit: Callable[[Body, float], Body],
    progress: Callable[[str], None] | None = None,
) -> Part:
    """Compile every body and join them; see `compiler.compile_equation` for what is raised.

    `compile_body` turns an equation, and a progress to tell, into a body; `halve` returns it with
    what closes cut in halves, or as it is, and `fit` within a tolerance. Raises EmptyResultError
    and SeveralPiecesError besides.
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
            joined = _Joined(made, *join_bodies(bodies, made, tell))
        except _MENDED as error:
            joined = _in_halves(bodies, made, halve, tell, error)
        joined = _fitted(bodies, joined, fit, tell)
        part, taken = joined.part, joined.times
        warnings = (*part.report.warnings, *joined.words)
        part = replace(part, report=replace(part.report, warnings=warnings))
    part = replace(part, report=replace(part.report, times=times | taken))
    check_expectations(bodies.expectations, part.report)
    return part


@dataclass(frozen=True, eq=False)
class _Joined:
    """Bodies that are joined, from what, in how many seconds, and how that came about."""

    made: Reduced
    part: Part
    times: dict[str, float]
    words: tuple[str, ...] = ()


def _in_halves(
    bodies: Bodies,
    made: Reduced,
    halve: Callable[[Body], Body],
    tell: Callable[[str], None],
    why: KernelError | ToleranceNotReachedError | InvalidResultError,
) -> _Joined:
    """Join the bodies with what closes cut in halves; raise `why`, with both reasons."""
    start = time.perf_counter()
    tell("cut in halves")
    try:
        halves = {name: halve(body) for name, body in made.parts.items()}
        if all(halves[name] is body for name, body in made.parts.items()):
            raise why
        cut = time.perf_counter() - start
        made = replace(made, parts=halves)
        part, times = join_bodies(bodies, made, tell)
    except _MENDED as error:
        if error is why:
            raise type(why)(with_notes(why)) from why
        raise type(why)(f"{with_notes(why)}; {HALVED}: {error}") from error
    times["combine"] += cut
    return _Joined(made, part, times, (f"the bodies are joined {HALVED}; as they are: {why}",))


def _fitted(
    bodies: Bodies,
    joined: _Joined,
    fit: Callable[[Body, float], Body],
    tell: Callable[[str], None],
) -> _Joined:
    """Join bodies fitted within the kernel's tolerance, if an edge is farther off its faces.

    What is joined already is returned where that fails, or brings no edge nearer.
    """
    parts, off = joined.made.parts, _off(joined.part)
    loose = [name for name, body in parts.items() if known_within(body) > KERNEL_TOLERANCE]
    if off <= KERNEL_TOLERANCE or not loose:
        return joined
    start = time.perf_counter()
    tell("fitted closer")
    try:
        closer = {name: fit(parts[name], KERNEL_TOLERANCE) for name in loose}
        made = replace(joined.made, parts={**parts, **closer})
        part, times = join_bodies(bodies, made, tell)
    except _MENDED:
        return joined
    if _off(part) >= off:
        return joined
    times = joined.times | {"fitted closer": time.perf_counter() - start}
    why = (
        f"the bodies are joined with {', '.join(loose)} within {KERNEL_TOLERANCE:g} {bodies.units} "
        f"of the equation; as asked, an edge is {off:.2g} off its faces"
    )
    return _Joined(made, part, times, (*joined.words, why))


def _off(part: Part) -> float:
    """Return how far an edge between bodies is from its faces at most."""
    return max((edge.surface_distance for edge in part.report.curves), default=0.0)
