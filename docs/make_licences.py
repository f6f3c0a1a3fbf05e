"""Make docs/licences.md: the packages that pc2cad needs to run, and their licences.

Usage: ``python docs/make_licences.py [--check | --names]``, where pc2cad and what it needs is
installed: `--check` writes nothing and ends with 1 where the page is out of date, `--names` prints
the names of the packages alone.
"""

from __future__ import annotations

import sys
import tomllib
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HERE = Path(__file__).parent
PAGE = HERE / "licences.md"
PROJECT = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
#: what pc2cad's own requirements are for
PURPOSE = {
    "cadquery": "the CAD kernel's bindings (OCP) and the objects that the plugin speaks in",
    "lib3mf": "3MF files, written by the consortium's own library",
    "numpy": "arrays: evaluation, fits, proofs, meshes",
    "rich": "the command line's tables",
    "scipy": "banded solvers, B-spline bases, sparse matrices, nearest neighbours",
    "sympy": "equations given as SymPy expressions, and what `show` prints",
}
HEAD = """# Licences

pc2cad is under the Apache License 2.0 ([LICENSE](../LICENSE), [NOTICE](../NOTICE)). What it needs
to run, on Linux, made from the packages' own metadata by `python docs/make_licences.py`:

| package | licence | needed by |
|---|---|---|
"""
TAIL = """
The kernel itself, Open CASCADE Technology, is under the LGPL 2.1 with an exception, within the
wheel of `cadquery-ocp`. gmsh, which is under the GPL, is installed by the extra `fea` only and
imported only where tetrahedra are asked for.

What pc2cad asks for by itself:

| package | for |
|---|---|
"""


def needed() -> dict[str, set[str]]:
    """Return the packages that an installation without extras brings, and who asks for each."""
    found: dict[str, set[str]] = {}
    waiting = [("pc2cad", Requirement(text)) for text in PROJECT["dependencies"]]
    while waiting:
        parent, wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name not in found:
            own = map(Requirement, distribution(name).requires or ())
            waiting += [(name, other) for other in own if _applies(other, wanted.extras)]
        found.setdefault(name, set()).add(parent)
    return found


def _applies(wanted: Requirement, extras: set[str]) -> bool:
    return not wanted.marker or any(wanted.marker.evaluate({"extra": e}) for e in (*extras, ""))


def licence(package: Distribution) -> str:
    """Return a package's licence by its metadata: expression, classifiers, or the short field."""
    expression = package.metadata.get("License-Expression")
    classifiers = [
        text.rpartition(" :: ")[2]
        for text in package.metadata.get_all("Classifier") or ()
        if text.startswith("License :: ") and not text.endswith("OSI Approved")
    ]
    field = package.metadata.get("License") or ""
    short = field if "\n" not in field and len(field) < 60 else ""
    return expression or ", ".join(sorted(classifiers)) or short or "not stated"


def page() -> str:
    """Return the whole page."""
    rows = [
        f"| {name} | {licence(distribution(name))} | {', '.join(sorted(parents))} |"
        for name, parents in sorted(needed().items())
    ]
    own = sorted(canonicalize_name(Requirement(text).name) for text in PROJECT["dependencies"])
    purposes = [f"| {name} | {PURPOSE[name]} |" for name in own]
    return "\n".join((HEAD.rstrip(), *rows, TAIL.rstrip(), *purposes, ""))


def main() -> int:
    """Write the page, or compare it, or print names."""
    if "--names" in sys.argv:
        sys.stdout.write("\n".join(sorted(needed())) + "\n")
        return 0
    text = page()
    if "--check" in sys.argv:
        old = PAGE.read_text() if PAGE.exists() else ""
        differ = sorted(set(old.splitlines()) ^ set(text.splitlines()))
        sys.stderr.write("".join(f"{PAGE.name} is out of date: {line}\n" for line in differ))
        return bool(differ)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
