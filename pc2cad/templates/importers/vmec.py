"""Input files of VMEC to templates: the surface of a stellarator or tokamak, filled or in layers.

The boundary is R = Σ RBC(n,m) cos(mθ - n·nfp·φ) + RBS(n,m) sin(…), and Z of ZBC and ZBS likewise.
Layers stand on it, measured in the planes φ = const or along its normal. Without layers the solid
is the plasma, drawn from a line that sees all of every section; it is sought by linear programming:
its distance from every tangent of the sections is linear in its coefficients.

Source: S. P. Hirshman, J. C. Whitson (Phys. Fluids 26, 1983), and VMEC's own input files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Final

from pc2cad.errors import InputError
from pc2cad.expression.waves import LARGEST_WAVE, MOST_WAVES
from pc2cad.templates.importers import MEASURED
from pc2cad.templates.importers.boundary import (
    TABLES,
    Surface,
    line_of_sight,
    volume_and_area,
    way_round,
)
from pc2cad.templates.importers.lines import (
    Source,
    named_after,
    quoted,
    read_lines,
    shown,
    table,
    written,
)
from pc2cad.trust.names import LABEL_RULE, is_label

_NAME: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]{0,63})[ \t]*(\([^()=]{0,80}\))?[ \t]*=", re.ASCII)
_INDEX: Final = re.compile(
    r"\([ \t]*([+-]?[0-9]{1,6})[ \t]*,[ \t]*([+-]?[0-9]{1,6})[ \t]*\)", re.ASCII
)
_REPEATED: Final = re.compile(r"([0-9]{1,6})\*(\S*)\Z", re.ASCII)
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)
_LOGICAL: Final = re.compile(r"\.?([tf])[a-z]*\.?\Z", re.ASCII | re.IGNORECASE)


def import_vmec(
    file: str | os.PathLike[str],
    layers: Mapping[str, float | str] | None = None,
    *,
    measured: str = "plane",
    periods: int = 1,
) -> str:
    """Return the text of a template of the surface in an input file of VMEC.

    `layers` maps names to thicknesses (metres, or texts in u and v, which are θ and φ) from the
    surface outwards, ``measured`` in the ``plane`` φ = const or along the ``normal``. Without them
    the solid is the plasma. `periods` are those that the solid has; all of them close it. Raises
    InputError, with the line where the file is not of its format.
    """
    if measured not in MEASURED:
        raise InputError(f"layers are measured {' or '.join(MEASURED)}, not {measured!r}")
    surface = read_surface(file)
    if not 1 <= periods <= surface.periods:
        raise InputError(f"periods are 1 to {surface.periods}, and {periods} were asked for")
    for name, thickness in (layers or {}).items():
        if not isinstance(thickness, str) and not 0 < thickness < 1e6:
            raise InputError(f"the layer '{shown(name)}' is {thickness} thick; a length is above 0")
        if not is_label(name):
            raise InputError(f"the name of a layer is {LABEL_RULE}; '{shown(name)}' is none")
    lines = [*_head(file, surface, periods), *_series(surface)]
    if layers:
        lines += _wall(surface, layers, measured)
    else:
        lines += _plasma(surface, periods)
    return "\n".join([*lines, ""])


# -- the file --------------------------------------------------------------------------------------


def read_surface(file: str | os.PathLike[str]) -> Surface:
    """Return the surface that an input file of VMEC describes; raise FileNotReadableError."""
    source = read_lines(file)
    periods, asymmetric = 1, False
    found: dict[str, dict[tuple[int, int], Fraction]] = {name: {} for name in TABLES}
    for line, name, index, values in _assignments(source):
        if name == "nfp":
            count = source.number(line, values[0] if values else "", "the number of periods")
            if count.denominator != 1 or not 1 <= count <= LARGEST_WAVE:
                source.fail(line, f"NFP is a whole number from 1 to {LARGEST_WAVE}")
            periods = int(count)
        elif name == "lasym":
            logical = _LOGICAL.match(values[0]) if values else None
            if logical is None:
                source.fail(line, "LASYM is T or F")
            asymmetric = logical[1].lower() == "t"
        elif name in found:
            _take(source, line, name, index, values, found[name])
    if not found["rbc"] or not (found["zbs"] or found["zbc"]):
        source.fail(0, "no boundary: there are no RBC(n,m), or neither ZBS nor ZBC")
    if not asymmetric:
        # as VMEC itself does
        found["rbs"], found["zbc"] = {}, {}
    return Surface(periods, {
        name: [(m, n, c) for (m, n), c in sorted(rows.items()) if c] for name, rows in found.items()
    })  # fmt: skip


def _assignments(source: Source) -> Iterator[tuple[int, str, str, list[str]]]:
    """Yield line, name (lower case), index and values of what the namelist INDATA assigns."""
    inside, current = False, None
    for number, text in enumerate(source.lines, 1):
        plain = _without_texts(text)
        start = plain.strip().lower()
        if not inside:
            if start.startswith(("&indata", "$indata")):
                inside, plain = True, plain[plain.lower().index("indata") + 6 :]
            else:
                continue
        ends = re.search(r"(?:^|[ \t,])(/|&end|\$end)", plain, re.IGNORECASE)
        if ends:
            plain = plain[: ends.start()]
        names = list(_NAME.finditer(plain))
        before = plain[: names[0].start()] if names else plain
        if current is not None:
            current[3].extend(_values(source, number, before))
        for k, match in enumerate(names):
            if current is not None:
                yield current
            stop = names[k + 1].start() if k + 1 < len(names) else len(plain)
            values = _values(source, number, plain[match.end() : stop])
            current = (number, match[1].lower(), match[2] or "", values)
        if ends:
            break
    if not inside:
        source.fail(0, "no namelist &INDATA: this is no input file of VMEC")
    if current is not None:
        yield current


def _without_texts(line: str) -> str:
    """Return a line without texts in quotes and without its comment."""
    kept, quote = [], ""
    for character in line:
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
            kept.append("T")
        elif character == "!":
            break
        else:
            kept.append(character)
    return "".join(kept)


def _values(source: Source, line: int, text: str) -> list[str]:
    """Return the values of an assignment, those with a repeat count as often as it says."""
    values: list[str] = []
    for part in text.replace(",", " ").split():
        repeated = _REPEATED.match(part)
        count = int(repeated[1]) if repeated else 1
        if count > MOST_WAVES:
            source.fail(line, f"{count} values are more than any table has")
        values += [repeated[2] if repeated else part] * count
    return values


def _take(
    source: Source, line: int, name: str, index: str, values: list[str],
    rows: dict[tuple[int, int], Fraction],
) -> None:  # fmt: skip
    """Note the coefficients of NAME(n,m) = value; more values go on with n."""
    match = _INDEX.match(index)
    label = f"{name.upper()}{shown(index)}"
    if match is None:
        source.fail(line, f"{label} is not of the form {name.upper()}(n,m) with two whole numbers")
    n, m = int(match[1]), int(match[2])
    if not values:
        source.fail(line, f"{label} has no value")
    for i, text in enumerate(values):
        if max(abs(n + i), abs(m)) > LARGEST_WAVE:
            source.fail(line, f"{label}: no m and n beyond {LARGEST_WAVE} are read")
        rows[m, n + i] = source.number(line, text)
    if len(rows) > MOST_WAVES:
        source.fail(line, f"there are more than {MOST_WAVES} {name.upper()}")


# -- the template ----------------------------------------------------------------------------------


def _head(file: str | os.PathLike[str], surface: Surface, periods: int) -> Iterator[str]:
    name = named_after(file)
    of_all = "all" if periods == surface.periods else str(periods)
    yield from (
        f"title = {quoted(f'Stellarator, {of_all} of {surface.periods} periods, from {name}')}",
        'about = "A boundary of VMEC; u is the poloidal angle, v the toroidal one."',
        f"source = {quoted(f'RBC, RBS, ZBC and ZBS of {name}')}",
        'units = "m"',
        "",
        "[domain]",
        'u = [0, "2*pi"]',
        f'v = [0, "2*pi*{periods}/{surface.periods}"]',
        "",
    )


def _series(surface: Surface) -> Iterator[str]:
    for name, cos, sin in (("R", "rbc", "rbs"), ("Z", "zbc", "zbs")):
        yield from _one_series(name, surface.periods, surface.waves[cos], surface.waves[sin])


def _one_series(
    name: str,
    periods: int,
    cos: list[tuple[int, int, Fraction]],
    sin: list[tuple[int, int, Fraction]],
) -> Iterator[str]:
    yield f"[fourier.{name}]"
    yield f"periods = {periods}"
    for key, rows in (("cos", cos), ("sin", sin)):
        if rows or (key == "cos" and not sin):
            yield f"{key} = ["
            yield from table(rows or [(0, 0, Fraction(0))])
            yield "]"
    yield ""


def _wall(surface: Surface, layers: Mapping[str, float | str], measured: str) -> Iterator[str]:
    sign = "" if way_round(surface) > 0 else "-"
    if len(layers) == 1:
        ((name, thickness),) = layers.items()
        deep = f"({thickness})*w" if isinstance(thickness, str) else f"{written(thickness)}*w"
        yield f"# {name}, and how deep w is in it"
    else:
        yield "[layers]"
        for name, thickness in layers.items():
            value = quoted(thickness) if isinstance(thickness, str) else written(thickness)
            yield f"{name if _BARE.fullmatch(name) else quoted(name)} = {value}"
        yield ""
        deep = "depth(w)"
    yield "[let]"
    yield f"deep = {quoted(deep)}"
    yield 'r = "R(u, v)"'
    yield 'z = "Z(u, v)"'
    if measured == "plane":
        yield from (
            'r_u = "diff(r, u)"',
            'z_u = "diff(z, u)"',
            'stretch = "sqrt(r_u^2 + z_u^2)"',
            f'n_r = "{sign}z_u/stretch"                   # the normal in the plane v = const',
            f'n_z = "{"-" if not sign else ""}r_u/stretch"',
            'rho = "r + deep*n_r"',
            "",
            "[solid]",
            'x = "rho*cos(v)"',
            'y = "rho*sin(v)"',
            'z = "z + deep*n_z"',
        )
    else:
        first, second = ("v", "u") if not sign else ("u", "v")
        yield from (
            'S = "[r*cos(v), r*sin(v), z]"',
            f'N = "unit(cross(diff(S, {first}), diff(S, {second})))"',
            "",
            "[solid]",
            'M = "S + N*deep"',
        )


def _plasma(surface: Surface, periods: int) -> Iterator[str]:
    line = line_of_sight(surface)
    yield from _one_series("R_c", surface.periods, line["rbc"], line["rbs"])
    yield from _one_series("Z_c", surface.periods, line["zbc"], line["zbs"])
    volume, area = volume_and_area(surface)
    share = periods / surface.periods
    yield from (
        "[let]",
        'r_c = "R_c(0, v)"                         # a line that sees all of every section',
        'z_c = "Z_c(0, v)"',
        'r = "r_c + (R(u, v) - r_c)*w"',
        "",
        "[solid]",
        'x = "r*cos(v)"',
        'y = "r*sin(v)"',
        'z = "z_c + (Z(u, v) - z_c)*w"',
        "",
        "[expect]",
        f"volume = {written(volume * share)}",
    )
    if periods == surface.periods:
        yield f"area = {written(area)}"
