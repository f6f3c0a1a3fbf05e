"""How time and memory grow: with poles, with the tolerance, with the turns of a helix."""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pc2cad.brep.build import build
from pc2cad.brep.integrals import solid_integrals
from pc2cad.checked import check_map
from pc2cad.compiler import compile_equation
from pc2cad.domain.analysis import analyse
from pc2cad.errors import PointCadError
from pc2cad.options import CompileOptions
from pc2cad.representation.boundary import represent
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import find_template

Row = tuple[str, ...]


def _equation(name: str, **values: str):
    return read_template(find_template(name)).bind(values)


def _memory() -> float:
    """Return the largest resident memory so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


POLES_HEAD: Row = (
    "poles", "tolerance", "represent s", "build s", "integrals s", "STEP s", "STEP MB", "peak MB"
)  # fmt: skip


def poles(most: float) -> Iterator[Row]:
    """Yield rows for the elliptic channel in splines of degree 2, from 10³ to `most` poles.

    Degree 2 is of no use but for this: it needs many poles.
    """
    equation = _equation("channel_ellipse")
    checked = check_map(equation)
    target = 3e-2
    count = 0
    while count < most:
        start = time.process_time()
        model = represent(checked, CompileOptions(target, degree=2))
        times = [time.process_time() - start]
        start = time.process_time()
        built = build(model)
        times.append(time.process_time() - start)
        start = time.process_time()
        solid_integrals(built.solid)
        times.append(time.process_time() - start)
        count = sum(
            f.carrier.poles[..., 0].size for f in model.faces if hasattr(f.carrier, "poles")
        )
        took, size = _step(built.solid)
        yield (
            f"{count}", f"{target:.1e}", *(f"{t:.2f}" for t in (*times, took)),
            f"{size / 1e6:.1f}", f"{_memory():.0f}",
        )  # fmt: skip
        # poles grow as tolerance^(-2/3)
        target /= 10**1.5 if count < 0.5 * most else 2.0


def _step(solid) -> tuple[float, int]:
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "large.step")
        writer = STEPControl_Writer()
        writer.Transfer(solid, STEPControl_AsIs)
        writer.Write(str(path))
        return time.process_time() - start, path.stat().st_size


TOLERANCE_HEAD: Row = (
    "solid", "tolerance / size", "s", "degrees: poles", "deviation / tolerance", "volume", "area"
)  # fmt: skip


def tolerances(smallest: int) -> Iterator[Row]:
    """Yield rows for whole compilations from 1e-3 to 10^-smallest of the part's size."""
    for name in ("channel_ellipse", "channel_contour", "channel_sine"):
        equation = _equation(name)
        size = analyse(equation).size
        for power in range(3, smallest + 1):
            start = time.process_time()
            try:
                report = compile_equation(equation, 10.0**-power * size).report
            except PointCadError as error:
                reason = f"{type(error).__name__}: {error}"
                yield (name, f"1e-{power}", "-", "-", reason[:70], "-", "-")
                continue
            took = time.process_time() - start
            wall = max(report.faces, key=lambda f: f.deviation)
            yield (
                name, f"1e-{power}", f"{took:.2f}",
                f"{'x'.join(map(str, wall.degrees))}: {'x'.join(map(str, wall.poles))}",
                f"{report.deviation / report.tolerance:.2f}",
                f"{report.solid.volume / report.equation.volume - 1:+.0e}",
                f"{report.solid.area / report.equation.area - 1:+.0e}",
            )  # fmt: skip


TURNS_HEAD: Row = (
    "turns",
    "s",
    "largest stage",
    "degrees: poles",
    "deviation",
    "volume",
    "peak MB",
)


def turns(most: int) -> Iterator[Row]:
    """Yield rows for the helical channel (A16) of 1 to `most` turns, default tolerance."""
    for count in (1, 2, 5, 10, 20, 50, 100):
        if count > most:
            return
        start = time.process_time()
        try:
            report = compile_equation(_equation("helical_channel", turns=str(count))).report
        except PointCadError as error:
            took = time.process_time() - start
            reason = f"{type(error).__name__}: {error}"
            yield (f"{count}", f"{took:.2f}", reason[:70], "-", "-", "-", f"{_memory():.0f}")
            continue
        took = time.process_time() - start
        stage = max(report.times, key=lambda name: report.times[name])
        wall = max(report.faces, key=lambda f: f.deviation)
        yield (
            f"{count}", f"{took:.2f}", f"{stage} ({report.times[stage]:.2f} s)",
            f"{'x'.join(map(str, wall.degrees))}: {'x'.join(map(str, wall.poles))}",
            f"{report.deviation:.1e}",
            f"{report.solid.volume / report.equation.volume - 1:+.0e}", f"{_memory():.0f}",
        )  # fmt: skip
