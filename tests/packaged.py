"""Build every shipped template with the pc2cad that is installed.

    python packaged.py build OUT.json [--verify]
    python packaged.py compare OUT.json OTHER.json

Run outside the checkout by `.ci/run`, for each Python and each kernel. Each template's own [expect]
is held, each STEP file is read back by the kernel, and volumes are written as JSON. `--verify`
holds every STEP file against its equation, without the kernel that wrote it, as ``pc2cad verify``
does. `compare` holds the volumes of two runs against each other: equal to 1e-12, or to the
tolerance where edges that the kernel has found between bodies bound a face.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import pc2cad as pc
from pc2cad.templates.shipped import bodies_paths, template_paths
from pc2cad.verify.gate import require_verified

#: the share by which two kernels may differ in a solid whose edges they have found themselves
OWN_EDGES = 1e-8


def build(out: Path, verify: bool) -> None:
    """Build all templates and write their volumes."""
    package = Path(pc.__file__).parent
    if package == Path(__file__).parents[1] / "pc2cad":
        raise SystemExit(f"{package} is the checkout, not an installed package")
    paths = template_paths() | bodies_paths()
    volumes, faces, judged = {}, dict.fromkeys(("exact", "bounded", "sampled"), 0), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name, path in sorted(paths.items()):
            equation, file = pc.read_template(path).bind(), Path(folder) / f"{name}.step"
            part = pc.compile_equation(equation)
            part.write(file)
            volumes[name] = part.report.solid.volume
            if verify:
                begun = time.process_time()
                found = require_verified(file.read_bytes(), equation, part.report.tolerance)
                judged += time.process_time() - begun
                for face in found.get("faces", ()):
                    faces[face["rests_on"]] += 1
    out.write_text(json.dumps(volumes, indent=0))
    python, spent = sys.version.split()[0], time.process_time() - judged
    print(f"{len(volumes)} templates, Python {python}, {spent:.0f} s of CPU")  # noqa: T201
    if verify:
        told = ", ".join(f"{count} {word}" for word, count in faces.items())
        print(f"all STEP files verified: faces {told}; {judged:.0f} s of CPU")  # noqa: T201


def compare(out: Path, other: Path) -> int:
    """Return how many templates differ in volume between two runs."""
    volumes, known = json.loads(out.read_text()), json.loads(other.read_text())
    allowed = {name: OWN_EDGES if name in bodies_paths() else 1e-12 for name in volumes}
    wrong = {
        name: (volume, known.get(name))
        for name, volume in volumes.items()
        if abs(volume - known.get(name, 0.0)) > allowed[name] * abs(volume)
    }
    for name, pair in wrong.items():
        print(f"{name}: {pair[0]!r} and {pair[1]!r}")  # noqa: T201
    print(f"{len(volumes)} volumes compared, {len(wrong)} differ")  # noqa: T201
    return len(wrong) + len(known.keys() ^ volumes.keys())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(required=True)
    verb = verbs.add_parser("build")
    verb.add_argument("out", type=Path)
    verb.add_argument("--verify", action="store_true")
    verb.set_defaults(run=build)
    verb = verbs.add_parser("compare")
    verb.add_argument("out", type=Path)
    verb.add_argument("other", type=Path)
    verb.set_defaults(run=compare)
    arguments = vars(parser.parse_args())
    sys.exit(min(1, arguments.pop("run")(**arguments) or 0))
