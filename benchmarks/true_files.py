"""Files of pc2cad that are true, verified: ``python -m benchmarks.true_files [FOLDER…]``.

Every shipped template of one body and every template of the folders, where it builds, at three
tolerances and in the cubic profile, each as AP214 and AP242. A file that is not verified is a false
alarm. A line per file goes to stdout; with ``--log FILE`` there too, and what is there already is
left out.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from pc2cad.compiler import compile_solid
from pc2cad.equation.point_equation import PointEquation
from pc2cad.errors import PointCadError
from pc2cad.export.model import ExportOptions
from pc2cad.export.step import encode
from pc2cad.options import CompileOptions
from pc2cad.templates.bodies import BodiesTemplate
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths
from pc2cad.verify.against import verification
from pc2cad.verify.receipt import parse_step

#: tolerances are of the size of the part
KINDS = {"usual": {}, "rough": {"tolerance": 1e-4}, "fine": {"tolerance": 3e-8},
         "cubic": {"profile": "cubic"}}  # fmt: skip
SCHEMAS = ("AP214", "AP242")


def equations(folders: list[Path], only: list[str]) -> Iterator[tuple[str, PointEquation]]:
    paths = {name: path for name, path in template_paths().items()}
    paths |= {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}
    for name, path in paths.items():
        if only and name not in only:
            continue
        try:
            template = read_template(path)
            if not isinstance(template, BodiesTemplate):
                yield name, template.bind()
        except PointCadError as error:
            print(f"{name} is no equation: {str(error)[:90]}", flush=True)


def files(equation: PointEquation, kind: str) -> Iterator[tuple[str, bytes, float | None]]:
    """Yield a part's file in both schemas, and the tolerance it is to be held to."""
    options = dict(KINDS[kind])
    if "tolerance" in options:
        from pc2cad.domain.analysis import analyse

        options["tolerance"] *= analyse(equation).size
    part = compile_solid(equation, CompileOptions(**options))
    for schema in SCHEMAS:
        yield (
            schema,
            encode(part.exportable(), ExportOptions(step_schema=schema)),
            options.get("tolerance"),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--only", nargs="+", default=[])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    known = options.log.read_text() if options.log and options.log.exists() else ""
    told = Counter[str]()
    for kind in options.kinds:
        for name, equation in equations(options.folders, options.only):
            if f"{name} {kind} {SCHEMAS[-1]}" in known:
                continue
            try:
                for schema, data, tolerance in files(equation, kind):
                    start = time.process_time()
                    found = verification(parse_step(data), equation, tolerance)
                    verdict = "verified" if found.verified else "FALSE ALARM " + found.worst
                    told[verdict.split()[0]] += 1
                    line = (f"{name} {kind} {schema} {time.process_time() - start:.1f} s "
                            f"{found.evidence}: {verdict}")  # fmt: skip
                    print(line, flush=True)
                    if options.log:
                        with options.log.open("a") as log:
                            log.write(line + "\n")
            except PointCadError as error:
                told["not built"] += 1
                print(f"{name} {kind} is not built: {str(error)[:90]}", flush=True)
    print(dict(told))


if __name__ == "__main__":
    main()
