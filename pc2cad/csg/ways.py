"""Ways to join bodies, in the order in which they are tried, until one gives a solid that holds.

    Bodies  ─compile→  a Body per equation
            ─reduce→   one equation for each difference that is proved to be one
            ─prepare→  seams and poles turned away from other bodies, or faces split there
            ─join→     so; then with all that closes cut in halves; then as they are
            ─hold→     sums of volumes, edges on both faces, no contact, and a STEP file that reads
                       back with the same volume
            ─fit→      once more, closer, where an edge is farther off its faces than strict checks
                       of other programs let pass

The kernel's Booleans, and readers of its files, go wrong where a curve crosses the seam of a face
that comes round to itself (`csg.seams`). Cut in halves such a face has no seam; the surfaces are
the same.
An edge along which faces only touch, or at which one ends, is as far off as these are from their
equations.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from pc2cad.brep.tolerance import KERNEL_TOLERANCE
from pc2cad.csg.arithmetic import Reduced, reduced
from pc2cad.csg.bodies import InvalidResultError, join_bodies, known_within
from pc2cad.csg.refusals import with_notes
from pc2cad.csg.seams import Prepared, prepared
from pc2cad.errors import KernelError, ToleranceNotReachedError, named
from pc2cad.part import Body, Part, part_of
from pc2cad.templates.bodies import Bodies
from pc2cad.validation import check_expectations

#: what another way may mend; what the bodies' places are to blame for is refused at once
_MENDED = (KernelError, ToleranceNotReachedError, InvalidResultError)
_Mended = KernelError | ToleranceNotReachedError | InvalidResultError
#: the ways, in order
CLEAR = "with seams and poles out of one another's way"
HALVED = "with the faces that close cut in halves"
AS_THEY_ARE = "as they are"


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
        joined = _fitted(bodies, _joined(bodies, made, halve, tell), fit, tell)
        part, taken = joined.part, joined.times
        report, words = joined.part.report, joined.words
        seams, warnings = joined.prepared.words, (*report.warnings, *words)
        part = replace(part, report=replace(report, seams=seams, warnings=warnings))
    part = replace(part, report=replace(part.report, times=times | taken))
    check_expectations(bodies.expectations, part.report)
    return part


@dataclass(frozen=True, eq=False)
class _Joined:
    """Bodies that are joined, from what, in how many seconds, and how that came about."""

    made: Reduced
    prepared: Prepared
    part: Part
    times: dict[str, float]
    words: tuple[str, ...] = ()


def _joined(
    bodies: Bodies, made: Reduced, halve: Callable[[Body], Body], tell: Callable[[str], None]
) -> _Joined:
    """Join the bodies in one way after the other until one holds.

    Raises what the first way did, with the reasons of all.
    """
    start, tried = time.perf_counter(), list[Mapping[str, Body]]()
    first: _Mended | None = None
    reasons: list[str] = []
    for way in (CLEAR, HALVED, AS_THEY_ARE):
        tell(way)
        try:
            ready = _ready(way, made, halve)
            if ready.parts in tried:
                continue
            tried.append(ready.parts)
            taken = time.perf_counter() - start
            now = replace(made, parts=ready.parts)
            part, times = join_bodies(bodies, now, tell)
        except _MENDED as error:
            reasons.append(f"{way}: {error}" if first else with_notes(error))
            first = first or error
            continue
        times["combine"] += taken
        words = (f"the bodies are joined {way}; {CLEAR}: {first}",) if first else ()
        return _Joined(now, ready, part, times, words)
    assert first is not None
    raise type(first)("; ".join(reasons)) from first


def _ready(way: str, made: Reduced, halve: Callable[[Body], Body]) -> Prepared:
    """Return the bodies as a way has them."""
    if way == CLEAR:
        return prepared(made.result, made.parts, halve)
    if way == HALVED:
        return Prepared({name: halve(body) for name, body in made.parts.items()})
    return Prepared(made.parts)


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
        turned = joined.prepared.turned
        closer = {name: turned(name, fit(parts[name], KERNEL_TOLERANCE)) for name in loose}
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
    return _Joined(made, joined.prepared, part, times, (*joined.words, why))


def _off(part: Part) -> float:
    """Return how far an edge between bodies is from its faces at most."""
    return max((edge.surface_distance for edge in part.report.curves), default=0.0)
