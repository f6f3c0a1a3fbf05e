"""Build every shipped template with the pc2cad that is installed: ``python packaged.py OUT.json``.

Run outside the checkout by `.ci/run`, for each Python and each kernel. Each template's own [expect]
is held, each STEP file is read back by the kernel, and volumes are written as JSON; a second file
of volumes as last argument is compared with: equal to 1e-12, or to the tolerance where edges that
the kernel has found between bodies bound a face.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import pc2cad as pc
from pc2cad.templates.shipped import bodies_paths, template_paths

#: the share by which two kernels may differ in a solid whose edges they have found themselves
OWN_EDGES = 1e-8


def main(out: str, other: str | None = None) -> int:
    """Build all templates; return how many differ from the volumes of `other`."""
    package = Path(pc.__file__).parent
    if package == Path(__file__).parents[1] / "pc2cad":
        raise SystemExit(f"{package} is the checkout, not an installed package")
    paths = template_paths() | bodies_paths()
    volumes = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, path in sorted(paths.items()):
            part = pc.compile_equation(pc.read_template(path).bind())
            part.write(Path(folder) / f"{name}.step")
            volumes[name] = part.report.solid.volume
    Path(out).write_text(json.dumps(volumes, indent=0))
    python, spent = sys.version.split()[0], time.process_time()
    print(f"{len(volumes)} templates, Python {python}, {spent:.0f} s of CPU")  # noqa: T201
    if other is None:
        return 0
    known = json.loads(Path(other).read_text())
    allowed = {name: OWN_EDGES if name in bodies_paths() else 1e-12 for name in paths}
    wrong = {
        name: (volume, known[name])
        for name, volume in volumes.items()
        if abs(volume - known[name]) > allowed[name] * abs(known[name])
    }
    for name, pair in wrong.items():
        print(f"{name}: {pair[0]!r} and {pair[1]!r}")  # noqa: T201
    return len(wrong) + len(known.keys() ^ volumes.keys())


if __name__ == "__main__":
    sys.exit(min(1, main(*sys.argv[1:])))
