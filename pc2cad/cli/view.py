"""``pc2cad view``: a part as one page for any browser, or served live on this machine."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import closing
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

from pc2cad.cli.inputs import (
    add_options,
    add_template,
    check_different,
    load,
    read_options,
    read_settings,
    read_triple,
)
from pc2cad.cli.output import Progress, say, shown
from pc2cad.errors import InputError, PointCadError, named

if TYPE_CHECKING:
    from pc2cad.part import Part
    from pc2cad.studies.over_ranges import ProvedLater
    from pc2cad.templates.header import Parameter
    from pc2cad.templates.ranges import Axis
    from pc2cad.viewer.page import Slider, Variant
    from pc2cad.viewer.worker import Question

#: a page holds every combination of its sliders' values
MOST_VARIANTS = 64


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the template, the output, the sliders and the server."""
    add_template(parser)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("-o", "--output", metavar="FILE", help="page to write, .html")
    where.add_argument(
        "--serve", action="store_true",
        help="serve the page on 127.0.0.1 instead and recompute the part as its sliders move",
    )  # fmt: skip
    add_options(parser)
    parser.add_argument(
        "--slider", metavar="NAME=VALUES", action="append", default=[], dest="sliders",
        help="let a parameter vary: LOW:HIGH:COUNT or a list A,B,C; with --serve LOW:HIGH "
        "(repeatable; --serve offers all parameters without it)",
    )  # fmt: skip
    parser.add_argument(
        "--points", metavar="NU,NV,NW", help="offer the points of an even grid of the box as well"
    )
    parser.add_argument(
        "--port", type=int, default=0, help="port for --serve (default: a free one)"
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress and no results")


def run(arguments: argparse.Namespace) -> int:
    """Write the page, or serve it until it is interrupted."""
    maker = _Maker(arguments)
    return _serve(maker, arguments) if arguments.serve else _write(maker, arguments)


class _Maker:
    """Compiles the template at some values of its parameters into a payload."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self.template, self.path = load(arguments)
        self.settings = read_settings(arguments.settings)
        self.opening = self.template.bind(self.settings).parameters
        self._options = read_options(arguments)
        self._points: tuple[int, int, int] | None = None
        if arguments.points is not None:
            from pc2cad.picture.style import Style

            self._points = read_triple("--points", arguments.points, ",")
            Style(points=self._points)  # refuses what is too much

    def __reduce__(self) -> tuple[type[_Maker], tuple[argparse.Namespace]]:
        return _Maker, (self._arguments,)  # templates hold functions, which do not pickle

    def answer(self, question: Question) -> bytes:
        """Return the page's payload of some values, or a file; PointCadError for no solid."""
        from pc2cad.export.model import ExportOptions
        from pc2cad.export.registry import format_for
        from pc2cad.viewer.payload import payload
        from pc2cad.viewer.worker import Download

        if not isinstance(question, Download):
            return payload(self._compiled(question), self._points)
        encode = format_for(f"part{question.ending}").encoder()
        return encode(self._compiled(question.values).exportable(), ExportOptions())

    def _compiled(self, values: Mapping[str, str]) -> Part:
        from pc2cad.compiler import compile_solid

        equation = self.template.bind({**self.settings, **values})
        known = self._proved.at(values) if self._arguments.serve else None
        return compile_solid(equation, self._options, known=known)

    @cached_property
    def sliders(self) -> list[Slider]:
        """Sliders over ranges, for a page that is served."""
        given = [_live(text, self) for text in self._arguments.sliders]
        return given or [_offered(p, self) for p in self.template.parameters]

    @cached_property
    def _proved(self) -> ProvedLater:
        from pc2cad.studies.over_ranges import ProvedLater

        over = {slider.name: (slider.low, slider.high) for slider in self.sliders}
        fixed = {name: value for name, value in self.settings.items() if name not in over}
        return ProvedLater(self.template, over, fixed)


def _write(maker: _Maker, arguments: argparse.Namespace) -> int:
    from pc2cad.export.files import by_ending, check_target, write_atomically
    from pc2cad.viewer.page import page

    by_ending(arguments.output, {".html": None, ".htm": None}, "page")
    check_target(arguments.output)
    check_different((arguments.output,), maker.path)
    sliders = [_stored(text, maker) for text in arguments.sliders]
    count = 1
    for slider in sliders:
        count *= len(slider.values)
    if count > MOST_VARIANTS:
        raise InputError(
            f"the sliders have {count} combinations and a page holds {MOST_VARIANTS}; give fewer "
            "values, or use --serve"
        )
    with Progress(arguments.quiet) as progress, named(arguments.template):
        variants = []
        for number, values in enumerate(product(*(s.values for s in sliders)), start=1):
            progress(f"part {number} of {count}")
            chosen = {s.name: repr(v) for s, v in zip(sliders, values, strict=True)}
            variants.append(_variant(maker, chosen, alone=count == 1))
    data = page(maker.template.title, sliders, variants, live=False)
    write_atomically(arguments.output, data)
    if not arguments.quiet:
        failed = sum(variant.data is None for variant in variants)
        refused = f", {failed} of them no solid" if failed else ""
        parts = f"{count} parts{refused}" if count > 1 else "1 part"
        say(f"{shown(arguments.output)}: {parts}, {len(data) / 1e6:.1f} MB")
    return 0


def _variant(maker: _Maker, values: Mapping[str, str], alone: bool) -> Variant:
    """Return one variant; a failure among several is shown by the page at its place."""
    from pc2cad.viewer.page import Variant

    try:
        return Variant(maker.answer(values))
    except PointCadError as error:
        if alone:
            raise
        return Variant(None, str(error))


def _serve(maker: _Maker, arguments: argparse.Namespace) -> int:
    from pc2cad.viewer.page import Variant, page
    from pc2cad.viewer.recompute import Recompute
    from pc2cad.viewer.serve import FILES, server

    sliders = maker.sliders
    memory = arguments.memory_limit * 1024**3
    with closing(Recompute(maker.answer, arguments.time_limit, memory)) as recompute:
        with Progress(arguments.quiet) as progress, named(arguments.template):
            progress("compile")
            first = Variant(recompute({}))
        content = page(maker.template.title, sliders, [first], live=True, files=FILES)
        with server(content, recompute, arguments.port) as running:
            if not arguments.quiet:
                say(f"{running.address} (interrupt with Ctrl-C)", flush=True)
            try:
                running.serve_forever()
            except KeyboardInterrupt:
                return 0
    return 0


def _stored(text: str, maker: _Maker) -> Slider:
    """Return a slider over values, and the opening one."""
    from pc2cad.viewer.page import Slider

    parameter, axis = _axis(text, maker)
    if axis.range is not None:
        raise InputError(
            f"--slider '{text[:80]}' is a range, which takes --serve; for a page write "
            "NAME=LOW:HIGH:COUNT or NAME=A,B,C"
        )
    opening = float(maker.opening[parameter.name])
    values = tuple(sorted({*axis.values, opening}))
    return Slider(parameter.name, parameter.about, opening, values)


def _live(text: str, maker: _Maker) -> Slider:
    from pc2cad.viewer.page import Slider

    parameter, axis = _axis(text, maker)
    if axis.range is None:
        raise InputError(f"--slider '{text[:80]}': with --serve write NAME=LOW:HIGH")
    opening = float(maker.opening[parameter.name])
    return Slider(parameter.name, parameter.about, opening, (), *axis.range)


def _offered(parameter: Parameter, maker: _Maker) -> Slider:
    """Return a slider round the opening value, from half to double of it, within its range."""
    from pc2cad.expression.scalar import evaluate
    from pc2cad.viewer.page import Slider

    opening = float(maker.opening[parameter.name])
    lowest = evaluate(parameter.minimum, {}) if parameter.minimum else float("-inf")
    highest = evaluate(parameter.maximum, {}) if parameter.maximum else float("inf")
    if highest - lowest <= 10 * max(abs(opening), 1e-300):
        low, high = lowest, highest
    else:
        around = abs(opening) or 1.0
        low, high = opening - around / 2, opening + around
    return Slider(
        parameter.name, parameter.about, opening, (), max(low, lowest), min(high, highest)
    )  # fmt: skip


def _axis(text: str, maker: _Maker) -> tuple[Parameter, Axis]:
    """Return the parameter that a slider moves, and the values or the range that it takes."""
    from pc2cad.equation.language import nearest
    from pc2cad.templates.ranges import read_axis, split_setting

    name, given = split_setting("--slider", text)
    known = {p.name: p for p in maker.template.parameters}
    if name not in known:
        raise InputError(f"--slider: no parameter '{name[:80]}'{nearest(name, list(known))}")
    return known[name], read_axis(name, given)
